"""A better place of a fitted model, to which an effect that it does not need has led.

With a number more a fit finds its way around what chance has put before it. When it then stands far below the one
without the effect, and the effect is about null there, that one is not at its minimum: what it leaves is not what is
missing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bench.diagnosis.fitting.judging import deviance, deviance_beside, deviance_per_dof
from bench.diagnosis.fitting.sharpening import EXPLAINS
from bench.diagnosis.searching.refit import STILL_NEEDED, needless
from bench.diagnosis.searching.taking_out import without

if TYPE_CHECKING:
    from bench.diagnosis.expected.problem import Problem
    from bench.diagnosis.fitting.fitted import Fit
    from bench.diagnosis.searching.state import State

__all__ = ["better_place"]


def better_place(problem: Problem, state: State, seed: int) -> Fit | None:
    """Return the model of a state, fitted from where the best of the effects that it does not need has led.

    Returns
    -------
    Fit or None
        None: it leaves no more than a fit at its minimum does, or there is no place that is clearly better.
    """
    here = deviance(problem, state.fit)
    enough = here - STILL_NEEDED**2  # an effect that is there stands out by so much
    if deviance_per_dof(problem, state.fit) <= EXPLAINS:
        return None
    better = [
        one for one in state.refitted.values()
        if one.deviance < enough and one.phases is None and needless(problem, state.fit, one.fit, one.effect)
    ]  # fmt: skip
    if not better:
        return None
    best = min(better, key=lambda one: one.deviance)
    again = without(problem, best.fit, best.effect, seed)
    return again if deviance_beside(problem, again, state.fit) < enough else None
