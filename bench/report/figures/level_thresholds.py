"""The threshold at each light level with dark light accounted for, beside the apparent one that rises in the dark."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.characterize.weber import signal_of
from bench.report.figures import style
from bench.report.wording import polarity_label

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bench.analysis.results import Estimate, ResponsePolarity
    from bench.report.characterized import SavedFamily, SavedLevel, SavedTest

__all__ = ["LevelThresholdNumbers", "Panel", "Series", "draw", "prepare"]

_BESIDE: Final = 0.011  # of the length of the axis: levels behind a filter stand to the right
_TALL: Final = 4.0  # median half-widths that the enlarged panel shows of a bar
_PALE: Final = "#9d9d9d"


@dataclass(frozen=True, slots=True)
class Series:
    """One threshold at each level that has it, the dimmest first."""

    lux: npt.NDArray[np.float64]  #: (n,)
    value: npt.NDArray[np.float64]  #: (n,) ln
    low: npt.NDArray[np.float64]  #: (n,)
    high: npt.NDArray[np.float64]  #: (n,)
    filtered: npt.NDArray[np.bool_]  #: (n,) behind a neutral-density filter


@dataclass(frozen=True, slots=True)
class Panel:
    """One polarity."""

    polarity: ResponsePolarity
    true: Series | None  #: dark light accounted for; None where no dark light is known
    apparent: Series | None  #: as read off the curves
    common: Estimate  #: the threshold of all levels together, ln
    fitted: bool  #: whether `true` is of a fit, else of the readings and the straight line through them
    test: SavedTest | None

    @property
    def verdict(self) -> str:
        """Return what the test says, for a title."""
        if self.test is None or self.true is None:
            return ""
        p = f"p = {self.test.p_value:.2g}" if self.test.p_value >= 1e-4 else "p < 0.0001"
        return f"one threshold holds, {p}" if self.test.holds else f"threshold changes with light, {p}"


@dataclass(frozen=True, slots=True)
class LevelThresholdNumbers:
    """All that the figure shows."""

    panels: tuple[Panel, ...]
    x_ends: tuple[float, float]  #: lux


def prepare(families: Sequence[SavedFamily]) -> LevelThresholdNumbers | None:
    """Return the numbers of the figure for families of one kind, or None where no level has a threshold."""
    panels = [p for p in (_panel(f) for f in families) if p.true is not None or p.apparent is not None]
    if not panels:
        return None
    levels = [x for p in panels for s in (p.true, p.apparent) if s is not None for x in s.lux.tolist()]
    return LevelThresholdNumbers(tuple(panels), style.spread_over(levels))


def _panel(family: SavedFamily) -> Panel:
    reading = "intercept" if family.by_intercept is not None or family.by_half is None else "half"
    apparent = _series([(lv, _three(getattr(lv, reading))) for lv in family.levels])
    if family.fit:
        known = [(lv, _three(lv.theta)) for lv in family.levels if lv.theta is not None]
    else:
        dark = family.dark_lux.value
        known = [
            (lv, _signals(getattr(lv, reading), lv, dark, family.polarity))
            for lv in family.levels
            if lv.baseline_lux + dark > 0.0
        ]
    return Panel(family.polarity, _series(known), apparent, family.theta, bool(family.fit), family.test)


def _three(estimate: Estimate) -> tuple[float, float, float]:
    return estimate.value, estimate.low, estimate.high


def _signals(
    reading: Estimate, level: SavedLevel, dark_lux: float, polarity: ResponsePolarity
) -> tuple[float, float, float]:
    """Return by how much a reading, and the ends of its interval, change the signal beside the dark light."""
    value, low, high = (signal_of(c, level.baseline_lux, dark_lux, polarity) for c in _three(reading))
    return value, low, high


def _series(known: Sequence[tuple[SavedLevel, tuple[float, float, float]]]) -> Series | None:
    good = [(lv, v) for lv, v in known if lv.baseline_lux > 0.0 and math.isfinite(v[0])]
    if not good:
        return None
    value, low, high = np.array([v for _, v in good]).T
    filtered = np.array([lv.nd_od > 0.0 for lv, _ in good])
    return Series(np.array([lv.baseline_lux for lv, _ in good]), value, low, high, filtered)


def draw(numbers: LevelThresholdNumbers) -> Figure:
    """Draw one column for each polarity: both thresholds above, and the one that is to be level enlarged below."""
    enlarged = any(p.true is not None for p in numbers.panels)
    figure = style.new_figure(5.6 if enlarged else 3.8)
    axes = figure.subplots(
        2 if enlarged else 1, len(numbers.panels), sharex=True, squeeze=False,
        height_ratios=[1.25, 1.0] if enlarged else None,
    )  # fmt: skip
    for column, panel in enumerate(numbers.panels):
        _draw_both(axes[0, column], panel, numbers)
        if enlarged:
            _draw_enlarged(axes[1, column], panel, numbers)
        style.lux_axis(axes[-1, column], *numbers.x_ends, fewest=2)
    axes[0, 0].set_ylabel("threshold (ln units)")
    if enlarged:
        axes[1, 0].set_ylabel("enlarged (ln units)")
    _legend(figure, numbers)
    return figure


def _draw_both(ax: Axes, panel: Panel, numbers: LevelThresholdNumbers) -> None:
    tops = [float(s.value.max()) for s in (panel.true, panel.apparent) if s is not None]
    ends = [float(np.nanmax(s.high)) for s in (panel.true, panel.apparent) if s is not None]
    if panel.apparent is not None:
        _draw_series(ax, panel.apparent, _PALE, "s", numbers, size=4.5)
    if panel.true is not None:
        _band(ax, panel)
        _draw_series(ax, panel.true, style.POLARITY_COLOURS[panel.polarity], "D", numbers)
    ax.set_ylim(0.0, 1.08 * min(max(ends + tops), 1.5 * max(tops)))
    title = polarity_label(panel.polarity)
    ax.set_title(f"{title}: {panel.verdict}" if panel.verdict else title, loc="left", fontweight="bold")


def _draw_enlarged(ax: Axes, panel: Panel, numbers: LevelThresholdNumbers) -> None:
    if panel.true is None:
        ax.text(0.5, 0.5, "no dark light known,\nnothing to correct with", transform=ax.transAxes, ha="center",
                va="center", color=style.MUTED)  # fmt: skip
        ax.set_yticks([])
        return
    _band(ax, panel)
    _draw_series(ax, panel.true, style.POLARITY_COLOURS[panel.polarity], "D", numbers)
    half_widths = 0.5 * (panel.true.high - panel.true.low)
    known = half_widths[np.isfinite(half_widths)]
    reach = _TALL * float(np.median(known)) if known.size else 0.0
    low = np.fmax(panel.true.low, panel.true.value - reach)
    high = np.fmin(panel.true.high, panel.true.value + reach)
    ends = [*low.tolist(), *high.tolist(), *panel.true.value.tolist(), panel.common.low, panel.common.high]
    finite = [v for v in ends if math.isfinite(v)]
    room = 0.12 * (max(finite) - min(finite)) or 0.05 * abs(max(finite))
    ax.set_ylim(min(finite) - room, max(finite) + room)


def _band(ax: Axes, panel: Panel) -> None:
    if not math.isfinite(panel.common.value):
        return
    colour = style.POLARITY_COLOURS[panel.polarity]
    ax.axhspan(panel.common.low, panel.common.high, color=colour, alpha=0.16, linewidth=0.0, zorder=1)
    ax.axhline(panel.common.value, color=colour, linewidth=1.0, zorder=1.5)


def _draw_series(
    ax: Axes, series: Series, colour: str, marker: str, numbers: LevelThresholdNumbers, size: float = 5.5
) -> None:
    x = style.side_by_side(series.lux, np.where(series.filtered, _BESIDE, 0.0), numbers.x_ends)
    style.bars(ax, x, series.low, series.high, colour)
    for behind in (False, True):
        mine = series.filtered == behind
        ax.plot(
            x[mine], series.value[mine], linestyle="", marker=marker, color=colour, markersize=size,
            markerfacecolor="white" if behind else colour, markeredgewidth=1.1, zorder=3,
        )  # fmt: skip


def _legend(figure: Figure, numbers: LevelThresholdNumbers) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Line2D | Patch] = []
    if any(p.true is not None for p in numbers.panels):
        handles += [
            Line2D([], [], linestyle="", marker="D", color=style.INK, markersize=5.5,
                   label="dark light accounted for"),
            Patch(color=style.INK, alpha=0.2, linewidth=0.0, label="one threshold for all levels, 90 %"),
        ]  # fmt: skip
    if any(p.apparent is not None for p in numbers.panels):
        handles.append(
            Line2D([], [], linestyle="", marker="s", color=_PALE, markersize=4.5,
                   label="apparent, as read off the curve")
        )  # fmt: skip
    if any(bool(s.filtered.any()) for p in numbers.panels for s in (p.true, p.apparent) if s is not None):
        handles.append(
            Line2D([], [], linestyle="", marker="o", color=style.INK, markerfacecolor="white", markersize=5.0,
                   label="open: behind a filter")
        )  # fmt: skip
    figure.legend(handles=handles, loc="outside lower center", ncols=2)
