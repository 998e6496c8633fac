"""The Weber contrast that a step needs, against 1/E: a straight line that tells the dark light.

``W = w (1 + E_d / E)``, so that the line meets W = 0 where ``1/E = -1/E_d``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.characterize.weber import weber
from bench.report.figures import style
from bench.report.wording import lux_interval, lux_label, polarity_label

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.text import Text
    from matplotlib.typing import LineStyleType

    from bench.analysis.results import Estimate, ResponsePolarity
    from bench.report.characterized import SavedFamily

__all__ = ["Panel", "Points", "StraightLine", "WeberNumbers", "draw", "prepare"]

_READINGS: Final = (("half", "50 % point", "o"), ("intercept", "intercept", "s"))
_LINES: Final[dict[str, tuple[str, LineStyleType, float]]] = {
    "fit": ("line of the fit", "-", 1.6),
    "intercept": ("line through intercepts", "--", 1.0),
    "half": ("line through 50 % points", ":", 1.2),
}
_FARTHEST_LEFT: Final = 1.2  # of the right half of the axis: a far crossing would squeeze the points
_ROOM: Final = 1.06
_TICK_ROOM: Final = 0.17  # of the length of the axis, between two labels of light levels
_BESIDE: Final = 0.003  # of the length of the axis
_RING: Final = 7.5  # marker of a point behind a filter: the one without at the same light lies inside of it
_BELOW_NOTE: Final = 0.76  # of the height of the axes
_TALL: Final = 1.5  # bars may be so much taller than the highest point


@dataclass(frozen=True, slots=True)
class Points:
    """One reading of all levels of a family that have one, the dimmest first."""

    reading: str  #: `half` or `intercept`
    inverse_lux: npt.NDArray[np.float64]  #: (n,) 1/lux
    weber: npt.NDArray[np.float64]  #: (n,)
    low: npt.NDArray[np.float64]  #: (n,)
    high: npt.NDArray[np.float64]  #: (n,)
    filtered: npt.NDArray[np.bool_]  #: (n,) behind a neutral-density filter


@dataclass(frozen=True, slots=True)
class StraightLine:
    """A threshold and a dark light."""

    name: str  #: `fit`, `intercept` or `half`
    w: float  #: Weber contrast needed far above the dark light
    dark_lux: Estimate

    def at(self, inverse_lux: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Return the Weber contrast at 1/E."""
        return self.w * (1.0 + self.dark_lux.value * np.asarray(inverse_lux, np.float64))

    @property
    def crossing(self) -> float:
        """Where the line meets 0, 1/lux; NaN where it does not, left of all light."""
        return -1.0 / self.dark_lux.value if self.dark_lux.value > 0.0 else math.nan


@dataclass(frozen=True, slots=True)
class Panel:
    """One polarity."""

    polarity: ResponsePolarity
    points: tuple[Points, ...]
    lines: tuple[StraightLine, ...]  #: the best first


@dataclass(frozen=True, slots=True)
class WeberNumbers:
    """All that the figure shows."""

    panels: tuple[Panel, ...]
    levels_lux: tuple[float, ...]  #: ascending
    x_ends: tuple[float, float]  #: 1/lux


def prepare(families: Sequence[SavedFamily]) -> WeberNumbers | None:
    """Return the numbers of the figure for families of one kind, or None where no level has a reading."""
    panels = [Panel(f.polarity, p, _lines(f)) for f in families if (p := _all_points(f))]
    if not panels:
        return None
    right = max(float(p.inverse_lux.max()) for panel in panels for p in panel.points)
    left = min([0.0, *(x for panel in panels for line in panel.lines[:1] for x in _left_of_light(line))])
    ends = (max(left, -_FARTHEST_LEFT * right) - 0.04 * right, _ROOM * right)
    levels = sorted({round(1.0 / x, 12) for panel in panels for p in panel.points for x in p.inverse_lux.tolist()})
    return WeberNumbers(tuple(panels), tuple(levels), ends)


def _left_of_light(line: StraightLine) -> list[float]:
    """Return where a line meets 0, and the farther end of the interval of that, as far as it meets it."""
    dark = line.dark_lux
    return [-1.0 / v for v in (dark.value, dark.low) if dark.value > 0.0 and v > 0.0]


def _all_points(family: SavedFamily) -> tuple[Points, ...]:
    return tuple(p for name, _, _ in _READINGS if (p := _points(family, name)) is not None)


def _points(family: SavedFamily, reading: str) -> Points | None:
    known = [
        (1.0 / lv.baseline_lux, e, lv.nd_od > 0.0)
        for lv in family.levels
        if lv.baseline_lux > 0.0 and math.isfinite((e := getattr(lv, reading)).value)
    ]
    if not known:
        return None
    value, low, high = np.array(
        [[weber(v, family.polarity) for v in (e.value, e.low, e.high)] for _, e, _ in known]
    ).T
    inverse, filtered = np.array([x for x, _, _ in known]), np.array([behind for _, _, behind in known])
    return Points(reading, inverse, value, low, high, filtered)


def _lines(family: SavedFamily) -> tuple[StraightLine, ...]:
    lines = []
    if family.fit:
        lines.append(StraightLine("fit", weber(family.theta.value, family.polarity), family.dark_lux))
    for name, line in (("intercept", family.by_intercept), ("half", family.by_half)):
        if line is not None:
            lines.append(StraightLine(name, weber(line.theta.value, family.polarity), line.dark_lux))
    return tuple(lines)


def draw(numbers: WeberNumbers) -> Figure:
    """Draw one panel for each polarity."""
    figure = style.new_figure(4.6)
    axes = figure.subplots(1, len(numbers.panels), squeeze=False)[0]
    for ax, panel in zip(axes, numbers.panels, strict=True):
        _draw_panel(ax, panel, numbers)
    axes[0].set_ylabel("Weber contrast needed  W = |\u0394E| / E")
    _legend(figure, numbers)
    return figure


def _draw_panel(ax: Axes, panel: Panel, numbers: WeberNumbers) -> None:
    colour = style.POLARITY_COLOURS[panel.polarity]
    for points in panel.points:
        _draw_points(ax, points, colour, numbers)
    highest = max(float(p.weber.max()) for p in panel.points)
    tallest = max(float(np.nanmax(p.high)) for p in panel.points)
    top = _ROOM * min(max(tallest, highest), _TALL * highest)
    for line in panel.lines:
        _, look, width = _LINES[line.name]
        start = max(numbers.x_ends[0], line.crossing) if math.isfinite(line.crossing) else 0.0
        x = np.array([start, numbers.x_ends[1]])
        ax.plot(x, line.at(x), color=colour, linestyle=look, linewidth=width, zorder=2)
    ax.set_xlim(*numbers.x_ends)
    ax.set_ylim(-0.06 * top, top)
    ax.axhline(0.0, color=style.MUTED, linewidth=0.8, zorder=1)
    ax.axvline(0.0, color=style.MUTED, linewidth=0.8, zorder=1)
    _mark_dark_light(ax, panel, numbers)
    ax.set_xlabel("1 / illuminance on chip  (1/lux)")
    _level_axis(ax, numbers)
    ax.set_title(polarity_label(panel.polarity), loc="left", fontweight="bold", pad=8)


def _draw_points(ax: Axes, points: Points, colour: str, numbers: WeberNumbers) -> None:
    marker = next(m for name, _, m in _READINGS if name == points.reading)
    # Bars of the two readings reach into each other: they stand side by side.
    beside = _BESIDE if points.reading == "intercept" else -_BESIDE
    x = points.inverse_lux + beside * (numbers.x_ends[1] - numbers.x_ends[0]) * len(numbers.panels)
    style.bars(ax, x, points.low, points.high, colour)
    for behind in (False, True):
        mine = points.filtered == behind
        ax.plot(
            x[mine], points.weber[mine], linestyle="", marker=marker, color=colour,
            markersize=_RING if behind else 5.0, markerfacecolor="white" if behind else colour, markeredgewidth=1.2,
            zorder=3 if behind else 4,
        )  # fmt: skip


def _mark_dark_light(ax: Axes, panel: Panel, numbers: WeberNumbers) -> None:
    """Mark where the best line meets 0, and write beside it what dark light that is."""
    if not panel.lines:
        _note(ax, "no line: the levels do not tell\na threshold of this polarity")
        return
    best = panel.lines[0]
    text = f"E$_d$ = {lux_interval(best.dark_lux)}\n{_LINES[best.name][0]}"
    if not numbers.x_ends[0] < best.crossing < 0.0:
        where = "left of this axis" if best.crossing < 0.0 else "nowhere left of all light"
        _note(ax, f"{text}\nmeets 0 {where}")
        return
    colour = style.POLARITY_COLOURS[panel.polarity]
    low, high = best.dark_lux.low, best.dark_lux.high
    if high > 0.0:
        ends = (numbers.x_ends[0] if low <= 0.0 else max(-1.0 / low, numbers.x_ends[0]), -1.0 / high)
        ax.hlines(0.0, *ends, color=colour, linewidth=3.0, alpha=0.55, zorder=3)
    ax.plot([best.crossing], [0.0], linestyle="", marker="D", color=colour, markersize=5.5, zorder=5)
    note = _note(ax, f"{text}\nmeets 0 at 1/E = \u22121/E$_d$")
    ax.annotate(
        "", xy=(best.crossing, 0.0), xytext=(best.crossing, _BELOW_NOTE), textcoords=("data", "axes fraction"),
        arrowprops={"arrowstyle": "->", "color": style.MUTED, "linewidth": 0.9, "shrinkB": 5.0},
        zorder=note.get_zorder() - 0.1,
    )  # fmt: skip


def _note(ax: Axes, text: str) -> Text:
    return ax.text(
        0.02, 0.97, text, transform=ax.transAxes, ha="left", va="top", fontsize=8.5, linespacing=1.4, zorder=6,
        bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 1.5},
    )  # fmt: skip


def _level_axis(ax: Axes, numbers: WeberNumbers) -> None:
    """Add an upper axis that names the light levels; the bright ones are too near to each other to be named all."""
    room = _TICK_ROOM * (numbers.x_ends[1] - numbers.x_ends[0]) * len(numbers.panels) / 2.0
    kept: list[float] = []
    for lux in numbers.levels_lux:
        if all(abs(1.0 / lux - 1.0 / other) >= room for other in kept):
            kept.append(lux)
    top = ax.secondary_xaxis("top")
    top.set_xticks([1.0 / lux for lux in kept], [lux_label(lux) for lux in kept])
    top.minorticks_off()


def _legend(figure: Figure, numbers: WeberNumbers) -> None:
    from matplotlib.lines import Line2D

    readings = {p.reading for panel in numbers.panels for p in panel.points}
    lines = {line.name for panel in numbers.panels for line in panel.lines}
    handles = [
        Line2D([], [], linestyle="", marker=marker, color=style.INK, markersize=5.5, label=label)
        for name, label, marker in _READINGS
        if name in readings
    ]
    if any(bool(p.filtered.any()) for panel in numbers.panels for p in panel.points):
        handles.append(
            Line2D([], [], linestyle="", marker="o", color=style.INK, markerfacecolor="white", markersize=5.5,
                   label="open: behind a filter")
        )  # fmt: skip
    handles += [
        Line2D([], [], linestyle=look, linewidth=width, color=style.INK, label=label)
        for name, (label, look, width) in _LINES.items()
        if name in lines
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, handlelength=2.6)
