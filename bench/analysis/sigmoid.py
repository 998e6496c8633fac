"""Monotone curves with a floor and a plateau, and their fit to counts: many fits at once.

A curve is ``p(x) = floor + (1 - floor) g S(x)`` with S a distribution function that rises from 0 to 1. The parameters
of S are its own (below); floor and g are the squares of two sines, so that both stay within 0 and 1 while all
parameters are free: ``floor = sin(a)^2``, ``g = sin(b)^2``, ``plateau = floor + (1 - floor) g``.

All arrays of parameters are (fits, parameters): a bootstrap fits all its samples in one call.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]

__all__ = ["NORMAL", "SINH_ARCSINH", "Family", "Fit", "fit_counts", "floor_and_plateau"]

_SETTLED: Final = 1e-4  # change of the deviance; a hundredth of a standard error
_HOPELESS: Final = 1e8
_TINY: Final = 1e-9  # fitted probabilities stay this far from 0 and 1
_LARGEST_BENT: Final = 6.0  # sinh(6) is 200 standard deviations


@dataclass(frozen=True, slots=True)
class Family:
    """A family of distribution functions; its first parameter is a contrast, its second ln of a width."""

    name: str
    shape: Callable[[Floats, Floats], tuple[Floats, Floats]]  #: values (fits, n) and slopes (fits, n, own parameters)
    quantile: Callable[[Floats, float], Floats]  #: (fits, parameters), level -> (fits,)
    extra: int  #: parameters beyond centre and width, 0 where the curve is symmetric


@dataclass(frozen=True, slots=True)
class Fit:
    """Fitted curves."""

    family: Family
    parameters: Floats  #: (fits, own parameters + 2)
    deviance: Floats  #: (fits,)

    def probability(self, x: Floats) -> Floats:
        """Return (fits, n) the curves at the contrasts `x` (n,)."""
        return _probability(self.family, self.parameters, x)

    def quantile(self, level: float) -> Floats:
        """Return (fits,) where each curve has risen by `level` of the way from floor to plateau."""
        return self.family.quantile(self.parameters, level)


def _normal_cdf(z: Floats) -> Floats:
    from scipy.special import ndtr

    return np.asarray(ndtr(z), np.float64)


def _normal_quantile(level: Floats | float) -> Floats:
    from scipy.special import ndtri

    return np.asarray(ndtri(level), np.float64)


def _density(z: Floats) -> Floats:
    return np.asarray(np.exp(-0.5 * np.minimum(z * z, 700.0)) / np.sqrt(2.0 * np.pi), np.float64)


def _normal(q: Floats, x: Floats) -> tuple[Floats, Floats]:
    width = np.exp(q[:, 1:2])
    z = (x - q[:, :1]) / width
    density = _density(z)
    return _normal_cdf(z), np.stack([-density / width, -density * z], axis=2)


def _normal_at(q: Floats, level: float) -> Floats:
    return q[:, 0] + np.exp(q[:, 1]) * _normal_quantile(level)


def _sinh_arcsinh(q: Floats, x: Floats) -> tuple[Floats, Floats]:
    """Jones and Pewsey (2009): skewed by one parameter, tails made lighter or heavier by another."""
    width, tail = np.exp(q[:, 1:2]), np.exp(q[:, 3:4])
    t = (x - q[:, :1]) / width
    stretched = tail * np.arcsinh(t)
    bent = np.clip(stretched - q[:, 2:3], -_LARGEST_BENT, _LARGEST_BENT)
    z = np.sinh(bent)
    by_bent = _density(z) * np.cosh(bent)
    by_t = by_bent * tail / np.sqrt(1.0 + t * t)
    return _normal_cdf(z), np.stack([-by_t / width, -by_t * t, -by_bent, by_bent * stretched], axis=2)


def _sinh_arcsinh_at(q: Floats, level: float) -> Floats:
    bent = (np.arcsinh(_normal_quantile(level)) + q[:, 2]) * np.exp(-q[:, 3])
    return np.asarray(q[:, 0] + np.exp(q[:, 1]) * np.sinh(np.clip(bent, -_LARGEST_BENT, _LARGEST_BENT)))


NORMAL: Final = Family("normal", _normal, _normal_at, 0)
SINH_ARCSINH: Final = Family("sinh-arcsinh", _sinh_arcsinh, _sinh_arcsinh_at, 2)


def floor_and_plateau(parameters: Floats) -> tuple[Floats, Floats]:
    """Return (fits,) floors and plateaus."""
    floor = np.sin(parameters[:, -2]) ** 2
    return floor, floor + (1.0 - floor) * np.sin(parameters[:, -1]) ** 2


def _probability(family: Family, parameters: Floats, x: Floats) -> Floats:
    floor, plateau = floor_and_plateau(parameters)
    return np.asarray(floor[:, None] + (plateau - floor)[:, None] * family.shape(parameters, x)[0], np.float64)


def _with_slopes(family: Family, q: Floats, x: Floats) -> tuple[Floats, Floats]:
    """Return the curves (fits, n) and their derivatives (fits, n, parameters)."""
    share, slopes = family.shape(q, x)
    floor, gain = np.sin(q[:, -2:-1]) ** 2, np.sin(q[:, -1:]) ** 2
    rise = (1.0 - floor) * gain
    by_floor = np.sin(2.0 * q[:, -2:-1]) * (1.0 - gain * share)
    by_gain = np.sin(2.0 * q[:, -1:]) * (1.0 - floor) * share
    ends = np.stack([by_floor, by_gain], axis=2)
    return floor + rise * share, np.concatenate([rise[:, :, None] * slopes, ends], axis=2)


def _deviance(fraction: Floats, trials: Floats, p: Floats) -> Floats:
    from scipy.special import xlogy

    p = np.clip(p, _TINY, 1.0 - _TINY)
    gain = xlogy(fraction, fraction / p) + xlogy(1.0 - fraction, (1.0 - fraction) / (1.0 - p))
    return np.asarray(2.0 * np.sum(trials * gain, axis=1), np.float64)


def fit_counts(
    family: Family, start: Floats, x: Floats, fraction: Floats, trials: Floats, iterations: int = 60
) -> Fit:
    """Fit curves by maximum likelihood of binomial counts (Fisher scoring, damped after Levenberg and Marquardt).

    Parameters
    ----------
    start
        (fits, parameters) where each fit begins.
    x
        (n,) contrasts.
    fraction, trials
        (fits, n) share of answers, and number of trials. A trial need not be independent for the estimate to hold.
    """
    q = start.copy()
    deviance = _deviance(fraction, trials, _probability(family, q, x))
    damping = np.full(q.shape[0], 1e-2)
    done = np.zeros(q.shape[0], np.bool_)
    for _ in range(iterations):
        live = np.flatnonzero(~done)
        if not live.size:
            break
        trial = q[live] + _step(family, q[live], x, fraction[live], trials[live], damping[live])
        after = _deviance(fraction[live], trials[live], _probability(family, trial, x))
        better = after < deviance[live]
        done[live] = (np.abs(deviance[live] - after) < _SETTLED) | (damping[live] > _HOPELESS)
        q[live[better]], deviance[live[better]] = trial[better], after[better]
        damping[live] = np.where(better, np.maximum(damping[live] * 0.2, 1e-9), damping[live] * 6.0)
    return Fit(family, q, deviance)


def _step(family: Family, q: Floats, x: Floats, fraction: Floats, trials: Floats, damping: Floats) -> Floats:
    p, slopes = _with_slopes(family, q, x)
    p = np.clip(p, _TINY, 1.0 - _TINY)
    weight = trials / (p * (1.0 - p))
    gradient = np.einsum("bn,bnp->bp", weight * (fraction - p), slopes)
    information = np.swapaxes(slopes * weight[:, :, None], 1, 2) @ slopes
    diagonal = np.einsum("bpp->bp", information)
    ridge = damping[:, None] * (diagonal + 1e-6 * diagonal.max(axis=1, keepdims=True) + 1e-12)
    information = information + ridge[:, :, None] * np.eye(q.shape[1])
    step = np.linalg.solve(information, gradient[:, :, None])[:, :, 0]
    width = np.exp(q[:, 1])
    step[:, 0] = np.clip(step[:, 0], -2.0 * width, 2.0 * width)
    step[:, 1:] = np.clip(step[:, 1:], -0.7, 0.7)
    return np.asarray(step, np.float64)
