"""A step of a diagnosis on its way: the fitted model, what it may lack, and what was tried."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Final

from bench.diagnosis.expected.catalogue import is_of_few
from bench.diagnosis.fitting.judging import NEARLY_ALL, excess, heldout, is_far_off, share
from bench.diagnosis.searching.refit import STILL_NEEDED, needless, strength
from sim_backend.pixel.effects.light_rise_time import LightRiseTime
from sim_backend.pixel.effects.timestamp_jitter import TimestampJitter

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bench.diagnosis.expected.parameters import Free
    from bench.diagnosis.expected.problem import Problem
    from bench.diagnosis.fitting.fitted import Fit
    from bench.diagnosis.searching.refit import Found
    from bench.diagnosis.searching.screen import Scores
    from bench.diagnosis.searching.trends import Trend

__all__ = [
    "State",
    "can_judge",
    "is_explained",
    "leaves_little",
    "may_be_added",
    "strengths",
]

#: The deviance of a true model is larger than expected by so many standard deviations hardly ever.
_EXPLAINED: Final = 3.5
#: Times shorter than so many looks of the comparators are not told from how time is cut into samples: events that are
#: stamped one look later, filters that go in steps. Neither tells brighter from darker, as light that rises slowly
#: does; light that goes from one level to the other within a sample rises as if in half of it. Stamps anywhere within
#: a sample scatter by less than a third of it.
_LOOKS: Final = 2.0
_LOOKS_OF: Final = {LightRiseTime.id: 0.5, TimestampJitter.id: 1.0}


@dataclass
class State:
    """A fitted model, what is known about what it lacks, and how it came about."""

    fit: Fit
    scores: Scores
    added: str | None  #: effect; None: the model to start from
    problem: Problem  #: with the phases of a ripple, and the clock, that the fit is of
    fall: float = 0.0  #: share of what was too much in the deviance before that the effect took away
    refitted: dict[str, Found] = field(default_factory=dict)
    hopeless: frozenset[str] = frozenset()  #: effects that come nowhere near the best
    tied: tuple[str, ...] = ()
    proposal: str | None = None
    group: tuple[str, ...] = ()  #: what was added, and all that could not be told from it then
    trends: tuple[Trend, ...] = ()  #: that chance does not make, where the squares are no larger than chance makes
    chosen: bool = False  #: whether a proposal was looked for
    missed: dict[str, bool] = field(default_factory=dict)  #: of effects that were asked: the model does worse without


def strengths(problem: Problem, states: Sequence[State]) -> dict[str, float]:
    """Return by how many standard errors each effect that was added is off null in the last model.

    Of what few pixels have it is what it took away when it was added. Once something else was, it may have stood in
    for that: it is no more than asks for another look without it.
    """
    found = {}
    for before, after in pairwise(states):
        if after.added is not None:
            found[after.added] = strength(problem, before.fit, states[-1].fit, after.added)
            if is_of_few(after.added) and after is not states[-1] and found[after.added] > 0.0:
                found[after.added] = min(strength(problem, before.fit, after.fit, after.added), STILL_NEEDED)
    return found


def leaves_little(problem: Problem, one: Fit) -> bool:
    """Return whether a model leaves no more than chance does in all squares together."""
    return excess(problem, one) <= _EXPLAINED


def is_explained(problem: Problem, state: State) -> bool:
    """Return whether a model leaves no more than chance does, and no trend."""
    return leaves_little(problem, state.fit) and not state.trends


def may_be_added(problem: Problem, before: Fit, found: Found) -> bool:
    """Return whether a fitted effect is there, is coarser than the grid of the simulation, and no mere stand-in."""
    numbers = zip(found.fit.slots, found.fit.x, strict=True)
    coarse = all(_coarse(problem, s.free, float(x)) for s, x in numbers if s.free.owner == found.effect)
    return (
        coarse and not needless(problem, before, found.fit, found.effect) and not _stands_in(problem, before, found)
    )


def _stands_in(problem: Problem, before: Fit, found: Found) -> bool:
    """Return whether an effect leaves much, and what it takes away comes back on points that the fit did not see.

    What hardly leaves anything may well be seen in one point alone. Where little was missing, two fits differ on
    unseen points by chance as much as by the effect: see :func:`~bench.diagnosis.searching.likeness.nearer`.
    """
    if not is_far_off(problem, before) or share(problem, before, found.deviance) > NEARLY_ALL:
        return False
    return heldout(problem, found.fit) >= heldout(problem, before)


def can_judge(problem: Problem, scores: Scores, i: int) -> bool:
    """Return whether an effect is coarser than the grid of the simulation, if it is a matter of time."""
    one = scores.probes[i]
    sizes = zip(one.free, map(float, scores.size[i]), one.at, strict=True)
    return all(size == 0.0 or _coarse(problem, free, _really(free, size, at)) for free, size, at in sizes)


def _really(free: Free, size: float, at: float) -> float:
    """Return the size that a straight line to a probe lets expect, if the effect goes along it.

    Small scatter of the stamps acts by its square: of a small one the line lets expect the square of its share.
    """
    return math.copysign(math.sqrt(abs(size * at)), size) if free.owner == TimestampJitter.id else size


def _coarse(problem: Problem, free: Free, coordinate: float) -> bool:
    finest = _LOOKS_OF.get(free.owner, _LOOKS) * problem.forward.dt_s
    return free.unit != "s" or free.scale == "log" or free.value(abs(coordinate)) >= finest
