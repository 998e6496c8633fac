"""What a step of a diagnosis says of each effect that its model does not have."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.analysis.tally import active_pixels
from bench.diagnosis.expected.catalogue import is_of_few
from bench.diagnosis.fitting.judging import deviance, deviance_per_dof, freedom, heldout, loss_left, step_of
from bench.diagnosis.result import Candidate

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from bench.diagnosis.result import Step
    from bench.diagnosis.searching.screen import Scores
    from bench.diagnosis.searching.state import State

__all__ = ["step_with_candidates"]

#: Standard errors at which an effect is found as a rule.
_DETECTED: Final = 4.5


def step_with_candidates(state: State, number: int, ties: Mapping[str, tuple[str, ...]]) -> Step:
    """Return a state as a step of a diagnosis, with what it may lack.

    First comes what is proposed, then what was refitted, the largest fall of the error on unseen points first, then
    what promises most.

    Parameters
    ----------
    ties
        Of the proposal: what it cannot be told from.
    """
    found = sorted(_candidates(state, ties), key=lambda c: (c.effect != state.proposal, *_rank(c)))
    return step_of(state.problem, state.fit, number, state.added, found)


def _rank(one: Candidate) -> tuple[bool, float]:
    drop = one.heldout_drop if one.heldout_drop is not None else one.refit_drop
    return drop is None, -one.screen_drop if drop is None else -drop


def _candidates(state: State, ties: Mapping[str, tuple[str, ...]]) -> Iterator[Candidate]:
    problem, scores = state.problem, state.scores
    before, unseen, n = deviance_per_dof(problem, state.fit), heldout(problem, state.fit), freedom(state.fit)
    # The screen expects a fall of the loss, in which large residuals count by their size: as a share of what is left.
    left = loss_left(problem, state.fit)
    each = deviance(problem, state.fit) / left / n if left > 0.0 else 0.0  # without an event nothing is left
    pixels = max(int(active_pixels(point).sum()) for point in problem.points)
    for i in np.argsort(-scores.drop, kind="stable"):
        name = scores.probes[i].effect.id
        found = state.refitted.get(name)
        yield Candidate(
            name,
            float(scores.drop[i]) * each,
            None if found is None else before - found.deviance / n,
            float(scores.p_best[i]),
            ties.get(name, ()),
            _smallest(scores, int(i), pixels),
            None if found is None else _finite(unseen - heldout(found.beside(problem), found.fit)),
        )


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _smallest(scores: Scores, i: int, pixels: int) -> float | None:
    """Return the least size of an effect that would have been seen, in the unit of its first number.

    None where it is beyond what such a number is believed to be: the effect cannot be seen. Of what few pixels have,
    one of those that are looked at has it at the least.
    """
    one, seen = scores.probes[i], float(scores.seen[i])
    if seen <= 0.0:
        return None
    free, at = one.free[0], abs(one.at[0]) * _DETECTED / seen
    if is_of_few(one.effect.id):
        at = max(at, free.coordinate(1.0 / pixels))
    return free.value(at) if at <= free.range[1] else None
