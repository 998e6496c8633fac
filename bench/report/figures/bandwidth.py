"""The corner of the photoreceptor, which follows the light, beside that of the low-pass, which does not."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.report.figures import style
from bench.report.wording import polarity_label

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.typing import LineStyleType

    from bench.analysis.results import ResponsePolarity
    from bench.report.characterized import SavedFamily

__all__ = ["BandwidthNumbers", "Corners", "draw", "prepare"]

_LOOKS: Final[dict[str, LineStyleType]] = {"on": "-", "off": "--"}
_BESIDE: Final = {"on": -0.006, "off": 0.006}  # of the length of the axis
_LINE_POINTS: Final = 200


@dataclass(frozen=True, slots=True)
class Corners:
    """The two low-passes of one polarity."""

    polarity: ResponsePolarity
    lux: npt.NDArray[np.float64]  #: (n,) the dimmest first
    corner_hz: npt.NDArray[np.float64]  #: (n,) of the photoreceptor at the baseline
    dark_lux: float
    hz_per_lux: tuple[float, float, float]  #: of the photoreceptor: value and interval
    low_pass_hz: tuple[float, float, float]  #: value and interval

    def at(self, lux: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return the corner of the photoreceptor at some light, Hz: it follows that light and the dark light."""
        return np.asarray(self.hz_per_lux[0] * (lux + self.dark_lux), np.float64)


@dataclass(frozen=True, slots=True)
class BandwidthNumbers:
    """All that the figure shows."""

    corners: tuple[Corners, ...]
    x_ends: tuple[float, float]  #: lux
    y_ends: tuple[float, float]  #: Hz


def prepare(families: Sequence[SavedFamily]) -> BandwidthNumbers | None:
    """Return the numbers of the figure for families of one kind, or None where no photoreceptor is seen."""
    corners = [c for f in families if (c := _corners(f)) is not None]
    if not corners:
        return None
    heights = [v for c in corners for v in (*c.corner_hz.tolist(), *c.low_pass_hz)]
    levels = [x for c in corners for x in c.lux.tolist()]
    return BandwidthNumbers(tuple(corners), style.spread_over(levels), style.spread_over(heights))


def _corners(family: SavedFamily) -> Corners | None:
    seen = {lv.baseline_lux: lv.corner_hz for lv in family.levels if math.isfinite(lv.corner_hz)}
    if not family.fit or not seen:
        return None
    slow, tau = family.fit["slow_s_lux"], family.fit["ln_tau"]
    per_lux = tuple(_corner(t) if t > 0.0 else math.inf for t in (slow.value, slow.high, slow.low))
    low_pass = tuple(_corner(math.exp(t)) for t in (tau.value, tau.high, tau.low))
    return Corners(
        family.polarity, np.array(sorted(seen)), np.array([seen[lux] for lux in sorted(seen)]),
        family.fit["dark_lux"].value, (per_lux[0], per_lux[1], per_lux[2]), (low_pass[0], low_pass[1], low_pass[2]),
    )  # fmt: skip


def _corner(tau: float) -> float:
    return 1.0 / (2.0 * math.pi * tau)


def draw(numbers: BandwidthNumbers) -> Figure:
    """Draw both polarities into one panel, on logarithmic axes."""
    figure = style.new_figure(3.8)
    ax = figure.subplots()
    for corners in numbers.corners:
        _draw_corners(ax, corners, numbers)
    style.lux_axis(ax, *numbers.x_ends)
    ax.set_ylim(*numbers.y_ends)
    style.plain_log_axis(ax)
    ax.set_ylabel("corner frequency (Hz)")
    figure.legend(loc="outside lower center", ncols=2, handlelength=2.6)
    return figure


def _draw_corners(ax: Axes, corners: Corners, numbers: BandwidthNumbers) -> None:
    colour, look = style.POLARITY_COLOURS[corners.polarity], _LOOKS[corners.polarity]
    name = polarity_label(corners.polarity)
    x = np.geomspace(*numbers.x_ends, _LINE_POINTS)
    ax.plot(x, corners.at(x), color=colour, linestyle=look, linewidth=1.0, zorder=2)
    ax.plot([], [], color=colour, linestyle=look, linewidth=1.0, marker=style.POLARITY_MARKERS[corners.polarity],
            markersize=6.0, label=f"{name}: photoreceptor at the light levels")  # fmt: skip
    place = corners.lux
    if len(numbers.corners) > 1:
        place = style.side_by_side(place, _BESIDE[corners.polarity], numbers.x_ends)
    ax.plot(place, corners.corner_hz, linestyle="", marker=style.POLARITY_MARKERS[corners.polarity],
            markersize=6.0, color=colour, zorder=3)  # fmt: skip
    value, low, high = corners.low_pass_hz
    ax.axhspan(low, high, color=colour, alpha=0.16, linewidth=0.0, zorder=1)
    ax.axhline(value, color=colour, linestyle=look, linewidth=2.2, alpha=0.7, zorder=1.5,
               label=f"{name}: low-pass, the same at all light, with its interval")  # fmt: skip
