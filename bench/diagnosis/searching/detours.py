"""Other ways than the one that was gone: with effects that did nearly as well as one that was added."""

from __future__ import annotations

from copy import copy
from itertools import pairwise
from typing import TYPE_CHECKING, Final

from bench.diagnosis.expected.catalogue import are_the_same
from bench.diagnosis.fitting.judging import share
from bench.diagnosis.searching.state import may_be_added

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bench.diagnosis.expected.problem import Problem
    from bench.diagnosis.searching.refit import Found
    from bench.diagnosis.searching.state import State

__all__ = ["other_ways", "proposing"]

#: An effect did nearly as well if it took away more than this share of what the one that was added did.
_NEARLY_AS_WELL: Final = 0.5


def other_ways(problem: Problem, states: Sequence[State]) -> list[tuple[int, Found]]:
    """Return effects that did nearly as well as what was added, and the step before; the last step first."""
    found = []
    for depth, (before, after) in reversed(list(enumerate(pairwise(states)))):
        tried = {after.added, before.proposal, *before.tied}
        others = [f for f in before.refitted.values() if f.effect not in tried]
        known = sorted((f for f in others if may_be_added(problem, before.fit, f)), key=lambda f: f.deviance)
        least = _NEARLY_AS_WELL * after.fall
        found += [(depth, f) for f in known if share(problem, before.fit, f.deviance) > least]
    return found


def proposing(problem: Problem, state: State, effect_id: str) -> State:
    """Return a state with another proposal; it is tied with what is the same to a pixel."""
    other = copy(state)
    ids = [one.effect.id for one in state.scores.probes if one.effect.id != effect_id]
    other.proposal = effect_id
    other.tied = tuple(name for name in ids if are_the_same(name, effect_id, problem.points))
    return other
