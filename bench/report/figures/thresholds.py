"""The threshold against illuminance (or pulse width, or setting): 50 % point, intercept and fitted threshold."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.report.figures import style
from bench.report.wording import duration_label, polarity_label

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.typing import LineStyleType

    from bench.analysis.results import Estimate, ResponsePolarity, SCurve
    from bench.report.families import Axis, Family

__all__ = ["Series", "ThresholdNumbers", "draw", "prepare"]

_READINGS: Final = (("half", "50 % point", -1.0), ("intercept", "intercept", 0.0), ("theta", "fitted threshold", 1.0))
_SHIFT: Final = 0.009  # of the length of the axis
_FEWEST_STEPS: Final = 2
_LOOKS: Final[dict[str, tuple[str, LineStyleType, bool]]] = {
    "half": ("o", ":", False),  # marker, line, filled
    "intercept": ("s", "--", False),
    "theta": ("D", "-", True),
}


@dataclass(frozen=True, slots=True)
class Series:
    """One reading of all curves of one polarity, ascending."""

    polarity: ResponsePolarity
    reading: str  #: `half`, `intercept` or `theta`
    label: str
    x: npt.NDArray[np.float64]  #: (n,) lux, s, or the place of the setting
    value: npt.NDArray[np.float64]  #: (n,) ln
    low: npt.NDArray[np.float64]  #: (n,)
    high: npt.NDArray[np.float64]  #: (n,)
    place: float  #: -1, 0 or 1: side by side at the same x


@dataclass(frozen=True, slots=True)
class ThresholdNumbers:
    """All that the figure shows."""

    axis: Axis
    labels: tuple[str, ...]  #: of the steps
    series: tuple[Series, ...]
    x_ends: tuple[float, float]  #: of the axis; lux or s
    top: float  #: upper end of the threshold axis, ln


def prepare(curves: Sequence[SCurve], family: Family) -> ThresholdNumbers | None:
    """Return the numbers of the figure, or None where fewer than two steps have a reading."""
    series = []
    for polarity in ("on", "off"):
        mine = [(s.value, c) for c in curves if c.key.polarity == polarity and (s := family.step_of(c.key))]
        mine.sort(key=lambda pair: pair[0])
        for reading, label, place in _READINGS:
            pairs = [(x, e) for x, c in mine if (e := getattr(c, reading)) is not None and np.isfinite(e.value)]
            if pairs:
                series.append(_series(polarity, reading, label, place, pairs))
    places = [x for s in series for x in s.x.tolist()]
    if len(set(places)) < _FEWEST_STEPS:
        return None
    ends = (-0.5, len(family.steps) - 0.5) if family.axis == "settings" else style.spread_over(places)
    return ThresholdNumbers(family.axis, tuple(s.label for s in family.steps), tuple(series), ends, _top(series))


def _series(
    polarity: ResponsePolarity, reading: str, label: str, place: float, pairs: Sequence[tuple[float, Estimate]]
) -> Series:
    x, value, low, high = (
        np.array(column, np.float64) for column in zip(*((x, e.value, e.low, e.high) for x, e in pairs), strict=True)
    )
    return Series(polarity, reading, label, x, value, low, high, place)


def _top(series: Sequence[Series]) -> float:
    """Return the upper end of the axis; the bar of one badly known reading does not squeeze all others."""
    highest = max(float(s.value.max()) for s in series)
    bars = [float(h) for s in series for h in s.high if np.isfinite(h)]
    return 1.08 * min(max([highest, *bars]), 1.5 * highest)


def draw(numbers: ThresholdNumbers) -> Figure:
    """Draw one panel for each polarity, with a common threshold axis."""
    polarities = list(dict.fromkeys(s.polarity for s in numbers.series))
    figure = style.new_figure(4.0)
    axes = figure.subplots(1, len(polarities), sharey=True, squeeze=False)[0]
    for ax, polarity in zip(axes, polarities, strict=True):
        for series in numbers.series:
            if series.polarity == polarity:
                _draw_series(ax, series, numbers)
        ax.set_title(polarity_label(polarity), loc="left", fontweight="bold")
        ax.set_ylim(0.0, numbers.top)
        _x_axis(ax, numbers)
    axes[0].set_ylabel("threshold, log contrast (ln units)")
    _legend(figure, numbers)
    return figure


def _draw_series(ax: Axes, series: Series, numbers: ThresholdNumbers) -> None:
    colour = style.POLARITY_COLOURS[series.polarity]
    marker, line, filled = _LOOKS[series.reading]
    if numbers.axis == "settings":
        x = series.x + 0.08 * series.place
    else:
        x = style.side_by_side(series.x, _SHIFT * series.place, numbers.x_ends)
    style.bars(ax, x, series.low, series.high, colour)
    ax.plot(
        x, series.value, linestyle=line, linewidth=0.9, marker=marker, color=colour, markersize=5.0,
        markerfacecolor=colour if filled else "white", markeredgewidth=1.2, zorder=3,
    )  # fmt: skip


def _x_axis(ax: Axes, numbers: ThresholdNumbers) -> None:
    if numbers.axis == "settings":
        ax.set_xticks(range(len(numbers.labels)), numbers.labels, rotation=30, ha="right")
        ax.set_xlim(*numbers.x_ends)
        return
    low, high = numbers.x_ends
    if numbers.axis == "level":
        style.lux_axis(ax, low, high, fewest=2)
        return
    ax.set_xscale("log")
    ax.set_xlim(low, high)
    ticks = style.log_axis_ticks(low, high).tolist()
    ax.set_xticks(ticks, [duration_label(tick) for tick in ticks])
    ax.minorticks_off()
    ax.set_xlabel("length of the test pulse")


def _legend(figure: Figure, numbers: ThresholdNumbers) -> None:
    from matplotlib.lines import Line2D

    shown = {s.reading: s.label for s in numbers.series}
    handles = [
        Line2D([], [], color=style.INK, linestyle=line, linewidth=0.9, marker=marker, markersize=5.0,
               markerfacecolor=style.INK if filled else "white", markeredgewidth=1.2, label=shown[reading])
        for reading, (marker, line, filled) in _LOOKS.items()
        if reading in shown
    ]  # fmt: skip
    figure.legend(handles=handles, loc="outside lower center", ncols=3, handlelength=2.6)
