"""A run beside a model of it: what was measured, what was expected, and how far apart they are."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.models.views import RESPONSES

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.models.views import View

__all__ = ["INFORMATIVE", "ChiSquare", "Compared", "Comparison", "PixelCovariance", "within"]

#: Response probabilities between these say something about the model; nearer to 0 or 1 almost any model agrees.
INFORMATIVE: Final = (0.02, 0.98)
#: Combinations of points that vary less than this, relative to the most varying one, are left out.
_NO_VARIANCE: Final = 1e-9


@dataclass(frozen=True, slots=True)
class Compared:
    """One view of one point: a share of answered test pulses, or a background rate in Hz."""

    point: int
    view: View
    baseline_lux: float  #: lux
    log_contrast: float  #: ln; 0 for background
    width_s: float  #: of the test pulse, s; NaN for background
    pulses: int  #: test pulses for each pixel; 0 for background
    pixels: int  #: that were measured
    measured: float
    expected: float  #: by the model
    standard_error: float  #: of `measured`, as the model expects it; at least one answer (event) of all pixels
    monte_carlo_error: float  #: of `expected`, from the number of simulated pixels

    @property
    def error(self) -> float:
        """Standard error of the difference between measured and expected."""
        return math.hypot(self.standard_error, self.monte_carlo_error)

    @property
    def z(self) -> float:
        """Difference between measured and expected in standard errors."""
        return (self.measured - self.expected) / self.error

    @property
    def is_response(self) -> bool:
        """Whether it is a share of answered test pulses."""
        return self.view in RESPONSES

    @property
    def informative(self) -> bool:
        """Whether it is a response that the model expects neither (almost) never nor (almost) always."""
        return self.is_response and INFORMATIVE[0] < self.expected < INFORMATIVE[1]


@dataclass(frozen=True, slots=True)
class PixelCovariance:
    """How the numbers of one pixel vary together, over points that were taken with the same pixels."""

    rows: npt.NDArray[np.int64]  #: (k,) places of these points in :attr:`Comparison.points`
    covariance: npt.NDArray[np.float64]  #: (k, k) over simulated pixels
    pixels: int  #: that were measured
    simulated: int  #: pixels


@dataclass(frozen=True, slots=True)
class ChiSquare:
    """How well a model explains a number of points, taken together."""

    value: float  #: NaN where too few pixels were simulated for so many points
    freedom: int  #: of the points; no parameter was fitted
    p_value: float  #: chance that a run of the model itself lies as far off
    sum_of_squares: float  #: of z: what `value` would be if points shared neither pixels nor recordings

    @property
    def per_freedom(self) -> float:
        """About 1 where the model explains the points."""
        return self.value / self.freedom if self.freedom else math.nan


@dataclass(frozen=True, slots=True)
class Comparison:
    """A run beside a model of it. Nothing was fitted."""

    run_id: str
    points: tuple[Compared, ...]  #: in the order of the run
    covariances: tuple[PixelCovariance, ...]  #: of points of the same pixels; others count as independent

    def responses(self, *, informative: bool = False) -> tuple[Compared, ...]:
        """Return the responses; only those between the limits :data:`INFORMATIVE` if asked."""
        return tuple(p for p in self.points if p.informative or (p.is_response and not informative))

    def background(self) -> tuple[Compared, ...]:
        """Return the background rates."""
        return tuple(p for p in self.points if not p.is_response)

    def chi_square(self) -> ChiSquare:
        """Return the chi-square of the informative responses.

        The ON and OFF responses of one recording depend on each other, and a frozen threshold moves all points of a
        pixel. So ``d^T C^-1 d`` is taken, with d the differences and C their covariance, which is that of one pixel
        times ``1/n + 1/m`` for n measured and m simulated pixels. As C is estimated itself, this is Hotelling's
        two-sample T^2: with k points and f = m - 1, ``T^2 (f - k + 1) / (f k)`` follows F with k and f - k + 1
        degrees of freedom. `value` is ``T^2 (f - k - 1) / f``, which is k on average for a true model.
        Source: H. Hotelling, "The generalization of Student's ratio", Annals of Mathematical Statistics 2 (1931);
        J. Hartlap et al., Astronomy & Astrophysics 464 (2007), for the factor.
        """
        blocks = [b for b in (self._block(c) for c in self.covariances) if b.freedom]
        squares = sum(p.z**2 for p in self.responses(informative=True))
        value, freedom = sum(b.value for b in blocks), sum(b.freedom for b in blocks)
        return ChiSquare(value, freedom, _combined([b.p_value for b in blocks]), squares)

    def _block(self, shared: PixelCovariance) -> ChiSquare:
        """Return the chi-square of the informative responses of the same pixels."""
        chosen = [i for i, row in enumerate(shared.rows) if self.points[row].informative]
        mine = [self.points[shared.rows[i]] for i in chosen]
        squares = sum(p.z**2 for p in mine)
        if not mine:
            return ChiSquare(0.0, 0, 1.0, 0.0)
        difference = np.array([p.measured - p.expected for p in mine])
        covariance = shared.covariance[np.ix_(chosen, chosen)] * (1.0 / shared.pixels + 1.0 / shared.simulated)
        t_squared, k = _mahalanobis(difference, covariance)
        if not k:
            return ChiSquare(0.0, 0, 1.0, squares)
        f = shared.simulated - 1
        if f - k - 1 <= 0:
            return ChiSquare(math.nan, k, math.nan, squares)
        return ChiSquare(t_squared * (f - k - 1) / f, k, _hotelling(t_squared, k, f), squares)


def within(points: Sequence[Compared], errors: float = 3.0) -> float:
    """Return the share of `points` that lie within so many standard errors of what was expected; NaN for none."""
    return float(np.mean([abs(p.z) <= errors for p in points])) if points else math.nan


def _mahalanobis(difference: npt.NDArray[np.float64], covariance: npt.NDArray[np.float64]) -> tuple[float, int]:
    """Return ``d^T C^-1 d`` over the combinations that vary at all, and their number."""
    varies = np.diag(covariance) > 0.0
    difference, covariance = difference[varies], covariance[np.ix_(varies, varies)]
    if not difference.size:
        return 0.0, 0
    scale = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    kept = values > _NO_VARIANCE * values[-1]
    along = vectors[:, kept].T @ (difference / scale)
    return float(np.sum(along**2 / values[kept])), int(kept.sum())


def _hotelling(t_squared: float, k: int, f: int) -> float:
    """Return the chance of so large a T^2 with k points and f degrees of freedom of the covariance."""
    from scipy.stats import f as f_distribution

    return float(f_distribution.sf(t_squared * (f - k + 1) / (f * k), k, f - k + 1))


def _combined(p_values: Sequence[float]) -> float:
    """Return one p-value of several independent ones (Fisher); 1 for none, NaN if one is."""
    from scipy.stats import chi2

    if not p_values:
        return 1.0
    if len(p_values) == 1 or any(math.isnan(p) for p in p_values):
        return p_values[0] if len(p_values) == 1 else math.nan
    if min(p_values) == 0.0:
        return 0.0
    return float(chi2.sf(-2.0 * sum(math.log(p) for p in p_values), 2 * len(p_values)))
