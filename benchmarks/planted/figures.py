"""Figures of the study: what is found, by size, and what is taken for what."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from bench.report.figures import style
from benchmarks.planted.numbers import NOTHING, SEEN, UNEXPLAINED

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

    from benchmarks.planted.numbers import Bin, Tried

__all__ = ["draw_confusion", "draw_detection"]

_COLOUR: Final = style.POLARITY_COLOURS["on"]
_WRONG: Final = style.POLARITY_COLOURS["off"]
_LEAST: Final = 0.5  #: smaller sizes are drawn here
_MARGIN: Final = 0.13
_BEHIND: Final = {"facecolor": "white", "edgecolor": "none", "pad": 0.8}


def draw_detection(bins: Sequence[Bin], cases: Sequence[Tried]) -> Figure:
    """Draw the share of single effects that are named first against their size, and each case as a mark."""
    figure = style.new_figure(4.0)
    ax = figure.subplots()
    single = [c for c in cases if c.kind == "single"]
    for right, place, colour, label in ((True, 1.0 + _MARGIN, _COLOUR, "a case that is named first"),
                                        (False, -_MARGIN, _WRONG, "a case that is not")):  # fmt: skip
        sizes = [max(c.smallest, _LEAST) for c in single if c.score.first_right is right]
        ax.plot(sizes, np.full(len(sizes), place), "|", color=colour, markersize=9, label=label, clip_on=False)
    x = [max(b.middle, _LEAST) for b in bins]
    ends = np.array([b.found.interval for b in bins]).reshape(-1, 2)
    style.bars(ax, x, ends[:, 0], ends[:, 1], style.INK)
    shares = [b.found.k / b.found.n for b in bins]
    ax.plot(x, shares, "o-", color=style.INK, label="share, with its 95 % interval")
    for place, share, one in zip(x, shares, bins, strict=True):
        # Intervals go inwards from none and from all, so there is room on the other side.
        aside = (0, 9) if share > 0.5 else (0, -9)
        ax.annotate(f"{one.found.k}/{one.found.n}", (place, share), aside, textcoords="offset points", ha="center",
                    va="center", fontsize=7.5, color=style.MUTED, bbox=_BEHIND)  # fmt: skip
    ax.axvline(SEEN, color=style.MUTED, linewidth=0.8, linestyle="--")
    ax.axhline(0.95, color=style.MUTED, linewidth=0.8, linestyle=":")
    ax.set_xscale("log")
    ticks = style.log_axis_ticks(*ax.get_xlim())
    ax.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    ax.minorticks_off()
    ax.set_xlabel("size of the effect (standard errors)")
    ax.set_ylabel("named first")
    ax.set_ylim(-0.19, 1.19)
    ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.02), ncols=3)
    return figure


def draw_confusion(found: Mapping[tuple[str, str], int]) -> Figure:
    """Draw what was named first of each single effect that is large enough; its tied group counts as right."""
    rows = sorted({planted for planted, _ in found})
    others = sorted({named for _, named in found} - set(rows) - {NOTHING, UNEXPLAINED})
    columns = [*rows, *others, UNEXPLAINED, NOTHING]
    figure = style.new_figure(1.6 + 0.27 * len(rows))
    ax = figure.subplots()
    ax.grid(visible=False)
    for y, planted in enumerate(rows):
        total = sum(n for (p, _), n in found.items() if p == planted)
        for x, named in enumerate(columns):
            n = found.get((planted, named), 0)
            if n:
                colour = _COLOUR if planted == named else _WRONG
                ax.add_patch(_cell(x, y, colour, n / total))
                ax.text(x, y, str(n), ha="center", va="center", fontsize=8)
    ax.set_xlim(-0.5, len(columns) - 0.5)
    ax.set_ylim(max(len(rows), 1) - 0.5, -0.5)
    ax.set_xticks(range(len(columns)), [c.replace("_", " ") for c in columns], rotation=55, ha="right", fontsize=7.5)
    ax.set_yticks(range(len(rows)), [r.replace("_", " ") for r in rows], fontsize=7.5)
    ax.set_xlabel("named first")
    ax.set_ylabel("planted")
    return figure


def _cell(x: int, y: int, colour: str, share: float) -> Rectangle:
    from matplotlib.patches import Rectangle

    return Rectangle((x - 0.5, y - 0.5), 1.0, 1.0, facecolor=colour, alpha=0.15 + 0.45 * share, linewidth=0)
