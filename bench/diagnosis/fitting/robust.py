"""Least squares for small residuals, least absolute values for large ones.

A model that lacks an effect is right in some points and far off in others. Squares would let the worst points decide;
so the numbers follow what most points agree on, and what is missing stays visible in the others.

Source: P. J. Huber, "Robust estimation of a location parameter", Ann. Math. Statist. 35 (1964), in its smooth form.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.fitting.normal import units

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]

__all__ = ["loss", "positive", "solve", "weights", "without"]

#: Residuals above so many standard errors count by their size, not its square.
_DELTA: Final = 4.0
_ROUNDS: Final = 12
_SAME: Final = 1e-3
#: What is less beside the largest is no direction at all.
_NO_DIRECTION: Final = 1e-10
#: Of products of columns at least this share is no chance, for a step.
LEAST_LEFT: Final = 0.2
#: Bounds are at least this far apart, in standard errors.
_NARROW: Final = 1e-12


def loss(residual: Floats) -> float:
    """Return the sum over independent residuals of unit variance: their squares while they are small."""
    return float(np.sum(2.0 * _DELTA**2 * (np.sqrt(1.0 + (residual / _DELTA) ** 2) - 1.0)))


def weights(residual: Floats) -> Floats:
    """Return the weights with which squares have the same gradient as the loss."""
    return np.asarray(1.0 / np.sqrt(1.0 + (residual / _DELTA) ** 2))


def solve(
    columns: Floats,
    residual: Floats,
    precision: Floats,
    towards: Floats,
    lowest: Floats,
    highest: Floats,
    chance: Callable[[Floats], Floats] | None = None,
) -> tuple[Floats, float]:
    """Return the coefficients of columns that explain a residual best, and by how much the loss falls.

    Parameters
    ----------
    columns
        (n, k); chance in them makes coefficients and fall smaller than they are in truth, never larger, unless it is
        known.
    precision, towards
        (k,) of a normal prior of the coefficients.
    lowest, highest
        (k,) bounds of the coefficients, with 0 between them.
    chance
        What chance in the columns adds to their products with each other, (k, k), with these weights (n,).
    """
    c = np.clip(np.zeros(columns.shape[1]), lowest, highest)
    before = loss(residual)
    for _ in range(_ROUNDS):
        w = weights(residual - columns @ c)[:, None]
        left = columns.T @ (w * columns)
        if chance is not None:
            left = without(left, chance(w[:, 0]))
        left = left + np.diag(precision)
        right = columns.T @ (w[:, 0] * residual) + precision * towards
        new = _bounded(left, right, lowest, highest)
        done = float(np.max(np.abs(new - c) / (np.abs(new) + 1e-12), initial=0.0)) < _SAME
        c = new
        if done:
            break
    after = loss(residual - columns @ c) + float(precision @ ((c - towards) ** 2 - towards**2))
    if chance is not None:
        w = weights(residual - columns @ c)
        all_of_it = columns.T @ (w[:, None] * columns)
        after -= float(c @ (all_of_it - without(all_of_it, chance(w))) @ c)
    return c, before - after


def mean_and_chance(first: Floats, second: Floats) -> tuple[Floats, Floats]:
    """Return what two sensors tell together, and the chance in it: half of what they differ by."""
    return 0.5 * (first + second), 0.5 * (first - second)


def shared(first: Floats, second: Floats) -> Floats:
    """Return the products of columns of which two sensors tell: of one's with the other's, without their chance."""
    both = first.T @ second
    return positive(0.5 * (both + both.T))


def without(products: Floats, chance: Floats, least: float = LEAST_LEFT) -> Floats:
    """Return the products of columns with each other less what chance adds to them; in no direction most of it.

    Where nearly all is chance a direction would be left in which columns do not move at all, and a step along it
    might go anywhere.

    Parameters
    ----------
    least
        Share that is left of any direction.
    """
    scale, unit = units(products)
    values, vectors = np.linalg.eigh(products * np.outer(unit, unit))
    kept = values > _NO_DIRECTION * values[-1]
    root, inverse = vectors[:, kept] * np.sqrt(values[kept]), vectors[:, kept] / np.sqrt(values[kept])
    share = np.eye(int(kept.sum())) - inverse.T @ (chance * np.outer(unit, unit)) @ inverse
    left, directions = np.linalg.eigh(0.5 * (share + share.T))
    share = (directions * np.maximum(left, least)) @ directions.T
    return np.asarray(root @ share @ root.T * np.outer(scale, scale))


def positive(matrix: Floats) -> Floats:
    """Return the nearest symmetric matrix without negative eigenvalues, whatever the units of the coordinates.

    A coordinate of which nothing but chance is known is left at zero.
    """
    scale, unit = units(matrix)
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T) * np.outer(unit, unit))
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T * np.outer(scale, scale))


def _bounded(left: Floats, right: Floats, lowest: Floats, highest: Floats) -> Floats:
    """Return the minimum of the quadratic form ``c left c / 2 - right c`` within bounds."""
    scale, unit = units(left)
    values, vectors = np.linalg.eigh(left * np.outer(unit, unit))
    kept = values > _NO_DIRECTION * values[-1]
    roots = np.sqrt(values[kept])
    columns = roots[:, None] * vectors[:, kept].T
    target = (vectors[:, kept].T @ (unit * right)) / roots
    free = np.linalg.lstsq(columns, target, rcond=None)[0] * unit
    if np.all((free >= lowest) & (free <= highest)):
        return np.asarray(free)
    known = scale > 0.0  # of what nothing is known nothing is asked
    low, high = lowest[known] * scale[known], highest[known] * scale[known]
    found = np.zeros(right.size)
    found[known] = _bvls(columns[:, known], target, low, high) * unit[known]
    return np.clip(found, lowest, highest)


def _bvls(columns: Floats, target: Floats, low: Floats, high: Floats) -> Floats:
    """Return the least-squares solution within bounds (P. B. Stark, R. L. Parker, Comput. Statist. 10, 1995)."""
    from scipy.optimize import lsq_linear

    return np.asarray(lsq_linear(columns, target, bounds=(low, np.maximum(high, low + _NARROW)), method="bvls").x)
