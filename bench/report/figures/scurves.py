"""The family of S-curves: response probability against log contrast, with what was read off each curve below it."""

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

    from bench.analysis.results import Estimate, ResponsePolarity, SCurve
    from bench.report.families import Family

__all__ = ["Curve", "Panel", "SCurveNumbers", "draw", "prepare"]

_CURVES_HEIGHT_IN: Final = 3.1
_ROW_HEIGHT_IN: Final = 0.27
_READING_LABELS: Final = {"half": "50 % point", "intercept": "intercept", "theta": "fitted threshold"}
_READINGS: Final[tuple[tuple[str, str, float], ...]] = (  # name, marker, place in its row
    ("half", "o", -0.24),
    ("intercept", "s", 0.0),
    ("theta", "D", 0.24),
)


@dataclass(frozen=True, slots=True)
class Curve:
    """One S-curve as it is drawn."""

    step: int  #: colour and marker
    contrast: npt.NDArray[np.float64]  #: (n,) ln
    probability: npt.NDArray[np.float64]  #: (n,)
    low: npt.NDArray[np.float64]  #: (n,)
    high: npt.NDArray[np.float64]  #: (n,)
    fit_contrast: npt.NDArray[np.float64]  #: (g,)
    fit_probability: npt.NDArray[np.float64]  #: (g,)
    half: Estimate
    half_height: float  #: probability at which the 50 % point stands: halfway from floor to plateau
    intercept: Estimate
    intercept_height: float
    theta: Estimate | None


@dataclass(frozen=True, slots=True)
class Panel:
    """The curves of one polarity."""

    polarity: ResponsePolarity
    curves: tuple[Curve, ...]


@dataclass(frozen=True, slots=True)
class SCurveNumbers:
    """All that the figure shows."""

    labels: tuple[str, ...]  #: of the steps
    panels: tuple[Panel, ...]  #: ON, OFF; only those that were measured
    lowest: float  #: left end of the contrast axis, ln
    highest: float  #: its right end, ln

    @property
    def has_theta(self) -> bool:
        """Whether a threshold was fitted to any of the curves."""
        return any(curve.theta is not None for panel in self.panels for curve in panel.curves)


def prepare(curves: Sequence[SCurve], family: Family) -> SCurveNumbers | None:
    """Return the numbers of the figure of one family, or None where it has no curve with a point."""
    mine = [(curve, step) for curve in curves if (step := family.step_of(curve.key)) and curve.log_contrast.size]
    if not mine:
        return None
    panels = []
    for polarity in ("on", "off"):
        members = [_curve(curve, step.index) for curve, step in mine if curve.key.polarity == polarity]
        if members:
            panels.append(Panel(polarity, tuple(sorted(members, key=lambda curve: curve.step))))
    lowest, highest = _range([curve for curve, _ in mine])
    return SCurveNumbers(tuple(step.label for step in family.steps), tuple(panels), lowest, highest)


def _curve(curve: SCurve, step: int) -> Curve:
    return Curve(
        step=step,
        contrast=curve.log_contrast,
        probability=curve.probability,
        low=curve.low,
        high=curve.high,
        fit_contrast=curve.fit_contrast,
        fit_probability=curve.fit_probability,
        half=curve.half,
        half_height=_height(curve, 0.5, curve.half.value),
        intercept=curve.intercept,
        intercept_height=_height(curve, curve.quantile, curve.intercept.value),
        theta=curve.theta,
    )


def _height(curve: SCurve, share: float, contrast: float) -> float:
    """Return the probability `share` of the way from floor to plateau; where one is unknown, that of the fit."""
    height = curve.floor.value + share * (curve.plateau.value - curve.floor.value)
    if np.isfinite(height) or not curve.fit_contrast.size:
        return height
    return float(np.interp(contrast, curve.fit_contrast, curve.fit_probability))


def _range(curves: Sequence[SCurve]) -> tuple[float, float]:
    """Return the ends of the contrast axis: all that was measured, and readings not far beyond it."""
    low = min(float(curve.log_contrast.min()) for curve in curves)
    high = max(float(curve.log_contrast.max()) for curve in curves)
    readings = [e.value for c in curves for e in (c.intercept, c.theta) if e is not None]
    high = max([high, *(value for value in readings if high < value < 1.25 * high)])
    room = 0.03 * (high - low) if high > low else 0.05 * high
    return max(0.0, low - room), high + room


def draw(numbers: SCurveNumbers) -> Figure:
    """Draw the family: one column for each polarity, the curves above, their readings below."""
    rows_in = _ROW_HEIGHT_IN * len(numbers.labels) + 0.15
    figure = style.new_figure(_CURVES_HEIGHT_IN + rows_in + 1.35)
    axes = figure.subplots(
        2, len(numbers.panels), sharex=True, sharey="row", squeeze=False, height_ratios=[_CURVES_HEIGHT_IN, rows_in]
    )
    for column, panel in enumerate(numbers.panels):
        _draw_curves(axes[0, column], panel, numbers)
        _draw_readings(axes[1, column], panel, numbers)
    axes[0, 0].set_ylabel("response probability")
    _legend(figure, numbers)
    return figure


def _draw_curves(ax: Axes, panel: Panel, numbers: SCurveNumbers) -> None:
    for curve in panel.curves:
        colour = style.step_colour(curve.step, len(numbers.labels))
        ax.plot(curve.fit_contrast, curve.fit_probability, color=colour, linewidth=1.2, alpha=0.9, zorder=2)
        style.bars(ax, curve.contrast, curve.low, curve.high, colour)
        ax.plot(curve.contrast, curve.probability, linestyle="", zorder=3, **style.point(curve.step, colour))
        _mark(ax, curve.half.value, curve.half_height, "o", colour)
        _mark(ax, curve.intercept.value, curve.intercept_height, "s", colour)
    ax.set_xlim(numbers.lowest, numbers.highest)
    ax.set_ylim(-0.04, 1.04)
    style.linear_contrast_axis(ax, numbers.lowest, numbers.highest)
    ax.set_title(polarity_label(panel.polarity), loc="left", fontweight="bold", pad=8)


def _mark(ax: Axes, x: float, y: float, marker: str, colour: tuple[float, ...]) -> None:
    """Mark a reading on its curve: larger than the points, and white inside."""
    ax.plot(
        [x], [y], linestyle="", marker=marker, markersize=6.0, markerfacecolor="white", markeredgecolor=colour,
        markeredgewidth=1.6, zorder=4,
    )  # fmt: skip


def _draw_readings(ax: Axes, panel: Panel, numbers: SCurveNumbers) -> None:
    for curve in panel.curves:
        colour = style.step_colour(curve.step, len(numbers.labels))
        for name, marker, shift in _READINGS:
            reading = getattr(curve, name)
            if reading is None:
                continue
            y = curve.step + shift
            style.bars(ax, y, reading.low, reading.high, colour, horizontal=True)
            face = "white" if name != "theta" else colour
            ax.plot([reading.value], [y], linestyle="", marker=marker, markersize=5.0, markeredgecolor=colour,
                    markerfacecolor=face, markeredgewidth=1.3, zorder=3)  # fmt: skip
    ax.set_ylim(len(numbers.labels) - 0.4, -0.6)
    ax.set_yticks(range(len(numbers.labels)), numbers.labels)
    ax.tick_params(axis="y", length=0)
    ax.grid(visible=False, axis="y")
    style.contrast_axis(ax)


def _legend(figure: Figure, numbers: SCurveNumbers) -> None:
    from matplotlib.lines import Line2D

    total = len(numbers.labels)
    points = [
        Line2D([], [], linestyle="-", linewidth=1.2, label=label, color=style.step_colour(i, total),
               **style.point(i, style.step_colour(i, total)))
        for i, label in enumerate(numbers.labels)
    ]  # fmt: skip
    shown = [item for item in _READINGS if item[0] != "theta" or numbers.has_theta]
    readings = [
        Line2D([], [], linestyle="", marker=marker, markersize=6.0, markeredgecolor=style.INK, markeredgewidth=1.3,
               markerfacecolor=style.INK if name == "theta" else "white", label=_READING_LABELS[name])
        for name, marker, _ in shown
    ]  # fmt: skip
    figure.legend(handles=points + readings, loc="outside right upper", labelspacing=0.55, handlelength=1.8)
