"""Numbers along which what is expected goes in bends: a fit is looked at along them, value by value.

A window within which a second event is held back does to the events of a pulse all that it can once it is as long as
the pulse, and hardly anything more until it outlasts the pause. A slope across such a bend leads to neither side of
it, and does not say how well the number is known. So other values are looked at, the other numbers following along
straight lines: the best is where the fit is, and those that leave no more than chance beyond it are the interval.

Source: D. R. Cox, D. V. Hinkley, "Theoretical Statistics", Chapman and Hall (1974), section 9.3 (profile likelihood).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.expected.catalogue import BENT
from bench.diagnosis.fitting.explaining import followed
from bench.diagnosis.fitting.looks import shifted
from bench.diagnosis.fitting.moving import moved
from bench.diagnosis.fitting.steps import inside, with_coordinate

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import numpy.typing as npt

    from bench.diagnosis.expected.problem import Problem
    from bench.diagnosis.expected.residuals import Expectation
    from bench.diagnosis.fitting.fitted import Fit

    Floats = npt.NDArray[np.float64]

__all__ = ["looked_along"]

#: Values that are looked at first, in standard errors from where the fit is, with both ends of the range; and the
#: standard error, as a share of the value, where nothing is known of it.
_FROM_HERE: Final = (-16.0, -8.0, -4.0, -2.0, -1.0, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0)
_UNKNOWN: Final = 0.1
#: Then those in the gaps around the best one, and in which the interval ends: at these shares of a gap.
_IN_GAPS: Final = (0.25, 0.5, 0.75)
#: The same random numbers are in all, and what is expected where the fit is is known better, from one look with so
#: many times the usual effort: what a fit has seen on its way it has moved to where it ended along slopes. With this
#: effort losses differ by about 1 by chance; the farther away, the more.
_EFFORT: Final = 3.0
_HERE: Final = 4.0
#: So where the fit has moved by more than this share of its interval, all is done again from there, so often.
_STAYED: Final = 0.5
_ROUNDS: Final = 3
#: Of the 90 % interval of a number: chi-squared of one degree of freedom.
_NINETY: Final = 2.7055


def looked_along(problem: Problem, found: Fit, seed: int) -> Fit:
    """Return a fit at the best value of each number that goes in bends, with the interval of each.

    Parameters
    ----------
    seed
        Of other simulations than those of the fit.
    """
    bent = [i for i, slot in enumerate(found.slots) if (slot.free.owner, slot.free.name) in BENT]
    for number, i in enumerate(bent):
        for turn in range(_ROUNDS):
            at, mine = float(found.x[i]), seed + 10 * number + 2 * turn
            found = _along(problem, moved(problem, found, found.x, mine, _HERE), i, mine + 1)
            low, high = found.between[i]
            if abs(float(found.x[i]) - at) <= _STAYED * (high - low):
                break
    return found


@dataclass(frozen=True, eq=False)
class _Look:
    """A fit at another value of one number, to which the others have followed."""

    at: float  #: coordinate of the number
    loss: float
    value: Floats  #: (n,) expected, transformed, before the others have followed
    ratio: Floats  #: (n,) the same in the unit of the label
    moved: Floats  #: (k,) how far the others went


class _Profile:
    """What other values of one number of a fit leave, in order."""

    def __init__(self, problem: Problem, found: Fit, i: int, seed: int) -> None:
        self._problem, self._found, self._i, self._seed = problem, found, i, seed
        at = float(found.x[i])
        self._here = self._expected([at])[0]
        self.looks = [self._look(at, self._here)]

    def look(self, values: Sequence[float]) -> None:
        """Look at other values of the number."""
        new = map(self._look, values, self._expected(values))
        self.looks = sorted([*self.looks, *new], key=lambda look: look.at)

    def _expected(self, values: Sequence[float]) -> list[Expectation]:
        """Return what is expected at some values, with the same random numbers for all."""
        found = self._found
        xs = [with_coordinate(found.x, self._i, value) for value in values]
        models = [self._problem.models(found.model, found.slots, x) for x in xs]
        simulated = self._problem.simulate(models, self._seed, _EFFORT)
        return [
            shifted(self._problem, self._problem.expect(sensors), found.slots, x)
            for x, sensors in zip(xs, simulated, strict=True)
        ]

    def _look(self, at: float, there: Expectation) -> _Look:
        """Return what is left at a value; statistics of which one of the simulations says nothing stay."""
        found, here = self._found, self._here
        value = found.value + np.where(here.said & there.said, there.value - here.value, 0.0)
        loss, moved = followed(self._problem, found, value, holding=self._i)
        ratio = found.ratio + np.nan_to_num(there.ratio - here.ratio)
        return _Look(at, loss, value, ratio, moved)

    @property
    def best(self) -> _Look:
        """The look that leaves least."""
        return min(self.looks, key=lambda look: look.loss)

    @property
    def most(self) -> float:
        """The loss of values at the ends of the interval."""
        return self.best.loss + _NINETY * self._found.common * self._found.caution

    def in_gaps(self) -> list[float]:
        """Return values to look at next: around the best one, and where the interval ends."""
        best = self.best
        gaps = {
            (a.at, b.at) for a, b in pairwise(self.looks)
            if best in (a, b) or (a.loss > self.most) != (b.loss > self.most)
        }  # fmt: skip
        return sorted(a + share * (b - a) for a, b in gaps for share in _IN_GAPS)

    def interval(self) -> tuple[float, float]:
        """Return the values around the best one that leave no more than chance beyond it."""
        here = self.looks.index(self.best)
        return self._end(self.looks[here::-1]), self._end(self.looks[here:])

    def _end(self, outwards: Sequence[_Look]) -> float:
        """Return where the loss becomes too large; the last value where it does not."""
        for a, b in pairwise(outwards):
            if b.loss > self.most:
                return a.at + (b.at - a.at) * (self.most - a.loss) / (b.loss - a.loss)
        return outwards[-1].at


def _along(problem: Problem, found: Fit, i: int, seed: int) -> Fit:
    profile = _Profile(problem, found, i, seed)
    profile.look(list(_first(problem, found, i)))
    profile.look(profile.in_gaps())
    best = profile.best
    x = inside(found.slots, with_coordinate(found.x, i, best.at) + best.moved)
    value = best.value + found.jacobian.mean(axis=0) @ best.moved
    return replace(
        found,
        model=problem.of_settings(found.model, found.slots, x)[0],
        x=x,
        value=value,
        ratio=best.ratio,
        residual=problem.measured.value - value,
        between={**found.between, i: profile.interval()},
    )


def _first(problem: Problem, found: Fit, i: int) -> Iterator[float]:
    """Yield the other values that are looked at first, inside the range of the number."""
    here, (low, high) = float(found.x[i]), found.slots[i].free.range
    sd = float(np.sqrt(found.scatter(problem.measured.points)[i, i]))
    step = sd if np.isfinite(sd) and sd > 0.0 else _UNKNOWN * abs(here)
    inner = {value for value in (here + s * step for s in _FROM_HERE) if low < value < high}
    yield from sorted((inner | {value for value in (low, high) if np.isfinite(value)}) - {here})
