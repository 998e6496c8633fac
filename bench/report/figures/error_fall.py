"""How the error of a model falls from step to step, as effects are added."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.report.figures import style

if TYPE_CHECKING:
    import numpy.typing as npt
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bench.diagnosis.result import Outcome

__all__ = ["ErrorFallNumbers", "draw", "prepare"]

_START: Final = "start"
#: The axis of the error reaches at least from here to there.
_LEAST_SPAN: Final = (0.7, 3.0)


@dataclass(frozen=True, slots=True)
class ErrorFallNumbers:
    """All that the figure shows."""

    labels: tuple[str, ...]  #: of the steps
    error: npt.NDArray[np.float64]  #: (n,) deviance per degree of freedom
    unseen: npt.NDArray[np.float64]  #: (n,) on points that the fit did not see
    response_rms: npt.NDArray[np.float64]  #: (n,)


def prepare(outcome: Outcome) -> ErrorFallNumbers | None:
    """Return the numbers of the figure, or None where no model was fitted."""
    if not outcome.steps:
        return None
    errors = [s.error for s in outcome.steps]
    return ErrorFallNumbers(
        tuple(_START if s.added is None else f"+ {s.added.replace('_', ' ')}" for s in outcome.steps),
        np.array([e.deviance_per_dof for e in errors], np.float64),
        np.array([e.heldout_deviance_per_dof for e in errors], np.float64),
        np.array([e.response_rmse for e in errors], np.float64),
    )


def draw(numbers: ErrorFallNumbers) -> Figure:
    """Draw the error on the left, the rms of the response on the right."""
    figure = style.new_figure(3.3)
    error, rms = figure.subplots(1, 2, width_ratios=[1.4, 1.0])
    x = np.arange(len(numbers.labels))
    error.axhline(1.0, color=style.MUTED, linestyle="--", linewidth=1.0, label="a true model")
    error.plot(x, numbers.error, color=style.INK, **style.point(0, style.INK), label="error of the fit")
    orange = style.POLARITY_COLOURS["off"]
    error.plot(x, numbers.unseen, color=orange, linestyle=":", **style.point(1, orange), label="on unseen points")
    known = np.concatenate([numbers.error, numbers.unseen])
    known = known[np.isfinite(known) & (known > 0.0)]
    error.set_ylim(min(_LEAST_SPAN[0], 0.8 * known.min()), max(_LEAST_SPAN[1], 1.5 * known.max()))
    style.plain_log_axis(error)
    error.set_ylabel("deviance per degree of freedom")
    error.legend(loc="upper right")
    rms.plot(x, numbers.response_rms, color=style.INK, **style.point(0, style.INK))
    rms.set_ylim(bottom=0.0)
    rms.set_ylabel("rms of measured \u2212 predicted response")
    for ax in (error, rms):
        _steps_axis(ax, numbers.labels)
    return figure


def _steps_axis(ax: Axes, labels: tuple[str, ...]) -> None:
    ax.set_xlim(-0.4, len(labels) - 0.6)
    ax.set_xticks(range(len(labels)), labels, rotation=20, ha="right", rotation_mode="anchor")
