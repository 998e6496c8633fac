"""Effects that the data cannot tell from the best one."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.expected.catalogue import TWINS, are_the_same
from bench.diagnosis.searching.likeness import TIED, closest, separation

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from bench.diagnosis.expected.problem import Problem
    from bench.diagnosis.fitting.fitted import Fit
    from bench.diagnosis.searching.refit import Found
    from bench.diagnosis.searching.screen import Scores

__all__ = ["tied_with", "told_apart"]

#: Up to this one straight lines do not tell, as there is chance in them: both are simulated.
_PERHAPS: Final = 8.0
#: So many effects are in a tie at the most.
_IN_A_TIE: Final = 3
#: Two effects are only confused when one explains at least so much of what the other does.
_AS_WELL: Final = 0.5
#: The same light falls on all pixels, while a dark current may be another in each: from so many standard errors of
#: its spread on that tells them apart.
_UNIFORM: Final = "stray_light"
_IN_EACH: Final = "dark_current"
_SURELY: Final = 5.0
#: Two fitted models, one of which leaves so many times as much as the other, are not the same to the data.
_NOT_ALIKE: Final = 2.0


def tied_with(
    problem: Problem, best: Found, found: Sequence[Found], scores: Scores, judged: Sequence[int],
    rivals: Collection[str], seed: int,
) -> tuple[str, ...]:  # fmt: skip
    """Return the effects that the data cannot tell from the best, the nearest first.

    Parameters
    ----------
    found
        Those that were refitted and may be added.
    judged
        The probes of `scores` that say something.
    rivals
        Effects that may be the same to the data, where straight lines do not tell; empty where they do.
    seed
        Of the simulations.
    """
    number = next(i for i, one in enumerate(scores.probes) if one.effect.id == best.effect)
    known = {f.effect: f for f in found}
    near = []
    for i in judged:
        effect = scores.probes[i].effect
        if effect.id == best.effect:
            continue
        if are_the_same(effect.id, best.effect, problem.points):
            apart = 0.0
        elif effect.id in rivals or _promised_less(scores, number, i, known):
            alike = effect.id in known and known[effect.id].deviance < _NOT_ALIKE * best.deviance
            apart = separation(problem, best, known[effect.id], seed) if alike else math.inf
            if apart >= TIED:
                apart = closest(problem, best, effect, seed)
            # From one side a fit that has not come all the way looks different, from the other it may not.
            if apart >= TIED and alike and TWINS.get(best.effect) == effect.id:
                apart = closest(problem, known[effect.id], scores.probes[number].effect, seed)
        elif rivals or scores.drop[i] < _AS_WELL * scores.drop[number]:
            continue
        else:
            apart = _along_lines(scores, number, i)
            if TIED <= apart < _PERHAPS:
                apart = closest(problem, best, effect, seed)
        if apart < TIED:
            near.append((apart, effect.id))
    return tuple(name for _, name in sorted(near)[: _IN_A_TIE - 1])


def _promised_less(scores: Scores, one: int, other: int, known: Collection[str]) -> bool:
    """Return whether an effect is a twin that was refitted, while straight lines promised little of it.

    What little is simulated of a slow model may hide what one of them does, and not what the other does.
    """
    a, b = (scores.probes[i].effect.id for i in (one, other))
    return TWINS.get(a) == b and b in known and bool(scores.drop[other] < _AS_WELL * scores.drop[one])


def told_apart(ties: Mapping[str, tuple[str, ...]], problem: Problem, last: Fit) -> dict[str, tuple[str, ...]]:
    """Return the ties that are left once details of the effects are known: see :mod:`.fitting.details`."""
    sd = np.sqrt(np.diag(last.covariance(problem.measured.points)))
    spreads = [i for i, s in enumerate(last.slots) if (s.free.owner, s.free.name) == (_IN_EACH, "spread")]
    if not any(last.x[i] > _SURELY * sd[i] for i in spreads):
        return dict(ties)
    left = {name: tuple(o for o in others if {name, o} != {_UNIFORM, _IN_EACH}) for name, others in ties.items()}
    return {name: others for name, others in left.items() if others}


def _along_lines(scores: Scores, one: int, other: int) -> float:
    """Return by how many standard errors two effects differ, if what they do goes along straight lines."""
    size = math.sqrt(max(float(scores.drop[one]), 0.0))
    return size * math.sqrt(max(1.0 - float(scores.likeness[one, other]) ** 2, 0.0))
