"""What was expected at many places: nearby, straight lines through all of it tell what is expected in between.

One simulation with little effort is uncertain; a difference of two, beside each other, is hardly more than chance.
Lines through a cloud of places use every simulation for every coordinate, and say how much chance is left in them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.expected.residuals import filled

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.diagnosis.expected.residuals import Expectation

    Floats = npt.NDArray[np.float64]

__all__ = ["Cloud", "Lines", "Place", "around"]

#: The weight of what is known before of a slope, beside that of one simulation: none is taken to be infinite.
_RIDGE: Final = 1e-3
#: Places that lines go through exactly do not tell the scatter: no smaller a share of them counts.
_LEAST_FREEDOM: Final = 0.1


@dataclass(frozen=True)
class Place:
    """Coordinates, and what is expected there."""

    at: Floats  #: (k,)
    expected: Expectation
    loss: float


@dataclass(frozen=True)
class Lines:
    """Straight lines through what is expected."""

    value: Floats  #: (n,) in the middle
    slope: Floats  #: (n, k) by coordinate
    chance: Floats  #: (k, k) covariance of the slopes of a statistic whose values scatter by one
    scatter: Floats  #: (n,) variance of the values about the lines


class Cloud:
    """Places that were looked at, all of them with equal effort."""

    def __init__(self, places: Sequence[Place] = ()) -> None:
        self.places = list(places)

    def lines(self, middle: Floats, scale: Floats, reach: float) -> Lines:
        """Return straight lines through the places around a middle; what is further away counts less.

        Parameters
        ----------
        middle, scale
            (k,) where, and the unit of each coordinate.
        reach
            Distance, in units, at which a place counts by 0.6.
        """
        away = np.stack([(place.at - middle) / scale for place in self.places])
        weight = np.exp(-0.5 * np.sum(away**2, axis=1) / (reach**2 * len(middle)))
        columns = np.column_stack([np.ones(len(away)), away / reach])
        weighted = columns * weight[:, None]
        # Where a place says nothing of a statistic, it is as in the mean of the others.
        values = filled(np.stack([place.expected.value_or(np.nan) for place in self.places]), weight)
        inverse = np.linalg.inv(columns.T @ weighted + _RIDGE * np.diag([0.0, *np.ones(len(middle))]))
        found = inverse @ (weighted.T @ values)
        rest = values - columns @ found
        # What of the chance in all values is left in each, once lines are drawn.
        hat = columns @ inverse @ weighted.T
        left = 1.0 - 2.0 * np.diag(hat) + np.sum(hat**2, axis=1)
        freedom = max(float(weight @ left), _LEAST_FREEDOM * float(weight.sum()))
        unit = reach * scale
        return Lines(
            value=found[0],
            slope=np.asarray(found[1:].T / unit),
            chance=(inverse @ (weighted.T @ weighted) @ inverse)[1:, 1:] / np.outer(unit, unit),
            scatter=np.asarray((weight @ rest**2) / freedom),
        )


def around(middle: Floats, scale: Floats, reach: float, count: int, rng: np.random.Generator) -> list[Floats]:
    """Return places around a middle, in opposite pairs along directions that are at right angles to each other."""
    k = len(middle)
    found: list[Floats] = []
    while len(found) < count:
        directions = np.linalg.qr(rng.standard_normal((k, k)))[0] * np.sqrt(k)
        for direction in directions:
            found += [middle + reach * scale * direction, middle - reach * scale * direction]
    return found[:count]
