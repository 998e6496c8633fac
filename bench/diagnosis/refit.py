"""A model with an effect more, fitted; and whether it needs the effect."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.catalogue import least_share, switches
from bench.diagnosis.fit import finish
from bench.diagnosis.judging import deviance_beside
from bench.diagnosis.race import entrant, near_by, race

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bench.diagnosis.approach import Approach
    from bench.diagnosis.fitted import Fit
    from bench.diagnosis.problem import Problem
    from bench.diagnosis.screen import Scores

__all__ = ["Found", "needless", "refitted"]

#: An effect whose numbers are all fewer standard errors from null is needless; one that was added before it was known
#: what else is missing is so up to the size that a search among all effects takes for more than chance.
_NEEDED: Final = 2.0
_STILL_NEEDED: Final = 3.3


@dataclass(frozen=True)
class Found:
    """A candidate, refitted."""

    effect: str
    fit: Fit
    deviance: float  #: with as many residuals as the fit before


def refitted(
    problem: Problem, here: Fit, scores: Scores, candidates: Sequence[int], seed: int, far_off: bool,
    most: int | None = None,
) -> list[Found]:  # fmt: skip
    """Return the models with one of these candidates more, fitted; those that come close to the best of them.

    Parameters
    ----------
    far_off
        The minima may be anywhere.
    most
        No more than so many go all the way there.
    """
    entrants = [entrant(problem, here, scores, i, seed, far_off) for i in candidates]
    ways = _raced(problem, entrants, most) if far_off else [near_by(problem, one) for one in entrants]
    found = []
    for i, way in zip(candidates, ways, strict=True):
        if way is not None:
            fitted = finish(problem, way)
            found.append(Found(scores.probes[i].effect.id, fitted, deviance_beside(problem, fitted, here)))
    return found


def _raced(problem: Problem, entrants: Sequence[Approach], most: int | None) -> list[Approach | None]:
    """Return what a race leaves of them; those of which whole sensors are simulated go last.

    If another one explains the run, a few looks leave them behind, while their own way takes minutes.
    """
    order = sorted(range(len(entrants)), key=lambda k: least_share(entrants[k].model))
    ways = dict(zip(order, race(problem, [entrants[k] for k in order], most), strict=True))
    return [ways[k] for k in range(len(entrants))]


def needless(problem: Problem, one: Fit, effect_id: str, *, before: bool = False) -> bool:
    """Return whether all numbers of an effect are within chance of null.

    Parameters
    ----------
    before
        It was added before others were.
    """
    least = _STILL_NEEDED if before else _NEEDED
    sd = np.sqrt(np.diag(one.covariance(problem.measured.points)))
    effect = next(e for e in one.model.effects if e.id == effect_id)
    names = {f.name for f in switches(type(effect))}
    mine = [i for i, s in enumerate(one.slots) if s.free.owner == effect_id and s.free.name in names]
    return all(abs(one.x[i]) < least * sd[i] for i in mine)
