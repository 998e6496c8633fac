"""Which effects were candidates at each step, and how far the error would fall with each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.report.figures import style

if TYPE_CHECKING:
    import numpy.typing as npt
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bench.diagnosis.result import Outcome, Step

__all__ = ["RankingNumbers", "Ranks", "draw", "prepare"]

_MOST: Final = 8
_COLUMNS: Final = 2
_SMALL_P: Final = 0.01
#: Where the axis begins, of the largest fall; and of what is hardly one.
_LOWEST: Final = 0.5
_LEAST: Final = 0.01
_RANGE: Final = 100.0


@dataclass(frozen=True, slots=True)
class Ranks:
    """The candidates of one step, best first."""

    title: str
    effects: tuple[str, ...]
    expected: npt.NDArray[np.float64]  #: (n,) fall of the error, without a refit
    found: npt.NDArray[np.float64]  #: (n,) after a refit; NaN where there was none
    p_value: npt.NDArray[np.float64]
    added: str | None  #: which of them was added
    tied: tuple[str, ...]  #: with that one


@dataclass(frozen=True, slots=True)
class RankingNumbers:
    """All that the figure shows."""

    steps: tuple[Ranks, ...]


def prepare(outcome: Outcome) -> RankingNumbers | None:
    """Return the numbers of the figure, or None where there were no candidates."""
    following = [*(s.added for s in outcome.steps[1:]), None]
    ranks = [_ranks(s, f, outcome) for s, f in zip(outcome.steps, following, strict=False) if s.candidates]
    return RankingNumbers(tuple(ranks)) if ranks else None


def _ranks(step: Step, added: str | None, outcome: Outcome) -> Ranks:
    drop = {c.effect: c.screen_drop if c.refit_drop is None else c.refit_drop for c in step.candidates}
    best = sorted(step.candidates, key=lambda c: (c.effect != added, -drop[c.effect]))[:_MOST]
    title = "at the start" if step.added is None else f"with {step.added.replace('_', ' ')}"
    return Ranks(
        f"step {step.number}: {title}",
        tuple(c.effect.replace("_", " ") for c in best),
        np.array([c.screen_drop for c in best], np.float64),
        np.array([np.nan if c.refit_drop is None else c.refit_drop for c in best], np.float64),
        np.array([c.p_value for c in best], np.float64),
        None if added is None else added.replace("_", " "),
        tuple(t.replace("_", " ") for t in outcome.ties.get(added or "", ())),
    )


def draw(numbers: RankingNumbers) -> Figure:
    """Draw one panel for each step."""
    from matplotlib.patches import Patch

    columns = min(_COLUMNS, len(numbers.steps))
    rows = -(-len(numbers.steps) // columns)
    most = max(len(r.effects) for r in numbers.steps)
    figure = style.new_figure((0.8 + 0.25 * most) * rows + 0.4)
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    top = max(float(np.nanmax(np.concatenate([r.expected, r.found]))) for r in numbers.steps)
    low = min(_LOWEST, max(top, _LEAST) / _RANGE)
    for ax, ranks in zip(axes, numbers.steps, strict=False):
        _draw_ranks(ax, ranks, low, top, most)
    for ax in axes[len(numbers.steps) :]:
        ax.set_visible(False)
    looks = [
        Patch(facecolor="white", edgecolor=style.INK, label="expected, by the screen"),
        Patch(facecolor=style.MUTED, label="after a refit"),
        Patch(facecolor=style.POLARITY_COLOURS["on"], label="added"),
    ]
    figure.legend(handles=looks, loc="outside lower center", ncols=3)
    return figure


def _draw_ranks(ax: Axes, ranks: Ranks, low: float, top: float, rows: int) -> None:
    y = np.arange(len(ranks.effects))
    colours = [style.POLARITY_COLOURS["on"] if e == ranks.added else style.MUTED for e in ranks.effects]
    ax.barh(y, np.maximum(np.nan_to_num(ranks.found), low), height=0.62, color=colours, alpha=0.85)
    ax.barh(y, np.maximum(ranks.expected, low), height=0.62, facecolor="none", edgecolor=style.INK, linewidth=0.9)
    ax.set_xscale("log")
    ax.set_xlim(low, max(60.0 * low, 100.0 * top))
    ax.minorticks_off()
    for place, effect, drop, p in zip(
        y, ranks.effects, np.fmax(ranks.expected, ranks.found), ranks.p_value, strict=True
    ):
        note = "p < 0.001" if p < 0.001 else f"p {p:.2g}"
        note += ", tied" if effect in ranks.tied else ""
        colour = style.INK if p < _SMALL_P else style.MUTED
        ax.text(max(drop, low) * 1.15, float(place), note, va="center", fontsize=7.5, color=colour)
    ax.set_yticks(y, ranks.effects)
    ax.set_ylim(rows - 0.4, -0.6)
    ax.set_title(ranks.title, loc="left")
    ax.set_xlabel("fall of the error, deviance per degree of freedom")
