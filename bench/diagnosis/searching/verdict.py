"""What the steps of a diagnosis come to: the verdict, what is named, and what could take its place."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

from bench.diagnosis.fitting.judging import NEARLY_ALL, share_of_loss
from bench.diagnosis.searching.refit import NEEDED
from bench.diagnosis.searching.state import is_explained, strengths
from bench.diagnosis.searching.taking_out import is_missed

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from bench.diagnosis.expected.problem import Problem
    from bench.diagnosis.result import Verdict
    from bench.diagnosis.searching.state import State

__all__ = ["group_of", "ties_of", "verdict_of"]


def verdict_of(
    problem: Problem, states: Sequence[State], stopped: bool = False, seed: int = 1,
    say: Callable[[str], None] = lambda _: None,
) -> tuple[Verdict, tuple[str, ...]]:  # fmt: skip
    """Return the verdict, and the effects that are named.

    Where the search was stopped nothing may have been named although something is significant: that is not explained.
    What a person added may be within chance of nothing, and so may the last effect once its fit was made sharper:
    unless the model does worse without it.
    Effects that leave much behind may only have mimicked what no catalogue knows: where something is left that
    nothing explains, only those are named that take away nearly all of what was too much.
    """
    if is_explained(problem, states[-1]):
        named = tuple(
            name for name, sigmas in strengths(problem, states).items()
            if sigmas >= NEEDED or _is_missed(problem, states[-1], name, seed, say)
        )  # fmt: skip
        return ("explained" if named else "unexplained" if stopped else "nothing_missing"), named
    sure = (
        after.added for before, after in pairwise(states)
        if after.added is not None and min(after.fall, share_of_loss(problem, before.fit, after.fit)) > NEARLY_ALL
    )  # fmt: skip
    return "unexplained", tuple(sure)


def _is_missed(problem: Problem, state: State, name: str, seed: int, say: Callable[[str], None]) -> bool:
    """Return whether a model does worse without an effect; it is fitted without it once."""
    if name not in state.missed:
        say(f"fitting without {name}")
        state.missed[name] = is_missed(problem, state.fit, name, seed)
    return state.missed[name]


def group_of(before: State, added: str) -> tuple[str, ...]:
    """Return an effect that is added to the model of a state with those that it cannot be told from there.

    A person may add another one of a tie than was proposed, or one that is not in it.
    """
    group = () if before.proposal is None else (before.proposal, *before.tied)
    return group if added in group else (added,)


def ties_of(states: Sequence[State], missing: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Return for each effect that was added what could take its place, but for what was added as well."""
    found = {}
    for state in states[1:]:
        others = tuple(n for n in state.group if n != state.added and states[-1].fit.model.effect(n) is None)
        if state.added is not None and state.added in missing and others:
            found[state.added] = others
    return found
