"""How far a model is off at each value of each independent variable, at every step of a diagnosis."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.telling.axis_wording import axis_title, bin_label
from bench.diagnosis.telling.by_axis import ALL_VIEWS, AXES
from bench.report.figures import style

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import numpy.typing as npt
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bench.diagnosis.telling.by_axis import Bin

__all__ = ["Panel", "ResidualAxesNumbers", "draw", "prepare"]

_COLUMNS: Final = 2
_ROW_IN: Final = 2.5
_FEWEST: Final = 2
#: The band of chance, in standard errors of the mean square.
_BAND: Final = 2.0
_LONG_LABEL: Final = 7
_LOWEST: Final = 0.3
_LEAST_TOP: Final = 4.0


@dataclass(frozen=True, slots=True)
class Panel:
    """One axis."""

    title: str
    labels: tuple[str, ...]  #: of the bins
    rms: tuple[npt.NDArray[np.float64], ...]  #: (bins,) of each step, in standard errors
    low: npt.NDArray[np.float64]  #: (bins,) where a true model is
    high: npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ResidualAxesNumbers:
    """All that the figure shows."""

    panels: tuple[Panel, ...]
    steps: tuple[str, ...]


def prepare(bins: Mapping[int, Sequence[Bin]], labels: Mapping[int, str]) -> ResidualAxesNumbers | None:
    """Return the numbers of the figure, or None where nothing was varied.

    Parameters
    ----------
    bins
        By the number of the step.
    labels
        What each step is called.
    """
    panels = [p for axis in AXES if (p := _panel(axis, list(bins.values()))) is not None]
    return ResidualAxesNumbers(tuple(panels), tuple(labels[n] for n in bins)) if panels else None


def _panel(axis: str, steps: Sequence[Sequence[Bin]]) -> Panel | None:
    mine = [[b for b in bins if b.axis == axis and b.view == ALL_VIEWS] for bins in steps]
    if not mine or len(mine[0]) < _FEWEST or any(len(m) != len(mine[0]) for m in mine):
        return None
    sd = np.array([b.square_sd for b in mine[0]])
    return Panel(
        axis_title(axis),
        tuple(bin_label(b) for b in mine[0]),
        tuple(np.array([math.sqrt(b.square) for b in m]) for m in mine),
        np.sqrt(np.maximum(1.0 - _BAND * sd, 0.0)),
        np.sqrt(1.0 + _BAND * sd),
    )


def draw(numbers: ResidualAxesNumbers) -> Figure:
    """Draw one panel for each axis, one colour for each step."""
    rows = -(-len(numbers.panels) // _COLUMNS)
    figure = style.new_figure(_ROW_IN * rows + 0.4)
    axes = figure.subplots(rows, _COLUMNS, squeeze=False).ravel()
    top = max(float(r.max()) for p in numbers.panels for r in (*p.rms, p.high))
    for ax, panel in zip(axes, numbers.panels, strict=False):
        _draw_panel(ax, panel, top)
    for ax in axes[len(numbers.panels) :]:
        ax.set_visible(False)
    handles, labels = axes[0].get_legend_handles_labels()
    names = ["a true model", *numbers.steps]
    figure.legend(handles, names[: len(labels)], loc="outside lower center", ncols=min(len(names), 4))
    return figure


def _draw_panel(ax: Axes, panel: Panel, top: float) -> None:
    x = np.arange(len(panel.labels))
    edges = np.concatenate([x - 0.5, [x[-1] + 0.5]])
    ax.stairs(panel.high, edges, baseline=panel.low, fill=True, color=style.MUTED, alpha=0.25, label="chance")
    for step, rms in enumerate(panel.rms):
        colour = style.step_colour(step, len(panel.rms))
        ax.plot(x, rms, color=colour, **style.point(step, colour), label=f"{step}")
    ax.set_ylim(_LOWEST, max(1.4 * top, _LEAST_TOP))
    style.plain_log_axis(ax)
    slanted = any(len(label) > _LONG_LABEL for label in panel.labels)
    ax.set_xticks(x, panel.labels)
    if slanted:
        for label in ax.get_xticklabels():
            label.set(rotation=30, ha="right", rotation_mode="anchor")
    ax.set_title(panel.title, loc="left")
    ax.set_ylabel("rms residual (sigma)")
