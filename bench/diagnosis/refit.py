"""A model with an effect more, fitted; and whether two such models, or the effect at all, can be told apart."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.approach import approach, further, scanned
from bench.diagnosis.catalogue import free_of, probe_of, switches
from bench.diagnosis.fit import finish
from bench.diagnosis.judging import deviance
from bench.diagnosis.problem import Slot
from bench.diagnosis.screen import basis_of, beyond
from bench.diagnosis.steps import inside

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bench.diagnosis.approach import Approach
    from bench.diagnosis.fitted import Fit
    from bench.diagnosis.problem import Problem
    from bench.diagnosis.screen import Scores

__all__ = ["Found", "needless", "refitted", "separation"]

#: An effect whose numbers are all fewer standard errors from null is needless.
_NEEDED: Final = 2.0
#: Steps of a fit where the model was far off, and where it was not; and the relative error that what is expected may
#: have at the start where it was.
_FAR: Final = 6
_NEAR: Final = 3
_WRONG: Final = 0.1
_FURTHER: Final = 4
_EFFORT: Final = 1.0
#: Sizes of an effect that are tried with the base numbers of another: beside that of the catalogue, then beside the
#: best so far; and up to which loss, beside that of the best effect, what was found is gone on with.
_SCANS: Final = ((0.03, 0.1, 0.25, 0.5, 1.0, 2.0, 4.0), (0.6, 0.8, 1.25, 1.6), (0.9, 1.1))
_WORTH_STEPS: Final = 10.0
#: Relative error that what is expected may have there, and how far the first step goes.
_LESS_WRONG: Final = 0.03
_SHORT_OF: Final = 0.2
#: Standard errors of a separation that are taken off.
_SURELY: Final = 2.0
#: Models whose loss, with little effort, is more than so many times that of the best, and so much more for chance,
#: are out of the race.
_RIVALS: Final = (1.5, 100.0)
_EARLY_RIVALS: Final = (3.0, 100.0)


@dataclass(frozen=True)
class Found:
    """A candidate, refitted."""

    effect: str
    fit: Fit
    deviance: float


def refitted(
    problem: Problem, here: Fit, scores: Scores, candidates: Sequence[int], seed: int, far_off: bool
) -> list[Found]:
    """Return the models with one of these candidates more, fitted; those that come close to the best of them."""
    near = {i: _approach(problem, here, scores, i, seed, far_off) for i in candidates}
    if far_off:
        near = _again_from_the_best(problem, near)
        near = _rivals(near, _EARLY_RIVALS)
        near = {i: further(problem, one, _FURTHER) for i, one in near.items()}
    near = _rivals(near, _RIVALS)
    found = []
    for i, one in near.items():
        fitted = finish(problem, one)
        found.append(Found(scores.probes[i].effect.id, fitted, deviance(problem, fitted, here.scale)))
    return found


def _again_from_the_best(problem: Problem, near: dict[int, Approach]) -> dict[int, Approach]:
    """Return the approaches, those of the others begun again with the base numbers of the best if that is better.

    Far from the minimum an effect is tried with base numbers that have tried to stand in for it. Where another effect
    has been found to do as well, its base numbers are the right ones.
    """
    best = min(near, key=lambda i: near[i].loss)
    base = [x for slot, x in zip(near[best].slots, near[best].at, strict=True) if not slot.free.effect]
    return {i: one if i == best else _rescaled(problem, one, base, near[best].loss) for i, one in near.items()}


def _rescaled(problem: Problem, one: Approach, base: Sequence[float], least: float) -> Approach:
    """Return the approach, or the one from these base numbers and the size that suits them best if that is better.

    `least` is the loss of the best of all: what does not come near to it is not worth the steps.
    """
    added = one.model.effects[-1]
    names = {f.name for f in switches(type(added))}
    mine = [i for i, slot in enumerate(one.slots) if slot.free.owner == added.id and slot.free.name in names]
    at = one.at.copy()
    at[[i for i, slot in enumerate(one.slots) if not slot.free.effect]] = base
    size = np.array([one.slots[i].free.coordinate(one.slots[i].free.probe) for i in mine])
    best = replace(one, loss=math.inf)
    for factors in _SCANS:
        tries = []
        for factor in factors:
            to = at.copy()
            to[mine] = factor * size
            tries.append(inside(one.slots, to))
        seen = scanned(problem, replace(one, cloud=best.cloud), tries)
        best = seen if seen.loss < best.loss else replace(best, cloud=seen.cloud)
        at = best.at
        size = at[mine]
    if best.loss > _WORTH_STEPS * least:
        return one
    again = approach(
        problem, one.model, one.slots, list(best.at), seed=one.seed, iterations=_FAR, wrong=_LESS_WRONG,
        prior=one.start, cloud=best.cloud, reach=_SHORT_OF,
    )  # fmt: skip
    return again if again.loss < one.loss else one


def _rivals(near: dict[int, Approach], most: tuple[float, float]) -> dict[int, Approach]:
    best = min((one.loss for one in near.values()), default=0.0)
    return {i: one for i, one in near.items() if one.loss <= most[0] * best + most[1]}


def _approach(problem: Problem, here: Fit, scores: Scores, i: int, seed: int, far_off: bool) -> Approach:
    """Return the model with candidate `i` more, near the minimum, from the numbers that the screen expects."""
    one = scores.probes[i]
    coordinates, values = [], {}
    shapes = [f for f in free_of(one.effect) if f not in one.free]
    for free, at, expected in zip(one.free, one.at, scores.size[i], strict=True):
        # From null itself no fit finds its way when the number has one sign only.
        start = expected if free.range[0] < 0.0 and expected != 0.0 else max(expected, 0.1 * at)
        coordinates.append(float(start))
        values[free.name] = free.value(float(start))
    for free in shapes:
        coordinates.append(free.coordinate(free.probe))
        values[free.name] = free.probe
    slots = (*here.slots, *(Slot(f) for f in (*one.free, *shapes)))
    base = here.x + (scores.base[i] if far_off else 0.0)
    iterations, wrong = (_FAR, _WRONG) if far_off else (_NEAR, 0.0)
    model = here.model + probe_of(one.effect, values, problem.given.get(one.effect.id))
    return approach(
        problem, model, slots, [*base, *coordinates], seed=seed, iterations=iterations, wrong=wrong,
        prior=np.array([*here.start, *coordinates]),
    )  # fmt: skip


def separation(problem: Problem, one: Found, other: Found, seed: int) -> float:
    """Return by how many standard errors a run like this one would tell two fitted models apart.

    What the free numbers of the first could take up is left out: both are as if fitted to the same data. It is a
    lower limit: what may be chance of the simulation tells nothing apart.
    """
    a, b = (problem.models(f.fit.model, f.fit.slots, f.fit.x) for f in (one, other))
    halves = next(problem.changes(a, [b], seed, _EFFORT))
    basis = basis_of(one.fit, problem)
    first, second = (beyond(basis, one.fit.whiten(half, problem.measured.points)[:, None])[:, 0] for half in halves)
    # The product of both halves has no chance in its mean; its standard error follows from their difference.
    chance = float(np.sum((first - second) ** 2)) / (2.0 * math.sqrt(len(first)))
    return math.sqrt(max(float(first @ second) - _SURELY * chance, 0.0))


def needless(problem: Problem, one: Fit, effect_id: str) -> bool:
    """Return whether all numbers of an effect are within chance of null."""
    sd = np.sqrt(np.diag(one.covariance(problem.measured.points)))
    effect = next(e for e in one.model.effects if e.id == effect_id)
    names = {f.name for f in switches(type(effect))}
    mine = [i for i, s in enumerate(one.slots) if s.free.owner == effect_id and s.free.name in names]
    return all(abs(one.x[i]) < _NEEDED * sd[i] for i in mine)
