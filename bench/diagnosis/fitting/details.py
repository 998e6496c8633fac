"""Details of an effect that is in the model: what is usual until the data ask for another value.

A dark current is the same in all pixels, a queue is long: as long as that explains the run, a number more would only
make the others less certain. Where it does not, each of these numbers is tried at some values, the others following
along straight lines; if one does better, it is free from then on.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.expected.catalogue import details_of
from bench.diagnosis.expected.parameters import put
from bench.diagnosis.expected.problem import Slot
from bench.diagnosis.fitting.approach import approach
from bench.diagnosis.fitting.explaining import followed
from bench.diagnosis.fitting.fit import finish
from bench.diagnosis.fitting.judging import deviance_per_dof, leaves_more_than_chance
from bench.diagnosis.fitting.looks import shifted
from bench.diagnosis.fitting.steps import inside

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

    from bench.diagnosis.expected.parameters import Free
    from bench.diagnosis.expected.problem import Problem
    from bench.diagnosis.fitting.fitted import Fit

    Floats = npt.NDArray[np.float64]

__all__ = ["with_a_detail"]

#: Effort of a look at a value; the loss is to fall by so much, and the deviance of the fit by this share.
_EFFORT: Final = 1.0
_LEAST_FALL: Final = 30.0
_BETTER: Final = 0.03
_STEPS: Final = 4


def with_a_detail(problem: Problem, found: Fit, seed: int, beat: float = 0.0) -> Fit:
    """Return a fit, or a better one in which a detail of its effects is free.

    Parameters
    ----------
    seed
        Of other simulations than those of the fit.
    beat
        Fall of the loss that an effect more promises: a detail that promises less may only stand in for it.
    """
    if not leaves_more_than_chance(problem, found):
        return found
    best = _most_promising(problem, found, seed, max(beat, _LEAST_FALL))
    if best is None:
        return found
    again = _set_free(problem, found, *best, seed + 1)
    better = deviance_per_dof(problem, again) <= (1.0 - _BETTER) * deviance_per_dof(problem, found)
    return again if better else found


def _closed(found: Fit) -> Iterator[tuple[Free, float]]:
    """Yield the numbers that are not free yet, each with values to try."""
    known = {(slot.free.owner, slot.free.name) for slot in found.slots}
    for effect in found.model.effects:
        for free, tries in details_of(type(effect)):
            if (free.owner, free.name) not in known:
                yield from ((free, value) for value in tries)


def _most_promising(
    problem: Problem, found: Fit, seed: int, least: float
) -> tuple[Free, float, Floats] | None:  # fmt: skip
    """Return the number and value with which the loss is least, and the coordinates of the others; None: as now."""
    tries = list(_closed(found))
    if not tries:
        return None
    base = found.models(problem)
    models = [base, *([put(one, [free], [free.coordinate(value)]) for one in base] for free, value in tries)]
    left = []
    for sensors in problem.simulate(models, seed, _EFFORT):
        there = shifted(problem, problem.expect(sensors), found.slots, found.x)
        left.append(followed(problem, found, there.value_or(found.value)))
    best = int(np.argmin([loss for loss, _ in left[1:]]))
    loss, moved = left[1 + best]
    if loss > left[0][0] - least:
        return None
    return *tries[best], inside(found.slots, found.x + moved)


def _set_free(problem: Problem, found: Fit, free: Free, value: float, others: Floats, seed: int) -> Fit:
    """Return the model with one number more that is free, fitted."""
    slots = (*found.slots, Slot(free))
    at = free.coordinate(value)
    model = put(found.model, [free], [at])
    near = approach(
        problem, model, slots, [*others, at], seed=seed, iterations=_STEPS, prior=np.append(found.start, at)
    )
    return finish(problem, near)
