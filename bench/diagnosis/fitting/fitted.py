"""A fitted model: its numbers, how well they are known, and what is left over."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.fitting import robust
from bench.diagnosis.fitting.normal import inverse, solved

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import numpy.typing as npt

    from bench.diagnosis.expected.problem import Problem, Slot
    from sim_backend.pixel.model import PixelModel

    Floats = npt.NDArray[np.float64]

__all__ = ["KNOWN", "Fit", "live", "off_known", "prior_precision", "solve", "whiten"]

#: A larger standard error stands for a statistic that was not measured, or is not predicted.
KNOWN: Final = 1e5
#: A smaller variance is that of a number of which nothing is known.
_NONE: Final = 1e-100
#: Combinations of statistics that hardly vary are left out: their rows are zero.
_LIVE: Final = 1e-5


@dataclass(frozen=True)
class Fit:
    """A model fitted to a run."""

    model: PixelModel  #: with the effects that it has; its numbers are those of `x`
    slots: tuple[Slot, ...]
    x: Floats  #: (k,) coordinates
    start: Floats  #: (k,) of the prior
    value: Floats  #: (n,) expected, transformed
    ratio: Floats  #: (n,) expected, in the unit of the label
    roots: tuple[Floats, ...]  #: of each point: makes its residuals independent, of unit variance
    deviation: Floats  #: (n,) standard errors of measured less expected
    jacobian: Floats  #: (2, n, k) change of the expected values by coordinate, from two sensors
    scale: float  #: mean square of the residuals of a run of the model itself
    residual: Floats  #: (n,) measured less expected, transformed
    frozen: Floats | None = None  #: (k,) variance of the coordinates from what is frozen in the pixels of all points
    common: float = 1.0
    """Variance of what several points have in common, beside that of each: they were simulated as one."""
    between: Mapping[int, tuple[float, float]] = field(default_factory=dict)
    """Of numbers that go in bends, by their place: the coordinates between which they are, with 90 %."""

    def models(self, problem: Problem) -> list[PixelModel]:
        """Return the fitted model of each point of a problem."""
        return problem.models(self.model, self.slots, self.x)

    @property
    def known(self) -> npt.NDArray[np.bool_]:
        """(n,) which statistics say something: they were measured, and are predicted."""
        return self.deviation < KNOWN

    @property
    def caution(self) -> float:
        """Variance of the independent residuals, for tests: rare events scatter less than stated, others do not."""
        return max(self.scale, 1.0)

    @property
    def z(self) -> Floats:
        """(n,) residuals in standard errors, each on its own."""
        return np.asarray(self.residual / (self.deviation * np.sqrt(self.caution)))

    def whiten(self, values: Floats, points: Sequence[slice]) -> Floats:
        """Return residuals, or columns of changes, as independent numbers of unit variance."""
        return np.asarray(whiten(self.roots, values, points) / math.sqrt(self.caution))

    def covariance(self, points: Sequence[slice]) -> Floats:
        """(k, k) covariance of the coordinates; the variance of one of which nothing is known is infinite."""
        changes, chance = self._changes(points)
        return self._covariance(points, *inverse(self._information(changes, chance, robust.LEAST_LEFT)))

    def scatter(self, points: Sequence[slice]) -> Floats:
        """(k, k) covariance of where fits of such runs end: chance in the changes leads them astray, too.

        A fit ends where its changes, with the chance E in them, see nothing in the residuals r. E'r has the
        covariance E'E, and leads it away by as much of that as the information about the coordinates allows (W. A.
        Fuller, "Measurement Error Models", Wiley 1987, section 1.2), no farther than steps go. How much of what is
        seen is chance is known from n statistics of two sensors to a share of 2 / sqrt(n), and no less is believed
        to be seen.
        """
        changes, chance = self._changes(points)
        least = min(2.0 / math.sqrt(max(len(changes), 1)), robust.LEAST_LEFT)
        found, unknown = inverse(self._information(changes, chance, least))
        astray = inverse(self._information(changes, chance, robust.LEAST_LEFT))[0] @ chance.T
        return self._covariance(points, found + astray @ astray.T, unknown)

    def _changes(self, points: Sequence[slice]) -> tuple[Floats, Floats]:
        """Return the changes by coordinate, whitened, and the chance in them."""
        return robust.mean_and_chance(*(self.whiten(j, points) for j in self.jacobian))

    def _information(self, changes: Floats, chance: Floats, least: float) -> Floats:
        seen = robust.without(changes.T @ changes, chance.T @ chance, least)
        return np.asarray(seen + np.diag(prior_precision(self.slots)))

    def _covariance(self, points: Sequence[slice], found: Floats, unknown: npt.NDArray[np.bool_]) -> Floats:
        """Return a covariance with what is frozen in a sensor, and no smaller than points disagree."""
        if self.frozen is not None:
            found = found + np.diag(self.frozen)
        own = np.maximum(np.diag(found), _NONE)
        wider = np.sqrt(np.where(own > _NONE, np.maximum(self._between_points(points) / own, 1.0), 1.0))
        found = found * np.outer(wider, wider)
        found[unknown, unknown] = math.inf
        return np.asarray(found)

    def _between_points(self, points: Sequence[slice]) -> Floats:
        """(k,) variance of the coordinates as it shows when each point in turn is left out (jackknife).

        Source: B. Efron, C. Stein, "The jackknife estimate of variance", Ann. Statist. 9 (1981). It knows of what
        makes points disagree beyond chance.
        """
        residual, columns = self.whiten(self.residual, points), self.whiten(self.jacobian.mean(axis=0), points)
        parts = [(columns[where].T @ columns[where], columns[where].T @ residual[where]) for where in points]
        prior = prior_precision(self.slots)
        left = sum((a for a, _ in parts), np.diag(prior))
        right = sum((b for _, b in parts), prior * (self.start - self.x))
        moved = np.stack([solved(left - a, right - b) for a, b in parts])
        n = len(moved)
        return np.asarray((n - 1.0) * moved.var(axis=0))


def whiten(roots: Sequence[Floats], values: Floats, points: Sequence[slice]) -> Floats:
    """Return the values of each point, or columns of them, as independent numbers of unit variance."""
    return np.concatenate([root @ values[where] for root, where in zip(roots, points, strict=True)])


def live(root: Floats) -> Floats:
    """(k,) which combinations of the statistics of a point count."""
    return np.asarray(np.abs(root).sum(axis=1) > _LIVE)


def prior_precision(slots: Sequence[Slot]) -> Floats:
    """(k,) precision with which each coordinate is known before."""
    return np.array([0.0 if np.isinf(s.free.prior_sd) else s.free.prior_sd**-2 for s in slots])


def off_known(one: Fit) -> Floats:
    """(k,) by how many standard deviations each coordinate is below what is known of it before: observations, too."""
    return np.asarray(np.sqrt(prior_precision(one.slots)) * (one.start - one.x))


def solve(columns: Floats, residual: Floats, prior: Floats, towards: Floats | float = 0.0) -> Floats:
    """Return the least-squares coordinates of `residual` in `columns`, with a prior precision of each.

    Parameters
    ----------
    towards
        (k,) what the prior expects.
    """
    return solved(columns.T @ columns + np.diag(prior), columns.T @ residual + prior * towards)
