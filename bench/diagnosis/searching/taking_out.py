"""Effects that were added before it was known what else is missing, and that nothing asks for any more.

While an effect is missing another may stand in for it, and stay when it has come: with noise of the resets in the
model, thresholds and corner have gone where they need it. By its standard error it is there. So one that does not
stand far out is tried without: the others may find a place that is as good. Nor does a large standard error say that
nothing is there: how long a filter is that outlasts all pulses is not known, and the run asks for it all the same.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from bench.diagnosis.fitting.approach import approach
from bench.diagnosis.fitting.fit import finish
from bench.diagnosis.fitting.judging import deviance, deviance_per_dof
from bench.diagnosis.searching.likeness import nearer
from bench.diagnosis.searching.refit import STILL_NEEDED, Found

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from bench.diagnosis.expected.problem import Problem
    from bench.diagnosis.fitting.fitted import Fit

__all__ = ["is_missed", "to_take_out", "without"]

#: An effect whose numbers are all fewer standard errors from null is tried without.
_DOUBTED: Final = 6.0
_STEPS: Final = 3
_OTHER_SEED: Final = 57


def to_take_out(
    problem: Problem, one: Fit, sigmas: Mapping[str, float], explained: bool, seed: int,
    say: Callable[[str], None] = lambda _: None,
) -> tuple[str, Fit] | None:  # fmt: skip
    """Return an effect that is needless, and the model without it, fitted; None: all are needed.

    Parameters
    ----------
    one
        The fitted model.
    sigmas
        By how many standard errors effects that were added before the last one are off null.
    explained
        Whether the model explains the run: only then it tells which of them are in doubt.
    say
        Called with what is being done.
    """
    for name in sorted(sigmas, key=lambda name: sigmas[name]):
        if sigmas[name] >= (_DOUBTED if explained else STILL_NEEDED):
            break
        say(f"fitting without {name}")
        again = without(problem, one, name, seed)
        if _is_as_good(problem, again, one, name, seed):
            return name, again
    return None


def is_missed(problem: Problem, one: Fit, name: str, seed: int) -> bool:
    """Return whether a model does worse without one of its effects, whatever the standard error of its size."""
    return not _is_as_good(problem, without(problem, one, name, seed), one, name, seed)


def without(problem: Problem, one: Fit, name: str, seed: int) -> Fit:
    """Return a fitted model without one of its effects, fitted on."""
    kept = [i for i, slot in enumerate(one.slots) if slot.free.owner != name]
    near = approach(
        problem, one.model.without(name), [one.slots[i] for i in kept], [float(one.x[i]) for i in kept], seed=seed,
        iterations=_STEPS, prior=one.start[kept],
    )  # fmt: skip
    return finish(problem, near)


def _is_as_good(problem: Problem, again: Fit, one: Fit, name: str, seed: int) -> bool:
    """Return whether a model leaves no more than the square of what an effect must stand out by.

    Where something else is missing, that is in units of what is left everywhere. Each fit knows its own scale only
    roughly: 2 % of a deviance are more than that. Along the line from one model to the other there is hardly any
    chance.
    """
    before, after = Found(name, one, deviance(problem, one)), Found("", again, deviance(problem, again))
    least = STILL_NEEDED**2 * max(deviance_per_dof(problem, one), 1.0)
    return nearer(problem, before, after, seed + _OTHER_SEED) > -least
