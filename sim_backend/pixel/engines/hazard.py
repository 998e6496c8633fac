"""How often, and how, a noisy pixel that has been quiet for long leaves its comparator levels, on a grid of samples.

The noise is ``w <- rho w + s z`` with ``s = sqrt(1 - rho^2)``, of unit variance. Killed at a barrier b, its law
becomes quasi-stationary: the time to the barrier is geometric, and where it stands before and after the crossing
depends only on b. All of it follows from the transition matrix on the same grid: the matrix is made symmetric, since
the noise is reversible, and its eigenvector of the largest eigenvalue gives the quasi-stationary law.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]

__all__ = ["B_FIRST", "B_LAST", "B_STEP", "Z_LAST", "Z_STEP", "HazardTable", "hazard_table", "quasi_stationary"]

#: Barriers of the table, in units of the rms of the noise: first, last, and how far apart.
B_FIRST: Final = 1.0
B_LAST: Final = 8.0
B_STEP: Final = 0.1
#: Barriers for which the matrix is solved; a cubic spline goes through them.
_SOLVED_STEP: Final = 0.25
#: Normal numbers of the table: from -Z_LAST to Z_LAST.
Z_LAST: Final = 6.5
Z_STEP: Final = 0.1

#: The noise is followed down to here; it is lower in one sample of 10^15.
_LOWEST: Final = -8.0
#: Mean distance of two nodes, in rms of one step. Gauss-Legendre nodes are at most pi/2 times as far apart.
_NODE_STEPS: Final = 0.5
#: No step is longer, in its rms.
_STEP_REACH: Final = 10.0
#: Inverse iteration: how far above 1, and how often. The next eigenvalue is 3 times as far away from 1, or further.
_SHIFT: Final = 1e-11
_ITERATIONS: Final = 30

#: Rates for which the tables are made: this one (200 Hz, looked at every 10 us), and so many in a decade.
_RATE: Final = 2.0 * math.pi * 200.0 * 1e-5
_RATES_A_DECADE: Final = 20
#: Places this close are the same.
_SAME_RATE: Final = 1e-6

_legendre = lru_cache(np.polynomial.legendre.leggauss)


@dataclass(frozen=True, slots=True)
class HazardTable:
    """Tables over the distance b of a barrier from the level, and a standard normal number z.

    The two laws are given as functions of z: a number with that law is had by looking up a normal one.
    """

    log_rate: Floats  #: (b,) logarithm of the hazard of a crossing per sample, plus b^2 / 2
    inside: Floats  #: (b, z) noise of a pixel that has not crossed
    beyond: Floats  #: (b, z) noise at the sample that crosses


def quasi_stationary(low: float, high: float, rho: float) -> tuple[Floats, Floats]:
    """Return nodes in (low, high) and the probability of each, for noise that has long been within these barriers."""
    from scipy.linalg import cho_solve_banded, cholesky_banded

    s = math.sqrt(1.0 - rho * rho)
    unit, weight = _legendre(max(24, 8 * math.ceil((high - low) / (8.0 * _NODE_STEPS * s))))
    x = 0.5 * (high + low) + 0.5 * (high - low) * unit
    weight = 0.5 * (high - low) * weight
    # One step leads to nodes nearby only: upper form of a banded matrix, row by row.
    band = min(len(x) - 1, int(np.max(np.searchsorted(x, x + _STEP_REACH * s) - np.arange(len(x)))))
    matrix = np.zeros((band + 1, len(x)))
    for k in range(band + 1):
        a, b = x[: len(x) - k], x[k:]
        exponent = -0.5 * ((b - rho * a) / s) ** 2 + 0.25 * (b**2 - a**2)
        matrix[band - k, k:] = -np.sqrt(weight[: len(x) - k] * weight[k:]) * np.exp(exponent)
    matrix /= s * math.sqrt(2.0 * math.pi)
    matrix[band] += 1.0 + _SHIFT
    factor = cholesky_banded(matrix)
    vector = np.sqrt(weight) * np.exp(-0.25 * x**2)
    for _ in range(_ITERATIONS):
        vector = cho_solve_banded((factor, False), vector)
        vector /= np.linalg.norm(vector)
    mass = vector * np.sqrt(weight) * np.exp(-0.25 * x**2)
    return x, mass / mass.sum()


def hazard_table(rho: float) -> HazardTable:
    """Return the tables for noise that keeps the fraction `rho` of itself in one sample.

    They are made for some rates, a fixed factor apart, and taken between two of them: a fit asks for many rates that
    differ little. With r the rate per sample, the logarithm of the hazard is ``ln r - 0.58 b sqrt(2 r)`` plus what
    does not depend on r, and the step of a sample is ``sqrt(2 r)``: both are so nearly straight in ln r that the
    hazard is off by less than 1 in 1000 up to r = 0.3.
    """
    place = _RATES_A_DECADE * math.log10(-math.log(rho) / _RATE)
    below = math.floor(place + _SAME_RATE)
    part = place - below
    low = _table_at(below)
    if part <= _SAME_RATE:
        return low
    high = _table_at(below + 1)
    log_rate, inside, beyond = (
        one + part * (other - one)
        for one, other in (
            (low.log_rate, high.log_rate),
            (low.inside, high.inside),
            (low.beyond, high.beyond),
        )
    )
    return HazardTable(log_rate=log_rate, inside=inside, beyond=beyond)


@lru_cache(maxsize=64)
def _table_at(number: int) -> HazardTable:
    """Return the tables for one of the rates at which they are made."""
    rho = math.exp(-_RATE * 10.0 ** (number / _RATES_A_DECADE))
    from scipy.interpolate import CubicSpline

    solved = B_FIRST + _SOLVED_STEP * np.arange(round((B_LAST - B_FIRST) / _SOLVED_STEP) + 1)
    b = B_FIRST + B_STEP * np.arange(round((B_LAST - B_FIRST) / B_STEP) + 1)
    z = Z_STEP * np.arange(-round(Z_LAST / Z_STEP), round(Z_LAST / Z_STEP) + 1, dtype=np.float64)
    rows = [_row(barrier, z, rho) for barrier in solved]
    log_rate, inside, beyond = (CubicSpline(solved, np.array([row[i] for row in rows]))(b) for i in range(3))
    return HazardTable(log_rate=log_rate, inside=inside, beyond=beyond)


def _row(b: float, z: Floats, rho: float) -> tuple[float, Floats, Floats]:
    """Return one row of each table."""
    from scipy.special import ndtr

    s = math.sqrt(1.0 - rho * rho)
    x, mass = quasi_stationary(_LOWEST, b, rho)

    def above(y: Floats) -> Floats:
        """Return the probability that the next sample is above y."""
        return np.asarray(ndtr((rho * x - y[:, None]) / s) @ mass)

    rate = float(above(np.array([b]))[0])
    # Nodes are closer where the law falls off: towards the barrier on one side of it, away from it on the other.
    near = b - (b - _LOWEST) * np.linspace(1.0, 0.0, 400)[:-1] ** 2
    far = b + 9.0 * s * np.linspace(0.0, 1.0, 200)[1:] ** 2
    return (
        math.log(-math.log1p(-rate)) + 0.5 * b * b,
        _as_function_of_normal(z, near, above(near) - rate, 1.0 - rate),
        _as_function_of_normal(z, far, above(far), rate),
    )


def _as_function_of_normal(z: Floats, y: Floats, above: Floats, whole: float) -> Floats:
    """Return the quantiles of z, for a law by the weight above each y, `whole` in all."""
    from scipy.special import ndtri

    share = np.clip(above / whole, 1e-300, 1.0)
    normal = -ndtri(share)
    normal[share > 0.5] = ndtri(np.clip(1.0 - share[share > 0.5], 1e-300, 1.0))
    rising = np.concatenate([[True], np.diff(np.maximum.accumulate(normal)) > 0.0])
    return np.asarray(np.interp(z, normal[rising], y[rising]))
