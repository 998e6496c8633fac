"""A run beside a model of it: measured against expected responses, and what is left in standard errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bench.report.figures import style
from bench.report.wording import polarity_label

if TYPE_CHECKING:
    import numpy.typing as npt
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bench.analysis.results import ResponsePolarity
    from bench.models.comparison import Comparison

__all__ = ["AgreementNumbers", "Responses", "draw", "prepare"]

_FAR: Final = 3.0  # standard errors
_LEAST_RANGE: Final = 3.6  # of the axis of residuals, standard errors
_SHIFT_LN: Final = 0.006  # ON and OFF stand side by side at the same contrast


@dataclass(frozen=True, slots=True)
class Responses:
    """The responses of one polarity."""

    polarity: ResponsePolarity
    contrast: npt.NDArray[np.float64]  #: (n,) ln
    measured: npt.NDArray[np.float64]  #: (n,)
    expected: npt.NDArray[np.float64]  #: (n,)
    error: npt.NDArray[np.float64]  #: (n,) of the difference
    informative: npt.NDArray[np.bool_]  #: (n,) neither almost never nor almost always answered

    @property
    def z(self) -> npt.NDArray[np.float64]:
        """(n,) measured minus expected, in standard errors."""
        return (self.measured - self.expected) / self.error


@dataclass(frozen=True, slots=True)
class AgreementNumbers:
    """All that the figure shows."""

    responses: tuple[Responses, ...]
    largest: float  #: largest |z|


def prepare(comparison: Comparison) -> AgreementNumbers | None:
    """Return the numbers of the figure, or None where the run has no responses."""
    found: list[Responses] = []
    polarities: tuple[ResponsePolarity, ...] = ("on", "off")
    for polarity in polarities:
        mine = [p for p in comparison.points if p.view == f"response_{polarity}"]
        if mine:
            columns = [[p.log_contrast, p.measured, p.expected, p.error] for p in mine]
            contrast, measured, expected, error = np.array(columns).T
            informative = np.array([p.informative for p in mine])
            found.append(Responses(polarity, contrast, measured, expected, error, informative))
    if not found:
        return None
    return AgreementNumbers(tuple(found), max(float(np.abs(r.z).max()) for r in found))


def draw(numbers: AgreementNumbers) -> Figure:
    """Draw measured against expected on the left, the residuals against contrast on the right."""
    figure = style.new_figure(3.6)
    against, residuals = figure.subplots(1, 2, width_ratios=[1.0, 1.35])
    _draw_against(against, numbers)
    _draw_residuals(residuals, numbers)
    _legend(figure, numbers)
    return figure


def _look(responses: Responses, *, informative: bool) -> dict[str, Any]:
    colour = style.POLARITY_COLOURS[responses.polarity]
    return {
        "linestyle": "",
        "marker": style.POLARITY_MARKERS[responses.polarity],
        "markersize": 5.0,
        "color": colour,
        "markerfacecolor": colour if informative else "white",
        "markeredgewidth": 0.9,
    }


def _draw_against(ax: Axes, numbers: AgreementNumbers) -> None:
    ax.plot([0.0, 1.0], [0.0, 1.0], color=style.MUTED, linewidth=1.0, zorder=1)
    for item in numbers.responses:
        reach = _FAR * item.error
        style.bars(
            ax, item.expected, item.measured - reach, item.measured + reach, style.POLARITY_COLOURS[item.polarity]
        )
        for informative in (False, True):
            chosen = item.informative == informative
            ax.plot(item.expected[chosen], item.measured[chosen], **_look(item, informative=informative), zorder=3)
    ax.set_xlim(-0.03, 1.03)
    ax.set_ylim(-0.03, 1.03)
    ax.set_aspect("equal")
    ax.set_xlabel("expected response probability")
    ax.set_ylabel("measured response probability")


def _draw_residuals(ax: Axes, numbers: AgreementNumbers) -> None:
    for level in (-_FAR, _FAR):
        ax.axhline(level, color=style.INK, linewidth=1.0, linestyle="--", zorder=1)
    ax.axhline(0.0, color=style.MUTED, linewidth=1.0, zorder=1)
    for item in numbers.responses:
        x = item.contrast + (_SHIFT_LN if item.polarity == "on" else -_SHIFT_LN)
        for informative in (False, True):
            chosen = item.informative == informative
            ax.plot(x[chosen], item.z[chosen], **_look(item, informative=informative), zorder=3)
    reach = max(_LEAST_RANGE, 1.08 * numbers.largest)
    ax.set_ylim(-reach, reach)
    style.contrast_axis(ax)
    ax.set_ylabel("measured \u2212 expected (standard errors)")


def _legend(figure: Figure, numbers: AgreementNumbers) -> None:
    from matplotlib.lines import Line2D

    handles = [
        Line2D([], [], **_look(item, informative=True), label=polarity_label(item.polarity))
        for item in numbers.responses
    ]
    handles += [
        Line2D([], [], **{**_look(numbers.responses[0], informative=False), "marker": "o", "color": style.INK},
               label="expected below 0.02 or above 0.98"),
        Line2D([], [], color=style.INK, linewidth=1.0, linestyle="--", label="3 standard errors"),
    ]  # fmt: skip
    figure.legend(handles=handles, loc="outside lower center", ncols=4, handlelength=1.8)
