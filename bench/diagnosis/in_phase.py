"""A fit whose ripple has the phases of the recordings, and began as it did: before them, or with them.

Phases and numbers depend on each other, and both on what pixels had settled to at the start. So one follows the
other, as long as it gets better.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

from bench.diagnosis.approach import approach
from bench.diagnosis.fit import finish, moved
from bench.diagnosis.judging import deviance_per_dof
from bench.diagnosis.phase_search import sharper_phases
from sim_backend.pixel.effects.light_flicker import LightFlicker

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bench.diagnosis.fitted import Fit
    from bench.diagnosis.problem import Problem
    from sim_backend.pixel.model import PixelModel

__all__ = ["in_phase"]

#: Phases and numbers follow each other so often at the most, while the error falls by this share.
_ROUNDS: Final = 4
_BETTER: Final = 0.05
#: The fit that follows them goes so many steps.
_STEPS: Final = 3
#: What has this many times the error at first is no way on.
_MUCH_WORSE: Final = 1.25
#: A ripple that begins with the recording: what pixels have settled to has nothing of it.
_NOT_BEFORE_HZ: Final = 1e-3


def in_phase(problem: Problem, found: Fit, seed: int) -> tuple[Problem, Fit]:
    """Return a fit, or a better one in which the ripple has the phases that the fitted model asks for.

    Parameters
    ----------
    found
        A model with a ripple whose phase is open.

    Returns
    -------
    problem, fit
        The problem knows the phases that the fit is of.
    """
    error = deviance_per_dof(problem, moved(problem, found, found.x, seed))
    there, turned, least = _best([_followed(problem, one, seed + 10) for one in _begun(problem, found, seed)])
    if least >= (1.0 - _BETTER) * error:
        return problem, found
    near = approach(
        there, turned.model, turned.slots, list(turned.x), seed=seed + 90, iterations=_STEPS, prior=turned.start
    )  # fmt: skip
    return _tuned(there, finish(there, near), seed + 95)


def _begun(problem: Problem, found: Fit, seed: int) -> list[Fit]:
    """Return the fit with each corner behind which pixels may have settled to the ripple, if it is open.

    Those with which the run is much less likely are left out; the first is that of the fit.
    """
    ripple = _ripple(found.model)
    if ripple.settled_hz is not None:
        return [found]
    corners = (None, found.model.corner_hz, _NOT_BEFORE_HZ)
    all_of_them = [
        replace(found, model=replace(found.model, effects=tuple(
            replace(ripple, settled_hz=hz) if e is ripple else e for e in found.model.effects
        )))
        for hz in corners
    ]  # fmt: skip
    errors = [deviance_per_dof(problem, moved(problem, one, one.x, seed)) for one in all_of_them]
    return [one for one, error in zip(all_of_them, errors, strict=True) if error <= _MUCH_WORSE * min(errors)]


def _best(followed: Sequence[tuple[Problem, Fit, float]]) -> tuple[Problem, Fit, float]:
    """Return the first of them, or the best if that is better by more than chance."""
    best = min(followed, key=lambda one: one[2])
    return best if best[2] < (1.0 - _BETTER) * followed[0][2] else followed[0]


def _ripple(model: PixelModel) -> LightFlicker:
    return next(e for e in model.effects if isinstance(e, LightFlicker))


def _followed(problem: Problem, found: Fit, seed: int) -> tuple[Problem, Fit, float]:
    """Return phases, a fit whose numbers have followed them along straight lines, and its error: as long as it falls.

    What is expected there is simulated, how it changes by number is not: that takes many times as long.
    """
    best = moved(problem, found, found.x, seed)
    error = deviance_per_dof(problem, best)
    for number in range(1, _ROUNDS + 1):
        turned = sharper_phases(problem, best, seed + 2 * number)
        there = replace(problem, phases=turned.phases)
        again = moved(there, best, turned.x, seed + 2 * number + 1)
        before, now = error, deviance_per_dof(there, again)
        if now < error:
            problem, best, error = there, again, now
        if now >= (1.0 - _BETTER) * before:
            break
    return problem, best, error


def _tuned(problem: Problem, found: Fit, seed: int) -> tuple[Problem, Fit]:
    """Return a fit with phases that are as sharp as what it expects, if its error falls; nothing is simulated there.

    What a fit expects is known from many looks, much better than a look at other phases would tell it.
    """
    turned = sharper_phases(problem, found, seed)
    residual = problem.measured.value - turned.value
    there = replace(problem, phases=turned.phases)
    again = replace(found, x=turned.x, value=turned.value, residual=residual)
    return (there, again) if deviance_per_dof(there, again) < deviance_per_dof(problem, found) else (problem, found)
