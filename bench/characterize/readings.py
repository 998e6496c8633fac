"""Dark light from readings of single curves, as papers do it: level by level, and by a straight line through all.

The Weber contrast that a curve needs is a straight line in 1/E (:mod:`.weber`); where it meets the axis on the left
tells the dark light, and how far the levels are from it whether one threshold holds at all of them. A reading moves
with the noise and with the speed of the pixel, too: the fit of the whole family (:mod:`.family_fit`) does not mistake
these for light.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench.characterize.normal import as_estimate, as_known
from bench.characterize.weber import dark_light, threshold_of, weber
from bench.photometry.propagation import Known, Propagated, propagate

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bench.analysis.results import Estimate, ResponsePolarity
    from bench.store.data import PointData

__all__ = ["Line", "Reading", "Uncertainties", "line_through", "of_level", "with_recorded"]


@dataclass(frozen=True, slots=True)
class Reading:
    """The contrast that one curve needs."""

    baseline_lux: float
    nd_od: float
    contrast: Estimate  #: ln


@dataclass(frozen=True, slots=True)
class Uncertainties:
    """Standard errors of what stands on dials: they come on top of what chance does."""

    light: float | None = None  #: of the illuminance, relative; None: not known, taken as exact
    contrast: float = 0.0  #: of each log contrast, ln
    nd_od: float | None = None  #: of the optical density of the filters; None: not known, found if the data tell
    eta: float = 0.0  #: of the quantum efficiency


def with_recorded(beside: Uncertainties, points: Sequence[PointData]) -> Uncertainties:
    """Return the uncertainties with those that are not known replaced by the largest that the points tell."""
    light, density = beside.light, beside.nd_od
    if light is None:
        light = _largest(points, "lux_uncertainty")
    if density is None:
        relative = _largest([p for p in points if p.nd_od > 0.0], "nd_uncertainty")
        density = None if relative is None else relative / math.log(10.0)
    return Uncertainties(light, beside.contrast, density, beside.eta)


def _largest(points: Sequence[PointData], name: str) -> float | None:
    told = [p.attributes.get(name) for p in points]
    known = [float(v) for v in told if isinstance(v, int | float | np.number) and math.isfinite(v) and v >= 0.0]
    return max(known) if known else None


@dataclass(frozen=True, slots=True)
class Line:
    """One threshold and one dark light for all levels."""

    theta: Estimate  #: ln
    dark_lux: Estimate
    chi2: float  #: of the levels about the line
    dof: int
    levels: tuple[float, ...]  #: by how many standard errors each reading is off the line


def line_through(readings: Sequence[Reading], polarity: ResponsePolarity) -> Line | None:
    """Fit ``W = w (1 + E_d / E)``; None where fewer than two light levels have a reading.

    Where the levels scatter about the line by more than their errors, the intervals are widened by it.
    """
    good = [
        r for r in readings if math.isfinite(r.contrast.high - r.contrast.low) and r.contrast.high > r.contrast.low
    ]
    if len({r.baseline_lux for r in good}) < 2:
        return None
    x = np.array([1.0 / r.baseline_lux for r in good])
    y = np.array([weber(r.contrast.value, polarity) for r in good])
    sd = np.array([_sd(r.contrast) for r in good]) * np.array([_slope(r.contrast.value, polarity) for r in good])
    design = np.stack([np.ones_like(x), x], axis=1) / sd[:, None]
    covariance = np.linalg.inv(design.T @ design)
    w, slope = covariance @ design.T @ (y / sd)
    off = (y - w - slope * x) / sd
    chi2, dof = float(off @ off), len(good) - 2
    if dof > 0:
        covariance = covariance * max(1.0, chi2 / dof)
    if w <= 0.0 or not math.isfinite(threshold_of(float(w), polarity)):
        return None
    theta = threshold_of(float(w), polarity)
    theta_sd = math.sqrt(covariance[0, 0]) / _slope(theta, polarity)
    dark = float(slope / w)
    gradient = np.array([-dark / w, 1.0 / w])
    dark_sd = math.sqrt(float(gradient @ covariance @ gradient))
    return Line(as_estimate(theta, theta_sd, "ln"), as_estimate(dark, dark_sd, "lux"), chi2, dof, tuple(off.tolist()))


def of_level(reading: Reading, theta: Known, polarity: ResponsePolarity, beside: Uncertainties) -> Propagated:
    """Return the dark light that one level tells by itself, with what each number adds to its standard error.

    Parameters
    ----------
    theta
        The threshold, from elsewhere: bright light, or the line.
    """
    od_sd = (beside.nd_od or 0.0) if reading.nd_od > 0.0 else 0.0
    return propagate(
        lambda lux, more_od, contrast, dial, threshold: dark_light(
            contrast + dial, lux * 10.0**-more_od, threshold, polarity
        ),
        {
            "illuminance": Known(reading.baseline_lux, (beside.light or 0.0) * reading.baseline_lux),
            "filter": Known(0.0, od_sd),
            "curve": Known(reading.contrast.value, _sd(reading.contrast)),
            "contrast": Known(0.0, beside.contrast),
            "theta": theta,
        },
    )


def _sd(estimate: Estimate) -> float:
    return as_known(estimate).sd


def _slope(log_contrast: float, polarity: ResponsePolarity) -> float:
    """Return the derivative of the Weber contrast by the log contrast."""
    return math.exp(log_contrast if polarity == "on" else -log_contrast)
