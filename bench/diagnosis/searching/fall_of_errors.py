"""The errors of the steps of a search, told so that their fall is that of the effects, and not of chance.

What a model expects is simulated, and two simulations of one model differ: the squares of 700 residuals do by 15 or
so, as much as a small effect takes away. So models that come near the run are simulated again with the same random
numbers, and what they leave is told from what the last one leaves.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.fitting.judging import error_of
from bench.diagnosis.fitting.moving import moved
from bench.diagnosis.fitting.sharpening import NEARBY
from bench.diagnosis.result import Error

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bench.diagnosis.fitting.fitted import Fit
    from bench.diagnosis.searching.state import State

__all__ = ["errors_of"]

_OTHER_SEED: Final = 7919
#: So many times as many pixels are simulated as for a look of a fit, of every model, if the dearest does not take so
#: many times as long as that: a small effect shows on unseen points, too, and models of equally many pixels have the
#: chance of these in common.
_EFFORT: Final = 4.0
_LONGEST: Final = 40.0


def errors_of(states: Sequence[State], seed: int) -> list[Error]:
    """Return the errors of the models of a search, those near the run with the chance that the last one has.

    Parameters
    ----------
    states
        Of the search, from the model that it started from.
    seed
        Of the simulations.
    """
    errors = [error_of(state.problem, state.fit) for state in states]
    near = [i for i, error in enumerate(errors) if error.deviance_per_dof <= NEARBY]
    if len(near) > 1 and near[-1] == len(states) - 1:
        some = [states[i] for i in near]
        first, second = (_with_the_chance_of_the_last(some, s) for s in (seed, seed + _OTHER_SEED))
        for i, one, other in zip(near[:-1], first, second, strict=True):
            errors[i] = _without_chance(states[i], one, other)
    return errors


def _with_the_chance_of_the_last(states: Sequence[State], seed: int) -> list[Fit]:
    """Return the fits but for the last one, all differences to which come from the same random numbers."""
    *others, last = states
    costs = [state.problem.cost(state.fit.models(state.problem)) for state in states]
    effort = min(_EFFORT, _LONGEST / max(costs))
    there = moved(last.problem, last.fit, last.fit.x, seed, effort * costs[-1])
    found = []
    for state, cost in zip(others, costs[:-1], strict=True):
        one, here = state.fit, moved(state.problem, state.fit, state.fit.x, seed, effort * cost)
        both = here.known & there.known & one.known & last.fit.known
        residual = np.where(both, last.fit.residual + there.value - here.value, one.residual)
        found.append(replace(one, residual=residual, scale=last.fit.scale))
    return found


def _without_chance(state: State, one: Fit, other: Fit) -> Error:
    """Return the error of a model that was simulated twice: what chance there is in one adds to all squares.

    Squares of the mean of both have half as much of it, so that twice these less the mean of the others have none.
    """
    mean = replace(one, residual=0.5 * (one.residual + other.residual))
    of_mean, *each = (error_of(state.problem, fit) for fit in (mean, one, other))
    return Error(
        2.0 * of_mean.deviance_per_dof - 0.5 * sum(e.deviance_per_dof for e in each),
        of_mean.response_rmse,
        2.0 * of_mean.heldout_deviance_per_dof - 0.5 * sum(e.heldout_deviance_per_dof for e in each),
    )
