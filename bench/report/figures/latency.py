"""Latencies: how long after the edge of its pulse a pixel sends its first event."""

from __future__ import annotations

from collections import Counter
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

    from bench.analysis.results import ResponsePolarity, ResponseRow
    from bench.report.families import Family

__all__ = ["Latencies", "LatencyNumbers", "draw", "prepare"]

_STRAY: Final = 5e-4  # share of answers that may lie beyond either end of the axis
_FEWEST_ANSWERS: Final = 10  # a median of fewer says little


@dataclass(frozen=True, slots=True)
class Latencies:
    """The latencies of one step and polarity."""

    polarity: ResponsePolarity
    step: int
    edges_s: npt.NDArray[np.float64]  #: (b + 1,)
    counts: npt.NDArray[np.int64]  #: (b,) first events, all contrasts together
    share: npt.NDArray[np.float64]  #: (b,) of all first events, per decade of latency
    contrast: npt.NDArray[np.float64]  #: (n,) ln; contrasts with ten answers or more
    median_s: npt.NDArray[np.float64]  #: (n,)


@dataclass(frozen=True, slots=True)
class LatencyNumbers:
    """All that the figure shows."""

    labels: tuple[str, ...]  #: of the steps
    panels: tuple[tuple[ResponsePolarity, tuple[Latencies, ...]], ...]
    shortest_s: float  #: ends of the latency axis
    longest_s: float


def prepare(rows: Sequence[ResponseRow], family: Family) -> LatencyNumbers | None:
    """Return the numbers of the figure of one family, or None where nothing was answered."""
    panels: list[tuple[ResponsePolarity, tuple[Latencies, ...]]] = []
    polarities: tuple[ResponsePolarity, ResponsePolarity] = ("on", "off")
    for polarity in polarities:
        groups: dict[int, list[ResponseRow]] = {}
        for row in rows:
            step = family.step_of(row.key)
            if row.key.polarity == polarity and step is not None and row.latency_counts.sum() > 0:
                groups.setdefault(step.index, []).append(row)
        if groups:
            panels.append((polarity, tuple(_latencies(polarity, step, groups[step]) for step in sorted(groups))))
    if not panels:
        return None
    filled = [_filled(item) for _, members in panels for item in members]
    shortest = min(low for low, _ in filled)
    return LatencyNumbers(
        tuple(step.label for step in family.steps), tuple(panels), shortest, max(high for _, high in filled)
    )


def _latencies(polarity: ResponsePolarity, step: int, rows: Sequence[ResponseRow]) -> Latencies:
    """Add up the rows that share the most common bins; the same window gives the same bins."""
    common, _ = Counter(tuple(row.latency_edges_s.tolist()) for row in rows).most_common(1)[0]
    edges = np.array(common, np.float64)
    counts = np.sum([r.latency_counts for r in rows if tuple(r.latency_edges_s.tolist()) == common], axis=0)
    many = sorted(
        (row for row in rows if row.responses >= _FEWEST_ANSWERS and np.isfinite(row.latency_median_s)),
        key=lambda row: row.log_contrast,
    )
    return Latencies(
        polarity=polarity,
        step=step,
        edges_s=edges,
        counts=counts.astype(np.int64),
        share=counts / counts.sum() / np.diff(np.log10(_open_end(edges))),
        contrast=np.array([row.log_contrast for row in many]),
        median_s=np.array([row.latency_median_s for row in many]),
    )


def _open_end(edges_s: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return the edges with a first one above 0, for a logarithmic axis: a decade below the second."""
    edges = edges_s.copy()
    if edges[0] <= 0.0:
        edges[0] = 0.1 * edges[1]
    return edges


def _filled(item: Latencies) -> tuple[float, float]:
    """Return the ends of the bins that hold nearly all answers: a few stray ones do not stretch the axis."""
    edges, cumulative = _open_end(item.edges_s), np.cumsum(item.counts) / item.counts.sum()
    first = int(np.argmax(cumulative > _STRAY))
    last = int(np.argmax(cumulative >= 1.0 - _STRAY))
    return float(edges[first]), float(edges[last + 1])


def draw(numbers: LatencyNumbers) -> Figure:
    """Draw histograms above and medians against contrast below, one column for each polarity."""
    figure = style.new_figure(5.6)
    axes = figure.subplots(2, len(numbers.panels), sharey="row", squeeze=False)
    for column, (polarity, members) in enumerate(numbers.panels):
        for item in members:
            _draw_histogram(axes[0, column], item, len(numbers.labels))
            _draw_medians(axes[1, column], item, len(numbers.labels))
        axes[0, column].set_title(polarity_label(polarity), loc="left", fontweight="bold")
        _latency_scale(axes[0, column], numbers)
        style.contrast_axis(axes[1, column])
    axes[0, 0].set_ylabel("share of first events\nper decade of latency")
    axes[0, 0].set_ylim(bottom=0.0)
    axes[1, 0].set_yscale("log")
    _median_scale(axes[1, 0], numbers)
    _legend(figure, numbers)
    return figure


def _draw_histogram(ax: Axes, item: Latencies, steps: int) -> None:
    colour = style.step_colour(item.step, steps)
    ax.stairs(item.share, _open_end(item.edges_s), color=colour, linewidth=1.2)
    peak = int(np.argmax(item.share))
    middle = float(np.sqrt(np.prod(_open_end(item.edges_s)[peak : peak + 2])))
    ax.plot([middle], [item.share[peak]], linestyle="", **style.point(item.step, colour))


def _draw_medians(ax: Axes, item: Latencies, steps: int) -> None:
    colour = style.step_colour(item.step, steps)
    ax.plot(item.contrast, item.median_s, color=colour, linewidth=0.9, **style.point(item.step, colour))


def _latency_scale(ax: Axes, numbers: LatencyNumbers) -> None:
    low, high = numbers.shortest_s / 1.15, numbers.longest_s * 1.15
    ax.set_xscale("log")
    ax.set_xlim(low, high)
    ticks = style.log_axis_ticks(low, high).tolist()
    ax.set_xticks(ticks, [duration_label(tick) for tick in ticks])
    ax.minorticks_off()
    ax.set_xlabel("latency of the first event")


def _median_scale(ax: Axes, numbers: LatencyNumbers) -> None:
    medians = [m for _, members in numbers.panels for item in members for m in item.median_s.tolist() if m > 0.0]
    if medians:
        low, high = min(medians) / 1.25, max(medians) * 1.25
        ax.set_ylim(low, high)
        ticks = style.log_axis_ticks(low, high).tolist()
        ax.set_yticks(ticks, [duration_label(tick) for tick in ticks])
    ax.minorticks_off()
    ax.set_ylabel("median latency")


def _legend(figure: Figure, numbers: LatencyNumbers) -> None:
    from matplotlib.lines import Line2D

    total = len(numbers.labels)
    handles = [
        Line2D([], [], label=label, color=style.step_colour(i, total), **style.point(i, style.step_colour(i, total)))
        for i, label in enumerate(numbers.labels)
    ]
    figure.legend(handles=handles, loc="outside right upper", labelspacing=0.55, handlelength=1.8)
