"""S-curves side by side, with the true threshold of each."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.report.figures import style
from bench.study.claim_schema import CurveName
from bench.study.claims import true_threshold

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bench.analysis.results import SCurve
    from bench.study.figure_schema import Panel
    from bench.study.run import StudyResult

__all__ = ["draw_curves"]

_PANEL_IN: Final = 2.7
_GROWTH: Final = 0.4  #: markers of a curve are larger than those drawn over them, so that equal curves both show
_HIGHEST: Final = 0.535  #: ln; the highest amplitude of the paper


def draw_curves(result: StudyResult, panels: tuple[Panel, ...]) -> Figure | None:
    """Draw panels of S-curves, two in a row; None where none of their curves was run."""
    known = [[_found(result, c.of) for c in panel.curves] for panel in panels]
    if not any(curve is not None for curves in known for curve in curves):
        return None
    rows = math.ceil(len(panels) / 2)
    figure = style.new_figure(_PANEL_IN * rows + 0.3)
    axes = figure.subplots(rows, min(2, len(panels)), sharex=True, sharey=True, squeeze=False)
    for ax, panel, curves in zip(axes.ravel(), panels, known, strict=False):
        for i, (drawn, curve) in enumerate(zip(panel.curves, curves, strict=True)):
            if curve is not None:
                _draw(ax, curve, style.step_colour(i, len(curves)), i, len(curves) - 1 - i, drawn.label)
        for theta in sorted({_truth(result, c.of) for c in panel.curves}):
            ax.axvline(theta, color=style.INK, linestyle="--", linewidth=1.0, zorder=1)
        ax.set_title(panel.title, loc="left", fontweight="bold")
        if any(curve is not None for curve in curves):
            ax.legend(loc="lower right", handlelength=1.2)
        else:
            ax.text(0.98, 0.04, "not run", transform=ax.transAxes, ha="right", va="bottom", color=style.INK)
    for ax in axes.ravel()[len(panels) :]:
        ax.set_visible(False)
    for ax in axes[:, 0]:
        ax.set_ylabel("response probability")
    for ax in axes[-1]:
        style.contrast_axis(ax)
    axes[0, 0].set_xlim(0.0, _HIGHEST)
    axes[0, 0].set_ylim(-0.04, 1.04)
    return figure


def _found(result: StudyResult, name: str) -> SCurve | None:
    wanted = CurveName.parse(name)
    outcome = result.outcomes.get((wanted.variant, wanted.stimulus))
    return outcome.curve(wanted.polarity) if outcome is not None else None


def _truth(result: StudyResult, name: str) -> float:
    wanted = CurveName.parse(name)
    pixel = next(v.pixel for v in result.study.variants if v.name == wanted.variant)
    return true_threshold(pixel, wanted.polarity)


def _draw(
    ax: Axes, curve: SCurve, colour: tuple[float, float, float, float], step: int, behind: int, label: str
) -> None:
    ax.plot(curve.fit_contrast, curve.fit_probability, color=colour, linewidth=1.2, zorder=2)
    style.bars(ax, curve.log_contrast, curve.low, curve.high, colour)
    look = style.point(step, colour)
    look["markersize"] *= 1.0 + _GROWTH * behind
    ax.plot(curve.log_contrast, curve.probability, linestyle="", label=label, zorder=3, **look)
    for reading, marker, share in ((curve.half, "o", 0.5), (curve.intercept, "s", curve.quantile)):
        floor = float(np.nan_to_num(curve.floor.value))
        height = floor + share * (curve.plateau.value - floor)
        ax.plot(
            [reading.value], [height], linestyle="", marker=marker, markersize=6.0, markerfacecolor="white",
            markeredgecolor=colour, markeredgewidth=1.5, zorder=4,
        )  # fmt: skip
