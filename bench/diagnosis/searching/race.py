"""Models with one of several effects more: the way of each to its minimum, and who is left behind on it.

The most promising go first. Once one of them explains the run, the others only have to show that they do as well,
with its base numbers: most are left behind after a few looks.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from bench.diagnosis.expected.catalogue import free_of, probe_of, switches
from bench.diagnosis.expected.problem import Slot
from bench.diagnosis.fitting.approach import Approach, approach, further, known_beforehand, scanned
from bench.diagnosis.fitting.cloud import Cloud
from bench.diagnosis.fitting.settling import unknown_shapes
from bench.diagnosis.fitting.steps import inside

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import numpy.typing as npt

    from bench.diagnosis.expected.problem import Problem
    from bench.diagnosis.fitting.fitted import Fit
    from bench.diagnosis.searching.screen import Scores

    Floats = npt.NDArray[np.float64]

__all__ = ["Raced", "entrant", "near_by", "other_sizes", "race", "switches_of"]

#: Steps of a way where the model was far off, and where it was not; and the relative error that what is expected may
#: have at the start where it was.
_FAR: Final = 6
_NEAR: Final = 3
_WRONG: Final = 0.1
_FURTHER: Final = 4
#: Sizes of an effect that are tried with the base numbers of another: beside that of the catalogue, then beside the
#: best so far; and up to which loss, beside that of the best effect, what was found is gone on with.
_SCANS: Final = ((0.03, 0.1, 0.25, 0.5, 1.0, 2.0, 4.0), (0.6, 0.8, 1.25, 1.6), (0.9, 1.1))
_WORTH_STEPS: Final = 4.0
#: Shapes of an effect that are tried beside the one that was found, each with sizes that go with a power of it.
_SHAPES: Final = (0.25, 0.5, 2.0, 4.0)
_POWERS: Final = (-1.0, -0.5, 0.0, 0.5, 1.0)
#: Valleys are looked for so often at the most.
_VALLEYS: Final = 3
#: Relative error that what is expected may have there, and how far the first step goes.
_LESS_WRONG: Final = 0.03
_SHORT_OF: Final = 0.2
#: A loss per statistic below this is that of a model that lacks little.
_GOOD: Final = 2.0
#: A loss with little effort that is lower by this is lower.
_CLEARLY: Final = 10.0
#: A place is better than where the screen expects a minimum that is close when its loss is lower by this.
_BEYOND_CHANCE: Final = 60.0
#: Models whose loss, with little effort, is more than so many times that of the best, and so much more for chance,
#: are out of the race.
_RIVALS: Final = (1.5, 100.0)
_EARLY_RIVALS: Final = (3.0, 100.0)


def entrant(problem: Problem, here: Fit, scores: Scores, i: int, seed: int, far_off: bool) -> Approach:
    """Return the model with candidate `i` more, at the numbers that the screen expects; nothing is looked at yet.

    Where the model was far off these are other base numbers, too; what is known beforehand is what it is known to be.
    """
    one = scores.probes[i]
    coordinates, values = [], {}
    given = problem.given.get(one.effect.id, {})
    shapes = [f for f in free_of(one.effect) if f not in one.free]
    for free, at, expected in zip(one.free, one.at, scores.size[i], strict=True):
        # From null itself no fit finds its way when the number has one sign only.
        start = expected if free.signed and expected != 0.0 else max(expected, 0.1 * at)
        start = problem.start_of(free, start)
        coordinates.append(float(start))
        values[free.name] = free.value(float(start))
    for free in shapes:
        values[free.name] = given.get(free.name, free.probe)
        coordinates.append(problem.start_of(free, free.coordinate(values[free.name])))
    elsewhere = np.where(known_beforehand(here.slots), here.start, here.x + scores.base[i])
    place = np.array([*(elsewhere if far_off else here.x), *coordinates])
    return Approach(
        model=here.model + probe_of(one.effect, values, given),
        slots=(*here.slots, *(Slot(problem.told(f)) for f in (*one.free, *shapes))),
        at=place,
        start=np.array([*here.start, *coordinates]),
        loss=math.inf,
        seed=seed,
        information=np.zeros((place.size, place.size)),
        reach=_SHORT_OF,
        cloud=Cloud(),
    )


def near_by(problem: Problem, one: Approach) -> Approach:
    """Return an entrant near its minimum, which is close.

    It is where the screen expects it, unless a place is clearly better: what is looked at with little effort differs
    by chance more than by an effect that is small.
    """
    way = _along(problem, one, _NEAR, 0.0)
    start = inside(one.slots, one.at)
    expected = next(place for place in way.cloud.places if np.array_equal(place.at, start))
    if way.loss > expected.loss - _BEYOND_CHANCE:
        return replace(way, at=expected.at, loss=expected.loss)
    return way


class Raced(NamedTuple):
    """What came of an entrant."""

    way: Approach | None  #: near its minimum; None: left behind
    hopeless: bool  #: it was left so far behind that it cannot be what another one is


def race(
    problem: Problem, entrants: Sequence[Approach], most: int | None = None, leave: float = math.inf
) -> list[Raced]:  # fmt: skip
    """Return the entrants near their minima, which may be anywhere, or left behind.

    Parameters
    ----------
    entrants
        The most promising first.
    most
        So many go on once each has gone its first way.
    leave
        That way is given up early by those that have more than this share of the loss at its start left.
    """
    found: list[Approach] = []
    known: list[Approach | None] = []  # whose base numbers each was tried with
    for one in entrants:
        best = _best(found)
        if best is None or best.loss > _GOOD * len(problem.measured.value):
            beat = math.inf if best is None else best.loss
            found.append(_along(problem, one, _FAR, _WRONG, beat=beat, leave=leave))
            known.append(None)
        else:
            found.append(_beside(problem, one, best))
            known.append(best)
    best = _best(found)
    if best is None:
        return []
    going = _the_best(found, most)
    # Before the best was known, the others were tried with base numbers that had tried to stand in for them.
    for k, way in enumerate(going):
        if way is not None and way is not best and known[k] is not best:
            again = _beside(problem, replace(entrants[k], cloud=way.cloud), best)
            going[k] = min(way, again, key=lambda one: one.loss)
    kept = _rivals(going, _EARLY_RIVALS)
    ends = [way and further(problem, way, _FURTHER) for way in kept]
    last = [way and _resized(problem, way) for way in ends]
    best = _best(last) or best
    seen = [a or b or c for a, b, c in zip(last, going, found, strict=True)]
    beaten = _rivals(seen, _RIVALS if best.loss < _GOOD * len(problem.measured.value) else _EARLY_RIVALS)
    return [Raced(way, one is None) for way, one in zip(_rivals(last, _RIVALS), beaten, strict=True)]


def _best(ways: Sequence[Approach | None]) -> Approach | None:
    return min((way for way in ways if way is not None), key=lambda way: way.loss, default=None)


def _the_best(ways: Sequence[Approach], most: int | None) -> list[Approach | None]:
    losses = sorted(way.loss for way in ways)[:most]
    return [way if way.loss <= losses[-1] else None for way in ways]


def _rivals(ways: Sequence[Approach | None], most: tuple[float, float]) -> list[Approach | None]:
    best = _best(ways)
    limit = math.inf if best is None else most[0] * best.loss + most[1]
    return [way if way is not None and way.loss <= limit else None for way in ways]


def _along(
    problem: Problem, one: Approach, iterations: int, wrong: float, reach: float | None = None,
    beat: float = math.inf, leave: float = math.inf,
) -> Approach:  # fmt: skip
    return approach(
        problem, one.model, one.slots, list(one.at), seed=one.seed, iterations=iterations, wrong=wrong,
        prior=one.start, cloud=one.cloud, reach=reach, beat=beat, leave=leave,
    )  # fmt: skip


def _resized(problem: Problem, way: Approach) -> Approach:
    """Return a way, or one that goes on from another size or shape of its effect where that is clearly better.

    What few statistics tell, a leak in the background, may be wrong by a factor where all others agree: a valley. So
    may a size beside a shape: slow noise of twice the rms and four times the time wanders as far in a pulse.
    """
    for _ in range(_VALLEYS):
        seen = scanned(problem, way, [*other_sizes(way), *_other_shapes(problem, way)])
        if seen.loss > way.loss - _CLEARLY:
            return replace(way, cloud=seen.cloud)
        again = _along(problem, seen, _FAR, _LESS_WRONG, _SHORT_OF)
        way = min(way, again, key=lambda one: one.loss)
    return way


def other_sizes(way: Approach) -> Iterator[Floats]:
    """Yield places where the effect has another size, beside that of the catalogue."""
    mine = switches_of(way)
    for factor in _SCANS[0]:
        to = way.at.copy()
        for i in mine:
            free = way.slots[i].free
            to[i] = math.copysign(factor * free.coordinate(free.probe), way.at[i])
        yield inside(way.slots, to)


def _other_shapes(problem: Problem, way: Approach) -> Iterator[Floats]:
    """Yield places where the effect has another shape, each with sizes that go with a power of it."""
    mine = switches_of(way)
    owner = way.slots[-1].free.owner
    for i in unknown_shapes(problem, way.model, way.slots):
        free = way.slots[i].free
        if free.owner != owner:
            continue
        for shape, power in product(_SHAPES, _POWERS):
            to = way.at.copy()
            to[i] = free.coordinate(shape * free.value(float(way.at[i])))
            to[mine] *= shape**power
            yield inside(way.slots, to)


def switches_of(one: Approach) -> list[int]:
    """Return the places of the numbers that switch the last effect of a model on."""
    added = one.model.effect(one.slots[-1].free.owner)
    if added is None:
        raise ValueError(f"no effect {one.slots[-1].free.owner} in the model of an entrant")
    names = {f.name for f in switches(type(added))}
    return [i for i, s in enumerate(one.slots) if s.free.owner == added.id and s.free.name in names]


def _beside(problem: Problem, one: Approach, best: Approach) -> Approach:
    """Return an entrant with the numbers of the best, but for its own effect's: these in the size that suits best.

    What comes near to the best goes on from there.
    """
    mine = switches_of(one)
    shared = np.array(best.at[: mine[0]])
    size = np.array([one.slots[i].free.coordinate(one.slots[i].free.probe) for i in mine])
    seen, at = one, np.concatenate([shared, one.at[len(shared) :]])
    tries = [one.at]
    signed = all(one.slots[i].free.signed for i in mine)
    for tried, factors in enumerate(_SCANS):
        for factor in [*factors, *(-f for f in factors if signed and not tried)]:
            to = at.copy()
            to[mine] = factor * size
            tries.append(inside(one.slots, to))
        better = scanned(problem, seen, tries)
        seen = better if better.loss < seen.loss else replace(seen, cloud=better.cloud)
        at, size, tries = seen.at, seen.at[mine], []
    if seen.loss > _WORTH_STEPS * best.loss:
        return seen
    again = _along(problem, seen, _FAR, _LESS_WRONG, _SHORT_OF)
    return min(seen, again, key=lambda way: way.loss)
