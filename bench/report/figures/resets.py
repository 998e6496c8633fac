"""How well a reset/test measurement was set up: resets that were answered, floor and plateau of each curve."""

from __future__ import annotations

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

    from bench.analysis.results import Estimate, ResponsePolarity, ResponseRow, SCurve
    from bench.report.families import Family

__all__ = ["ENOUGH_RESETS", "Answered", "Ends", "ResetNumbers", "draw", "prepare"]

ENOUGH_RESETS: Final = 0.95
_LEAST_RANGE: Final = 0.06


@dataclass(frozen=True, slots=True)
class Answered:
    """Share of answered resets of one step and polarity, ascending in contrast."""

    polarity: ResponsePolarity
    step: int
    contrast: npt.NDArray[np.float64]  #: (n,) ln
    share: npt.NDArray[np.float64]  #: (n,)


@dataclass(frozen=True, slots=True)
class Ends:
    """Floor and plateau of one curve."""

    polarity: ResponsePolarity
    step: int
    floor: Estimate
    plateau: Estimate


@dataclass(frozen=True, slots=True)
class ResetNumbers:
    """All that the figure shows."""

    labels: tuple[str, ...]  #: of the steps
    polarities: tuple[ResponsePolarity, ...]
    answered: tuple[Answered, ...]
    ends: tuple[Ends, ...]
    lowest_share: float


def prepare(rows: Sequence[ResponseRow], curves: Sequence[SCurve], family: Family) -> ResetNumbers | None:
    """Return the numbers of the figure, or None where the family has no resets."""
    groups: dict[tuple[ResponsePolarity, int], list[tuple[float, float]]] = {}
    for row in rows:
        step = family.step_of(row.key)
        if step is not None and np.isfinite(row.answered_resets):
            groups.setdefault((row.key.polarity, step.index), []).append((row.log_contrast, row.answered_resets))
    if not groups:
        return None
    answered = []
    for (polarity, index), pairs in sorted(groups.items(), key=lambda item: (item[0][0] != "on", item[0][1])):
        contrast, share = np.array(sorted(pairs), np.float64).T
        answered.append(Answered(polarity, index, contrast, share))
    ends = [
        Ends(curve.key.polarity, step.index, curve.floor, curve.plateau)
        for curve in curves
        if (step := family.step_of(curve.key)) is not None
    ]
    return ResetNumbers(
        labels=tuple(step.label for step in family.steps),
        polarities=tuple(dict.fromkeys(item.polarity for item in answered)),
        answered=tuple(answered),
        ends=tuple(ends),
        lowest_share=min(float(item.share.min()) for item in answered),
    )


def draw(numbers: ResetNumbers) -> Figure:
    """Draw answered resets above, floors and plateaus below, one column for each polarity."""
    rows_in = 0.24 * len(numbers.labels) + 0.5
    figure = style.new_figure(2.3 + rows_in + 1.0)
    axes = figure.subplots(2, len(numbers.polarities), sharey="row", squeeze=False, height_ratios=[2.3, rows_in])
    for column, polarity in enumerate(numbers.polarities):
        _draw_answered(axes[0, column], [a for a in numbers.answered if a.polarity == polarity], numbers)
        _draw_ends(axes[1, column], [e for e in numbers.ends if e.polarity == polarity], numbers)
        axes[0, column].set_title(polarity_label(polarity), loc="left", fontweight="bold")
    axes[0, 0].set_ylabel("share of resets answered")
    _legend(figure, numbers)
    return figure


def _draw_answered(ax: Axes, members: Sequence[Answered], numbers: ResetNumbers) -> None:
    for item in members:
        colour = style.step_colour(item.step, len(numbers.labels))
        ax.plot(item.contrast, item.share, color=colour, linewidth=0.8, **style.point(item.step, colour))
    ax.axhline(ENOUGH_RESETS, color=style.INK, linewidth=1.0, linestyle="--")
    room = max(_LEAST_RANGE, 1.0 - numbers.lowest_share)
    ax.set_ylim(max(-0.03, 1.0 - 1.1 * room), 1.0 + 0.05 * room)
    style.contrast_axis(ax)


def _draw_ends(ax: Axes, members: Sequence[Ends], numbers: ResetNumbers) -> None:
    for item in members:
        colour = style.step_colour(item.step, len(numbers.labels))
        for end, marker, face in ((item.floor, "v", "white"), (item.plateau, "^", colour)):
            style.bars(ax, item.step, end.low, end.high, colour, horizontal=True)
            ax.plot([end.value], [item.step], linestyle="", marker=marker, markersize=5.5, color=colour,
                    markerfacecolor=face, markeredgewidth=1.2)  # fmt: skip
    ax.set_xlim(-0.03, 1.03)
    ax.set_ylim(len(numbers.labels) - 0.4, -0.6)
    ax.set_yticks(range(len(numbers.labels)), numbers.labels)
    ax.tick_params(axis="y", length=0)
    ax.grid(visible=False, axis="y")
    ax.set_xlabel("floor and plateau (probability)")


def _legend(figure: Figure, numbers: ResetNumbers) -> None:
    from matplotlib.lines import Line2D

    total = len(numbers.labels)
    handles = [
        Line2D([], [], linewidth=0.8, label=label, color=style.step_colour(i, total),
               **style.point(i, style.step_colour(i, total)))
        for i, label in enumerate(numbers.labels)
    ]  # fmt: skip
    handles += [
        Line2D([], [], color=style.INK, linewidth=1.0, linestyle="--", label="95 %"),
        Line2D(
            [], [], linestyle="", marker="v", markersize=5.5, color=style.INK, markerfacecolor="white", label="floor"
        ),
        Line2D([], [], linestyle="", marker="^", markersize=5.5, color=style.INK, label="plateau"),
    ]
    figure.legend(handles=handles, loc="outside right upper", labelspacing=0.55, handlelength=1.8)
