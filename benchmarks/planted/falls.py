"""How much of a difference between two expectations some changes take up, told from two sets of simulations.

Simulated expectations are uncertain, and the square of a difference would count that as size: the product of two
differences from sensors that have nothing in common does not.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.fitting.normal import units

if TYPE_CHECKING:
    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]
    Pair = tuple[Floats, Floats]  #: of sets of sensors that have no random numbers in common

__all__ = ["believed", "beside", "fall", "taken_up", "uncertainty"]

#: Of a direction with a smaller share of what they do, changes are not known well enough to take up anything.
_NO_DIRECTION: Final = 3e-3
#: Changes by a number count where they stand out by so many standard errors.
_BELIEVED: Final = 3.0


def uncertainty(first: Floats, second: Floats) -> float:
    """Return the standard error of the product of two differences, from how the two differ."""
    chance = 0.5 * float(np.mean((first - second) ** 2))
    mean = 0.5 * (first + second)
    return math.sqrt(2.0 * chance * float(mean @ mean) + len(first) * chance**2)


def fall(apart: Pair, changes: Pair, prior: Floats, moved: Floats | None = None) -> float:
    """Return the product of two differences beyond what least squares takes up along some changes.

    Parameters
    ----------
    apart
        (n,) whitened, with independent errors.
    changes
        (n, k) whitened, by each number that is free, with errors that are independent of each other and of those.
    prior
        (k,) precision with which each of them is known before.
    moved
        (k,) by how much each is elsewhere than where it is known to be.
    """
    moved = np.zeros(len(prior)) if moved is None else moved
    right = _along(apart, changes) - prior * moved
    before = apart[0] @ apart[1] + prior @ moved**2
    return float(before - right @ taken_up(apart, changes, prior, moved))


def taken_up(apart: Pair, changes: Pair, prior: Floats, moved: Floats | float = 0.0) -> Floats:
    """Return (k,) how much of each change explains most of a difference; see :func:`fall`."""
    first, second = changes
    left = first.T @ second
    left = 0.5 * (left + left.T) + np.diag(prior)
    unit = units(left)[1]
    values, vectors = np.linalg.eigh(left * np.outer(unit, unit))
    kept = values > _NO_DIRECTION
    inverse = (vectors[:, kept] / values[kept]) @ vectors[:, kept].T
    return np.asarray(unit * (inverse @ (unit * (_along(apart, changes) - prior * moved))))


def _along(apart: Pair, changes: Pair) -> Floats:
    return np.asarray(0.5 * (changes[0].T @ apart[1] + changes[1].T @ apart[0]))


def beside(some: Pair, others: Pair) -> Pair:
    """Return (n, k) changes beside others."""
    first, second = (np.concatenate(both, axis=1) for both in zip(some, others, strict=True))
    return first, second


def believed(first: Floats, second: Floats) -> Pair:
    """Return changes, without those by numbers of which nothing shows that stands out of chance.

    It would be in need of long ways to take anything up, and would seem to take up much.
    """
    seen = [a @ b > _BELIEVED * uncertainty(a, b) for a, b in zip(first.T, second.T, strict=True)]
    return first * seen, second * seen
