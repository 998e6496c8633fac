"""Background activity against light, and the noise at the comparators that it takes."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.analysis.results import BackgroundRow
from bench.report.figures import background, style

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.typing import LineStyleType

    from bench.analysis.results import Estimate, ResponsePolarity
    from bench.report.characterized import SavedFamily, SavedNoise

__all__ = ["NoiseLightNumbers", "NoiseSeries", "draw", "prepare"]

_BESIDE: Final = {"background": 0.0, "on": -0.006, "off": 0.006, "random": 0.019}  # of the length of the axis
_LABELS: Final = {
    "background": "from background", "on": "from the fit, ON", "off": "from the fit, OFF",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class NoiseSeries:
    """Noise at some light levels."""

    source: str  #: `background`, or `on`, `off`: the fit of that polarity
    lux: npt.NDArray[np.float64]  #: (n,) where it is drawn; dark has a place of its own
    rms: npt.NDArray[np.float64]  #: (n,) ln


@dataclass(frozen=True, slots=True)
class NoiseLightNumbers:
    """All that the figure shows."""

    rates: background.BackgroundNumbers
    random_lux: npt.NDArray[np.float64]  #: (n,) where it is drawn
    random_hz: npt.NDArray[np.float64]  #: (n,) ON and OFF together, without the regular part
    noise: tuple[NoiseSeries, ...]
    corner_hz: float  #: that the noise from background assumes; NaN where there is none


def prepare(levels: Sequence[SavedNoise], families: Sequence[SavedFamily]) -> NoiseLightNumbers | None:
    """Return the numbers of the figure for levels of one setting, or None where there is no rate to show.

    Of the fits, that of each polarity is shown that knows its threshold best.
    """
    rates = background.prepare([row for i, level in enumerate(levels) for row in _rows(i, level)])
    if rates is None:
        return None
    place = {0.0: rates.dark_at if rates.dark_at is not None else math.nan}
    random = [(place.get(n.baseline_lux, n.baseline_lux), n.random_hz) for n in levels if n.random_hz > 0.0]
    known = [n for n in levels if math.isfinite(n.noise_rms)]
    seen = [(place.get(n.baseline_lux, n.baseline_lux), n.noise_rms) for n in known]
    noise = [_series("background", seen)] if seen else []
    noise += _fitted([f for f in families if f.settings in {n.settings for n in levels}])
    lit = [x for s in noise for x in s.lux.tolist()]
    ends = (min([rates.x_limits[0], *(x / 1.6 for x in lit)]), max([rates.x_limits[1], *(1.6 * x for x in lit)]))
    lows, highs = [hz / 2.0 for _, hz in random], [2.0 * hz for _, hz in random]
    rates = replace(
        rates, x_limits=ends,
        y_limits=(min([rates.y_limits[0], *lows]), max([rates.y_limits[1], *highs])),
    )  # fmt: skip
    x, hz = np.array(sorted(random), np.float64).reshape(-1, 2).T
    return NoiseLightNumbers(rates, x, hz, tuple(noise), known[0].corner_hz if known else math.nan)


def _rows(number: int, level: SavedNoise) -> list[BackgroundRow]:
    both: tuple[tuple[ResponsePolarity, Estimate], ...] = (("on", level.on), ("off", level.off))
    # A rate is not 0 where there was an event; how many there were is not shown.
    return [
        BackgroundRow(number, polarity, level.baseline_lux, level.nd_od, int(rate.value > 0.0), math.nan, rate)
        for polarity, rate in both
    ]


def _fitted(families: Sequence[SavedFamily]) -> list[NoiseSeries]:
    found = []
    for polarity in ("on", "off"):
        mine = [f for f in families if f.polarity == polarity and f.fit]
        if mine:
            best = min(mine, key=lambda f: f.theta.high - f.theta.low)
            known = [(lv.baseline_lux, lv.noise_rms) for lv in best.levels if math.isfinite(lv.noise_rms)]
            found += [_series(polarity, known)] if known else []
    return found


def _series(source: str, known: Sequence[tuple[float, float]]) -> NoiseSeries:
    lux, rms = np.array(sorted(known), np.float64).T
    return NoiseSeries(source, lux, rms)


def draw(numbers: NoiseLightNumbers) -> Figure:
    """Draw the rates above, and the noise, where it is known, below."""
    rows = 2 if numbers.noise else 1
    figure = style.new_figure(3.6 + 2.2 * (rows - 1))
    axes = figure.subplots(rows, 1, sharex=True, squeeze=False, height_ratios=[1.4, 1.0][:rows])[:, 0]
    place = style.side_by_side(numbers.random_lux, _BESIDE["random"], numbers.rates.x_limits)
    axes[0].plot(
        place, numbers.random_hz, color=style.INK, linestyle=(0, (3, 2)), linewidth=1.0, marker="D", markersize=4.5,
        markerfacecolor="white", zorder=1.5,
    )  # fmt: skip
    background.draw_rates(axes[0], numbers.rates)
    handles = background.legend_handles(numbers.rates)
    handles.append(_handle("D", style.INK, "random part, ON and OFF", (0, (3, 2)), face="white"))
    if numbers.noise:
        handles += _draw_noise(axes[1], numbers)
    style.lux_axis(axes[-1], *numbers.rates.x_limits, dark_at=numbers.rates.dark_at)
    if numbers.noise:
        axes[0].set_xlabel("")
    figure.legend(handles=handles, loc="outside lower center", ncols=3)
    return figure


def _draw_noise(ax: Axes, numbers: NoiseLightNumbers) -> list[Line2D]:
    handles = []
    for series in numbers.noise:
        colour = style.POLARITY_COLOURS.get(series.source, style.INK)
        marker = style.POLARITY_MARKERS.get(series.source, "o")
        look: LineStyleType = "" if series.source == "background" else "-"
        face = colour if series.source == "background" else "white"
        place = style.side_by_side(series.lux, _BESIDE[series.source], numbers.rates.x_limits)
        ax.plot(place, series.rms, linestyle=look, linewidth=0.9, marker=marker, color=colour, markersize=5.5,
                markerfacecolor=face, markeredgewidth=1.1, zorder=3)  # fmt: skip
        text = _LABELS[series.source]
        if series.source == "background":
            text += f", corner {numbers.corner_hz:.3g} Hz"
        handles.append(_handle(marker, colour, f"noise {text}", look, face=face))
    highest = max(float(s.rms.max()) for s in numbers.noise)
    ax.set_ylim(0.0, 1.25 * highest)
    if numbers.rates.dark_at is not None:
        ax.axvline(numbers.rates.dark_at * 2.2, color=style.MUTED, linewidth=0.8, linestyle=(0, (2, 3)))
    ax.set_ylabel("noise rms (ln units)")
    return handles


def _handle(marker: str, colour: str, label: str, look: LineStyleType, *, face: str) -> Line2D:
    from matplotlib.lines import Line2D

    return Line2D([], [], linestyle=look, linewidth=1.0, marker=marker, color=colour, markersize=5.0,
                  markerfacecolor=face, label=label)  # fmt: skip
