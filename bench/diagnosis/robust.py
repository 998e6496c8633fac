"""Least squares for small residuals, least absolute values for large ones.

A model that lacks an effect is right in some points and far off in others. Squares would let the worst points decide;
so the numbers follow what most points agree on, and what is missing stays visible in the others.

Source: P. J. Huber, "Robust estimation of a location parameter", Ann. Math. Statist. 35 (1964), in its smooth form.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]

__all__ = ["loss", "solve", "weights"]

#: Residuals above so many standard errors count by their size, not its square.
_DELTA: Final = 4.0
_ROUNDS: Final = 12
_SAME: Final = 1e-3


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
        (k,) bounds of the coefficients.
    chance
        What chance in the columns adds to their products with each other, (k, k), with these weights (n,).
    """
    c = np.clip(np.zeros(columns.shape[1]), lowest, highest)
    before = loss(residual)
    for _ in range(_ROUNDS):
        w = weights(residual - columns @ c)[:, None]
        left = columns.T @ (w * columns)
        if chance is not None:
            left = positive(left - chance(w[:, 0]))
        left = left + np.diag(precision)
        right = columns.T @ (w[:, 0] * residual) + precision * towards
        new = _bounded(left, right, lowest, highest)
        done = float(np.max(np.abs(new - c) / (np.abs(new) + 1e-12), initial=0.0)) < _SAME
        c = new
        if done:
            break
    after = loss(residual - columns @ c) + float(precision @ ((c - towards) ** 2 - towards**2))
    if chance is not None:
        after -= float(c @ chance(weights(residual - columns @ c)) @ c)
    return c, before - after


def positive(matrix: Floats) -> Floats:
    """Return the nearest symmetric matrix without negative eigenvalues, whatever the units of the coordinates.

    A coordinate of which nothing but chance is known is left at zero.
    """
    scale = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    unit = np.where(scale > 0.0, 1.0 / np.where(scale > 0.0, scale, 1.0), 0.0)
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T) * np.outer(unit, unit))
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T * np.outer(scale, scale))


def _bounded(left: Floats, right: Floats, lowest: Floats, highest: Floats) -> Floats:
    """Return the minimum of a quadratic form within bounds, by fixing what goes beyond them."""
    free = np.ones(right.size, np.bool_)
    found = np.zeros(right.size)
    for _ in range(right.size):
        if not free.any():
            break
        inner = left[np.ix_(free, free)]
        found[free] = np.linalg.lstsq(inner, right[free] - left[np.ix_(free, ~free)] @ found[~free], rcond=1e-10)[0]
        beyond = free & ((found < lowest) | (found > highest))
        if not beyond.any():
            break
        found = np.where(beyond, np.clip(found, lowest, highest), found)
        free &= ~beyond
    return found
