"""A fit that may have stopped in a valley is done again, from other places.

Three kinds of valleys are known. What is known beforehand, a dead time, was let go and stands in for something else.
A shape trades places with a size along a bent line: slow noise of twice the rms and four times the time wanders
as far in a pulse. And of a threshold of which only rare events tell nothing tells where none is expected: there is no
slope that leads back. What is left in a valley looks as if an effect were missing.
"""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.expected.catalogue import details_of, switches
from bench.diagnosis.fitting.approach import approach, known_beforehand
from bench.diagnosis.fitting.explaining import followed
from bench.diagnosis.fitting.fit import finish
from bench.diagnosis.fitting.fitted import prior_precision, solve
from bench.diagnosis.fitting.judging import deviance_per_dof, leaves_more_than_chance
from bench.diagnosis.fitting.looks import shifted
from bench.diagnosis.fitting.sharpening import is_costly
from bench.diagnosis.fitting.steps import inside, with_coordinate

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import numpy.typing as npt

    from bench.diagnosis.expected.problem import Problem, Slot
    from bench.diagnosis.fitting.fitted import Fit
    from sim_backend.pixel.model import PixelModel

    Floats = npt.NDArray[np.float64]

__all__ = ["settled", "unknown_shapes"]

#: A deviance that is larger than that of a true model, and not by more than this factor, may be that of a fit in a
#: valley; with a shape that is not known, valleys are deeper.
_VALLEY: Final = 2.0
_DEEP_VALLEY: Final = 5.0
#: Another place is better when the deviance falls by this share.
_BETTER: Final = 0.03
#: Steps from another place on; shapes that are tried, beside the one found; how often one goes on from there.
_STEPS: Final = 3
_SHAPES: Final = (0.5, 2.0)
_ROUNDS: Final = 3
_THRESHOLDS: Final = "thresholds"
_RESPONSE: Final = "response"
#: Thresholds that are looked at beside the one found, closely: rare events come and go within a tenth of it. The
#: effort for each; one is gone on from where the loss is lower by so much.
_THRESHOLD_FACTORS: Final = (0.63, 0.71, 0.79, 0.89, 1.12, 1.26, 1.41)
_EFFORT: Final = 4.0
_LEAST_FALL: Final = 8.0
_LOOKED_AT: Final = 7


def settled(problem: Problem, found: Fit, seed: int) -> Fit:
    """Return a fit, or a better one of the same model where more is left than chance leaves.

    Parameters
    ----------
    seed
        Of other simulations than those of the fit.
    """
    shapes = unknown_shapes(problem, found.model, found.slots)
    most = _DEEP_VALLEY if shapes else _VALLEY
    if deviance_per_dof(problem, found) <= most:
        found = _with_other_thresholds(problem, found, seed + _LOOKED_AT)
    places = [np.where(known_beforehand(found.slots), found.start, found.x)]
    for number in range(_ROUNDS):
        if deviance_per_dof(problem, found) > most or not leaves_more_than_chance(problem, found):
            return found
        places += _other_shapes(problem, found, shapes)
        tried = [_from(problem, found, to, seed + 10 * number + i) for i, to in enumerate(places)]
        best = min([found, *tried], key=lambda one: deviance_per_dof(problem, one))
        if not shapes or deviance_per_dof(problem, best) > (1.0 - _BETTER) * deviance_per_dof(problem, found):
            return best
        found, places = best, []
    return found


def unknown_shapes(problem: Problem, model: PixelModel, slots: Sequence[Slot]) -> list[int]:
    """Return the places of the numbers that shape an effect and do not switch it on, of which nothing is known."""
    found = []
    for i, slot in enumerate(slots):
        effect = model.effect(slot.free.owner)
        if effect is None:
            continue
        details = (free.name for free, _ in details_of(type(effect)))
        known = {*problem.given.get(effect.id, {}), *(f.name for f in switches(type(effect))), *details}
        found += [i] * (slot.free.name not in known)
    return found


def _from(problem: Problem, found: Fit, place: Floats, seed: int, *, precise: bool = False) -> Fit:
    """Return the same model fitted from another place on."""
    near = approach(problem, found.model, found.slots, list(place), seed=seed, iterations=_STEPS, prior=found.start)
    return finish(problem, near, precise=precise)


def _with_other_thresholds(problem: Problem, found: Fit, seed: int) -> Fit:
    """Return a fit, or a better one with another threshold, where no pulses ask for the polarity.

    Its squares may be no more than those of chance, and rare events be of the wrong number. Two fits know their
    squares no better than that: what the same random numbers say of both decides, unless much is left.
    """
    for number in range(_ROUNDS):
        place = _other_threshold(problem, found, seed + 10 * number)
        if place is None:
            break
        again = _from(problem, found, place, seed + 10 * number, precise=is_costly(problem, found))
        worse = deviance_per_dof(problem, again) >= deviance_per_dof(problem, found)
        if worse and leaves_more_than_chance(problem, again):
            break
        found = again
    return found


def _other_threshold(problem: Problem, found: Fit, seed: int) -> Floats | None:
    """Return the best place with another threshold, the others following along straight lines, if it is better.

    All are looked at with the same random numbers, so that their differences are sharp. The threshold itself does not
    follow: it would go back.
    """
    labels = problem.measured.labels
    answers = {(problem.setting[label.point], label.part) for label in labels if label.view == _RESPONSE}
    mine = [
        i for i, slot in enumerate(found.slots)
        if slot.free.owner == _THRESHOLDS and (slot.setting or 0, slot.free.name) not in answers
    ]  # fmt: skip
    changes = list(product(mine, _THRESHOLD_FACTORS))
    if not changes:
        return None
    tries = [found.x, *(_with_other(found, i, factor) for i, factor in changes)]
    held = [None, *(i for i, _ in changes)]
    models = [problem.models(found.model, found.slots, x) for x in tries]
    here, *there = (
        followed(
            problem, found, shifted(problem, problem.expect(sensors), found.slots, x).value_or(found.value), holding=i
        )
        for i, x, sensors in zip(held, tries, problem.simulate(models, seed, _EFFORT), strict=True)
    )
    best = int(np.argmin([loss for loss, _ in there]))
    loss, moved = there[best]
    better = loss < here[0] - _LEAST_FALL * found.common
    return inside(found.slots, tries[1 + best] + moved) if better else None


def _with_other(found: Fit, i: int, factor: float) -> Floats:
    """Return coordinates with one number multiplied by a factor."""
    free = found.slots[i].free
    to = free.coordinate(factor * free.value(float(found.x[i])))
    return inside(found.slots, with_coordinate(found.x, i, to))


def _other_shapes(problem: Problem, found: Fit, shapes: Sequence[int]) -> Iterator[Floats]:
    """Yield places with another shape, to which the other numbers follow along straight lines."""
    columns = found.whiten(found.jacobian.mean(axis=0), problem.measured.points)
    precision = prior_precision(found.slots)
    for i in shapes:
        others = np.arange(len(found.x)) != i
        for factor in _SHAPES:
            to = _with_other(found, i, factor)
            moved = to[i] - found.x[i]
            to[others] -= solve(columns[:, others], columns[:, i] * moved, precision[others])
            yield inside(found.slots, to)
