"""How far a threshold can be moved while the other numbers follow: the valley of chi-square.

Threshold, low-pass and delay trade places: a slower pixel with a lower threshold answers as many pulses, and hardly
later. That valley is bent, so what derivatives say of it at its lowest place is too little. Its ends are looked for
by moving the threshold until chi-square has risen by as much as belongs to a 90 % interval.

Source: D. J. Venzon, S. H. Moolgavkar, "A method for computing profile-likelihood-based confidence intervals", Appl.
Statist. 37 (1988).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from bench.characterize.family_descent import held_at

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from bench.characterize.family_problem import Problem

    Floats = npt.NDArray[np.float64]

__all__ = ["Lower", "ends_of"]

_LOOKS: Final = 3  # on each side
_FARTHER: Final = 2.0  # from look to look, at the most
_BEYOND: Final = 1.5  # the last look, at the most
_SEEN: Final = 0.9  # of the wanted rise: there is no need to look farther
_LOWER: Final = 0.1  # of chi-square: so much lower is not the numbers' chance to be little


@dataclass(frozen=True, slots=True)
class Lower:
    """A place that is lower than what was taken for the lowest."""

    x: Floats


def ends_of(
    problem: Problem, x: Floats, reach: float, rise: float, slopes: Floats, scale: Floats
) -> tuple[Floats, Floats] | Lower:  # fmt: skip
    """Return the numbers where the threshold is as low, and as high, as a rise of chi-square allows.

    Parameters
    ----------
    x
        (f,) the numbers with the least chi-square.
    reach
        How far the threshold may be moved by the derivatives; the ends are no nearer.
    rise
        Of chi-square, that is wanted.
    slopes, scale
        Derivatives of what is expected, and steps of the numbers.
    """
    place = problem.free.index("theta")
    residual = problem.residuals(x)
    least = float(residual @ residual)
    ends = []
    for side in (-1.0, 1.0):
        at, far, end = x, reach, x
        for _ in range(_LOOKS):
            begin = at.copy()
            begin[place] = x[place] + side * far
            at, there = held_at(problem, begin, place, slopes, scale)
            if there < least - _LOWER:
                return Lower(at)
            part = math.sqrt(max(there - least, 0.0) / rise)
            longer = 1.0 / max(part, 1.0 / _FARTHER)
            end = x + max(min(longer, _BEYOND), reach / far) * (at - x)
            if part > _SEEN:
                break
            far *= longer
        ends.append(end)
    return ends[0], ends[1]
