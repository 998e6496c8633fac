"""The fit of a family of S-curves: one sensor, one dark light, all levels at once.

What is fitted are means over the pixels: the share of answers at each contrast, the latencies, and how much the
answers of single pixels agree with each other, which is the mismatch. Each is weighed by its own scatter; how well
the numbers are then known follows from the pixels, each of which pulls the result its own way (the sandwich estimate
of a robust covariance: P. J. Huber, "The behavior of maximum likelihood estimates under nonstandard conditions",
Proc. 5th Berkeley Symp., 1967). The pulses of one pixel need not be independent, nor its answers at different levels.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.analysis.results import Estimate
from bench.characterize.family_descent import minimum, scale_of, slopes_of
from bench.characterize.family_model import Family
from bench.characterize.family_problem import Problem
from bench.characterize.family_valley import Lower, ends_of
from bench.characterize.normal import Z90, as_estimate

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.characterize.family_problem import Known
    from bench.characterize.levels import Level

    Floats = npt.NDArray[np.float64]

__all__ = ["NAMES", "FamilyFit", "fit_family"]

NAMES: Final = tuple(field.name for field in fields(Family))
_CLEARLY: Final = 3.0  # standard errors
#: What trades places with the threshold, along a valley that is bent.
_IN_VALLEY: Final = ("theta", "ln_tau", "delay_s")
_RESTARTS: Final = 3  # where the valley turns out to be lower elsewhere
_BEYOND: Final = 0.02  # of a threshold's change that no other number can make: less is none
_TINY: Final = 1e-12


@dataclass(frozen=True)
class FamilyFit:
    """A sensor, as a family of S-curves of one polarity shows it."""

    family: Family
    free: tuple[str, ...]  #: names of the numbers that were fitted
    covariance: Floats  #: (f, f) of them
    chi2: float
    dof: int
    level_theta: tuple[Estimate, ...]  #: threshold at each level by itself, dark light accounted for
    constant: tuple[float, int]  #: chi-square of these against one threshold, and its degrees of freedom
    #: The sensors with the lowest and the highest threshold of its 90 % interval, or some between which it lies.
    ends: tuple[Family, ...] = ()

    def sd(self, name: str) -> float:
        """Return the standard error of a number, widened where the fit is poor; 0 where it was not fitted."""
        if name not in self.free:
            return 0.0
        i = self.free.index(name)
        return math.sqrt(max(float(self.covariance[i, i]), 0.0) * max(1.0, self.chi2 / max(self.dof, 1)))

    @property
    def sees_slow(self) -> bool:
        """Whether a photoreceptor with a time constant of its own is seen beyond chance."""
        return self.family.slow_s_lux > _CLEARLY * self.sd("slow_s_lux") > 0.0

    def at(self, baseline_lux: float, nd_od: float) -> tuple[float, float]:
        """Return noise rms, ln, and corner of the photoreceptor, Hz (infinite: not seen), at a light level."""
        f = self.family
        total = baseline_lux * 10.0 ** (-f.filter_od if nd_od > 0.0 else 0.0) + f.dark_lux
        noise = math.sqrt(max(f.noise_rms**2 + f.shot_lux / total, 0.0))
        return noise, total / (2.0 * math.pi * f.slow_s_lux) if self.sees_slow else math.inf

    def estimate(self, name: str, unit: str) -> Estimate:
        """Return a number with its 90 % interval."""
        found = as_estimate(float(getattr(self.family, name)), self.sd(name), unit)
        ends = [float(getattr(end, name)) for end in self.ends] if name in _IN_VALLEY else []
        return replace(found, low=min(found.low, *ends), high=max(found.high, *ends)) if ends else found


def fit_family(levels: Sequence[Level], known: Known, start: Family, free: Sequence[str] = NAMES) -> FamilyFit:
    """Fit the numbers named in `free` to the curves of one polarity; the others stay as in `start`."""
    problem = Problem(levels, known, start, free)
    x = np.array([getattr(start, name) for name in free])
    scale = np.array([scale_of(name, start) for name in free])
    places = []
    for _ in range(_RESTARTS):
        x = minimum(problem, x, scale)
        places.append(x)
        slopes = slopes_of(problem, x, scale)
        jacobian = problem.jacobian(slopes)
        found = _result(problem, x, jacobian, scale)
        ends = ends_of(problem, x, *_reach(found, jacobian, scale), slopes, scale)
        if not isinstance(ends, Lower):
            return replace(found, ends=tuple(problem.family(end) for end in ends))
        x = ends.x
    # A valley so flat that it has no lowest place: where the fit has been is within what the data allow.
    return replace(found, ends=tuple(problem.family(place) for place in (*places, x)))


def _reach(found: FamilyFit, jacobian: Floats, scale: Floats) -> tuple[float, float]:
    """Return half of the threshold's 90 % interval by the derivatives, and the rise of chi-square that belongs to it.

    Chi-square is that of independent answers. Those of a pixel are not, so that another rise than 2.7 may be wanted.
    """
    theta = found.free.index("theta")
    half = Z90 * found.sd("theta")
    by_chi2 = float(np.linalg.pinv((jacobian * scale).T @ (jacobian * scale), rcond=_TINY)[theta, theta])
    return half, (half / scale[theta]) ** 2 / by_chi2


def _result(problem: Problem, x: Floats, jacobian: Floats, scale: Floats) -> FamilyFit:
    residual = problem.residuals(x)
    # By the scale of each number: squares of their units are many orders apart.
    pull = -(np.linalg.pinv(jacobian * scale, rcond=_TINY).T * scale).T  # (f, r)
    theta = problem.free.index("theta")
    own = np.stack([problem.only(k, jacobian[:, theta]) for k in range(len(problem.levels))], axis=1)
    return FamilyFit(
        family=problem.family(x),
        free=problem.free,
        covariance=problem.scatter(pull.T),
        chi2=float(residual @ residual),
        dof=residual.size - x.size,
        level_theta=tuple(_level_theta(problem, float(x[theta]), column, residual) for column in own.T),
        constant=_constant(problem, own, jacobian, residual),
    )


def _level_theta(problem: Problem, theta: float, column: Floats, residual: Floats) -> Estimate:
    """Return the threshold that the answers at one level tell, all else as it was fitted to all levels."""
    if not np.any(column):
        return Estimate(math.nan, math.nan, math.nan, "ln", "its answers do not tell")
    pull = -column / float(column @ column)
    sd = math.sqrt(float(problem.scatter(pull[:, None])[0, 0]))
    return as_estimate(theta + float(pull @ residual), sd, "ln")


def _constant(problem: Problem, own: Floats, jacobian: Floats, residual: Floats) -> tuple[float, int]:
    """Return chi-square of thresholds that differ between levels, and its degrees of freedom (a score test).

    What such thresholds would change, less what the numbers of the fit can change too: one threshold, dark light, and
    a filter's density take their share.
    """
    taken, _ = np.linalg.qr(jacobian / np.maximum(np.linalg.norm(jacobian, axis=0), _TINY))
    beyond = own / np.maximum(np.linalg.norm(own, axis=0), _TINY)
    beyond = beyond - taken @ (taken.T @ beyond)
    left, size, _ = np.linalg.svd(beyond, full_matrices=False)
    left = left[:, size > _BEYOND]
    if not left.shape[1]:
        return 0.0, 0
    score = left.T @ residual
    return float(score @ np.linalg.solve(problem.scatter(left) + problem.doubt(left), score)), left.shape[1]
