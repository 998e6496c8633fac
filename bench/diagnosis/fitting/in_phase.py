"""A fit whose ripple has the phases of the recordings, and began as it did: before them, or with them.

Phases and numbers depend on each other, and both on what pixels had settled to at the start. So one follows the
other, as long as it gets better.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Final

from bench.diagnosis.fitting.approach import approach
from bench.diagnosis.fitting.fit import finish
from bench.diagnosis.fitting.judging import deviance_per_dof, leaves_more_than_chance
from bench.diagnosis.fitting.moving import moved
from bench.diagnosis.fitting.phase_search import sharper_phases
from sim_backend.pixel.effects.light_flicker import LightFlicker

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bench.diagnosis.expected.problem import Problem
    from bench.diagnosis.fitting.fitted import Fit
    from sim_backend.pixel.model import PixelModel

__all__ = ["has_open_ripple", "in_phase", "tuned"]

#: Phases and numbers follow each other so often at the most, while the error falls by this share.
_ROUNDS: Final = 4
_BETTER: Final = 0.05
#: The fit that follows them goes so many steps.
_STEPS: Final = 3
#: A beginning that has this many times the error of another one, at first, is not followed.
_MUCH_WORSE: Final = 1.25
#: A ripple that begins with the recording: what pixels have settled to has nothing of it.
_NOT_BEFORE_HZ: Final = 1e-3
#: Frequencies of a ripple are the same when they agree to this.
_SAME_HZ: Final = 1e-3


def has_open_ripple(problem: Problem, model: PixelModel) -> bool:
    """Return whether a model has the ripple that can be seen in the run, at a phase that is open."""
    given, own = problem.given.get(LightFlicker.id), model.effect(LightFlicker.id)
    if given is None or not isinstance(own, LightFlicker) or own.phase is not None:
        return False
    return math.isclose(own.frequency_hz, given["frequency_hz"], rel_tol=_SAME_HZ)


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
    begun = _begun(problem, found)
    errors = [deviance_per_dof(problem, moved(problem, one, one.x, seed)) for one in begun]
    likely = [one for one, error in zip(begun, errors, strict=True) if error <= _MUCH_WORSE * min(errors)]
    there, turned, least = _best([_followed(problem, one, seed + 10) for one in likely])
    if least >= (1.0 - _BETTER) * errors[0]:
        return problem, found
    near = approach(
        there, turned.model, turned.slots, list(turned.x), seed=seed + 90, iterations=_STEPS, prior=turned.start
    )  # fmt: skip
    return tuned(there, finish(there, near), seed + 95)


def _begun(problem: Problem, found: Fit) -> list[Fit]:
    """Return the fit, and with each other corner behind which pixels may have settled to the ripple.

    What was found while another effect was missing may have stood in for it: it is asked again as long as more is
    left than chance leaves.
    """
    ripple = found.model.effect(LightFlicker.id)
    if not isinstance(ripple, LightFlicker):
        return [found]
    if ripple.settled_hz is not None and not leaves_more_than_chance(problem, found):
        return [found]
    corners = [hz for hz in (None, found.model.corner_hz, _NOT_BEFORE_HZ) if hz != ripple.settled_hz]
    models = [found.model.changed(replace(ripple, settled_hz=hz)) for hz in corners]
    return [found, *(replace(found, model=model) for model in models)]


def _best(followed: Sequence[tuple[Problem, Fit, float]]) -> tuple[Problem, Fit, float]:
    """Return the first of them, or the best if that is better by more than chance."""
    best = min(followed, key=lambda one: one[2])
    return best if best[2] < (1.0 - _BETTER) * followed[0][2] else followed[0]


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


def tuned(problem: Problem, found: Fit, seed: int) -> tuple[Problem, Fit]:
    """Return a fit with phases that are as sharp as what it expects, if its error falls; nothing is simulated there.

    What a fit expects is known from many looks, much better than a look at other phases would tell it.
    """
    turned = sharper_phases(problem, found, seed)
    residual = problem.measured.value - turned.value
    there = replace(problem, phases=turned.phases)
    model = there.of_settings(found.model, found.slots, turned.x)[0]
    again = replace(found, model=model, x=turned.x, value=turned.value, residual=residual)
    return (there, again) if deviance_per_dof(there, again) < deviance_per_dof(problem, found) else (problem, found)
