"""What a step of a diagnosis says of each effect that its model does not have."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.fitting.judging import deviance, step_of
from bench.diagnosis.result import Candidate

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bench.diagnosis.expected.problem import Problem
    from bench.diagnosis.result import Step
    from bench.diagnosis.searching.screen import Scores
    from bench.diagnosis.searching.state import State

__all__ = ["step_with_candidates"]

#: Standard errors at which an effect is found as a rule.
_DETECTED: Final = 4.5


def step_with_candidates(problem: Problem, state: State, number: int) -> Step:
    """Return a state as a step of a diagnosis, with what it may lack: the most promising first."""
    return step_of(problem, state.fit, number, state.added, list(_candidates(problem, state)))


def _candidates(problem: Problem, state: State) -> Iterator[Candidate]:
    scores, before = state.scores, deviance(problem, state.fit)
    for i in np.argsort(-scores.drop, kind="stable"):
        name = scores.probes[i].effect.id
        found = state.refitted.get(name)
        yield Candidate(
            name,
            float(scores.drop[i]),
            before - found.deviance if found is not None else None,
            float(scores.p_best[i]),
            state.tied if name == state.proposal else (),
            _smallest(scores, int(i)),
        )


def _smallest(scores: Scores, i: int) -> float | None:
    """Return the least size of an effect that would have been seen, in the unit of its first number."""
    one, seen = scores.probes[i], float(scores.seen[i])
    if seen <= 0.0 or one.free[0].scale == "inverse":
        return None
    return one.free[0].value(one.at[0] * _DETECTED / seen)
