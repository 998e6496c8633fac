"""Every statistic of a run against what a model expects of it, view by view."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np

from bench.report.figures import style
from bench.report.wording import polarity_label

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import numpy.typing as npt
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bench.diagnosis.comparison import Residual
    from bench.diagnosis.views.base import Part

__all__ = ["MeasuredPredictedNumbers", "Panel", "Side", "draw", "prepare"]

_COLUMNS: Final = 3
_ROW_IN: Final = 2.6
_TITLE_LETTERS: Final = 34
_TICKS: Final = 4
#: Half of a 90 % interval, in standard errors.
_HALF: Final = 1.645
#: An axis is logarithmic where all numbers are above zero, and the largest is so many times the smallest.
_FAR_APART: Final = 30.0
_ROOM: Final = 0.06
_PARTS: Final[tuple[Part, ...]] = ("on", "off", "both")


@dataclass(frozen=True, slots=True)
class Side:
    """The statistics of one polarity, or of both together."""

    part: Part
    measured: npt.NDArray[np.float64]  #: (n,)
    expected: npt.NDArray[np.float64]  #: (n,)
    sd: npt.NDArray[np.float64]  #: (n,) standard error of the difference


@dataclass(frozen=True, slots=True)
class Panel:
    """One view."""

    title: str
    sides: tuple[Side, ...]
    scale: Literal["linear", "log"]
    low: float  #: ends of both axes
    high: float


@dataclass(frozen=True, slots=True)
class MeasuredPredictedNumbers:
    """All that the figure shows."""

    panels: tuple[Panel, ...]


def prepare(residuals: Sequence[Residual], titles: Mapping[str, str]) -> MeasuredPredictedNumbers | None:
    """Return the numbers of the figure, or None where there is no residual.

    Parameters
    ----------
    titles
        What each view shows, by its id.
    """
    known = [r for r in residuals if np.all(np.isfinite([r.observed, r.predicted, r.sigma]))]
    views = dict.fromkeys(r.view for r in known)
    panels = [_panel(titles.get(v, v.replace("_", " ")), [r for r in known if r.view == v]) for v in views]
    return MeasuredPredictedNumbers(tuple(panels)) if panels else None


def _panel(title: str, mine: Sequence[Residual]) -> Panel:
    sides = []
    for part in _PARTS:
        numbers = [(r.observed, r.predicted, r.sigma) for r in mine if r.part == part]
        if numbers:
            sides.append(Side(part, *np.array(numbers, np.float64).T))
    ends = np.concatenate([e for s in sides for e in (s.measured, s.expected)])
    low, high = float(ends.min()), float(ends.max())
    if low > 0.0 and high > _FAR_APART * low:
        return Panel(title, tuple(sides), "log", *style.spread_over((low, high)))
    room = _ROOM * (high - low) or max(*(float(s.sd.max()) for s in sides), 1e-6 * abs(high), 1e-12)
    return Panel(title, tuple(sides), "linear", low - room, high + room)


def draw(numbers: MeasuredPredictedNumbers) -> Figure:
    """Draw one panel for each view, measured upwards, expected to the right."""
    rows = -(-len(numbers.panels) // _COLUMNS)
    figure = style.new_figure(_ROW_IN * rows + 0.4)
    axes = figure.subplots(rows, _COLUMNS, squeeze=False).ravel()
    for place, (ax, panel) in enumerate(zip(axes, numbers.panels, strict=False)):
        _draw_panel(ax, panel)
        if place % _COLUMNS == 0:
            ax.set_ylabel("measured")
        if place + _COLUMNS >= len(numbers.panels):
            ax.set_xlabel("model")
    for ax in axes[len(numbers.panels) :]:
        ax.set_visible(False)
    _legend(figure, {side.part for panel in numbers.panels for side in panel.sides})
    return figure


def _draw_panel(ax: Axes, panel: Panel) -> None:
    from matplotlib.ticker import MaxNLocator

    ends = (panel.low, panel.high)
    ax.plot(ends, ends, color=style.MUTED, linewidth=1.0, zorder=1)
    for side in panel.sides:
        half = _HALF * side.sd
        look = _look(side.part)
        style.bars(ax, side.expected, side.measured - half, side.measured + half, look["color"])
        ax.plot(side.expected, side.measured, **look, zorder=3)
    ax.set_xlim(ends)
    ax.set_ylim(ends)
    if panel.scale == "log":
        style.plain_log_axis(ax)
        ax.set_xscale("log")
        ax.set_xlim(ends)
        ax.set_xticks(ax.get_yticks(), [label.get_text() for label in ax.get_yticklabels()])
        ax.minorticks_off()
    else:
        for axis in (ax.xaxis, ax.yaxis):
            axis.set_major_locator(MaxNLocator(_TICKS))
            axis.get_major_formatter().set_powerlimits((-3, 4))  # type: ignore[attr-defined]
    ax.set_title(textwrap.fill(panel.title, _TITLE_LETTERS), loc="left", fontsize=9.0)


def _look(part: Part) -> dict[str, Any]:
    colour = style.POLARITY_COLOURS.get(part, style.INK)
    return {
        "linestyle": "",
        "marker": style.POLARITY_MARKERS.get(part, "o"),
        "markersize": 3.8,
        "color": colour,
        "markeredgewidth": 0.0,
    }


def _legend(figure: Figure, parts: set[Part]) -> None:
    from matplotlib.lines import Line2D

    handles = [
        Line2D([], [], **_look(p), label="both polarities" if p == "both" else polarity_label(p))
        for p in _PARTS if p in parts
    ]  # fmt: skip
    handles.append(Line2D([], [], color=style.MUTED, linewidth=1.0, label="as the model says"))
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), handlelength=1.8)
