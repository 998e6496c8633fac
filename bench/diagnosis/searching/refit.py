"""A model with an effect more, fitted; and whether it needs the effect."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.expected.catalogue import is_of_few, least_share, switches
from bench.diagnosis.fitting.fit import finish
from bench.diagnosis.fitting.in_phase import has_open_ripple, in_phase
from bench.diagnosis.fitting.judging import (
    NEARLY_ALL,
    deviance,
    deviance_beside,
    deviance_per_dof,
    freedom,
    is_far_off,
    loss_left,
    share,
)
from bench.diagnosis.fitting.looks import loss_of_fit
from bench.diagnosis.fitting.sharpening import EXPLAINS, NEARBY, fitted_on, from_here, is_costly, sharpened
from bench.diagnosis.searching.entering import with_what_sets_in
from bench.diagnosis.searching.race import Raced, entrant, near_by, race
from bench.diagnosis.searching.valley import through_the_valley

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from bench.diagnosis.expected.problem import Problem
    from bench.diagnosis.fitting.approach import Approach
    from bench.diagnosis.fitting.fitted import Fit
    from bench.diagnosis.searching.screen import Scores

__all__ = ["NEEDED", "STILL_NEEDED", "Found", "Refitted", "needless", "refitted", "strength"]

#: An effect whose numbers are all fewer standard errors from null is needless; one that was added before it was known
#: what else is missing is so up to the size that a search among all effects takes for more than chance.
NEEDED: Final = 2.0
STILL_NEEDED: Final = 3.3
_HALF_A_PIXEL: Final = 0.5
#: A fit is made sharper where the loss has fallen by less than this share of what was promised, or the deviance has
#: risen, if the promise is more than that of chance, and the loss is no larger than so many times what it was.
_SHORT: Final = 0.5
_PROMISE: Final = 10.0
_BEYOND_HELP: Final = 2.0
#: The seed of that, after that of the fit.
_AGAIN: Final = 7
#: Where all are further off than this, and none takes away nearly all that is too much, each may be beyond a bent
#: valley from its minimum. The best of them goes on from where its fit has ended, so often at the most, while it is
#: off and its error falls to this share.
_FAR: Final = 2.0
_GOES_ON: Final = 4
_FALLING: Final = 0.8
_ON: Final = 1000
#: Where the best comes near to explaining the run and does not, chance may have kept it from its minimum: the seed of
#: a fit with more effort, after that of the fit.
_SHARPER: Final = 1200
#: Of so many of the best the phases of a ripple follow, with seeds that are so far apart.
_FOLLOWED: Final = 3
_TURN: Final = 300


@dataclass(frozen=True)
class Found:
    """A candidate, refitted."""

    effect: str
    fit: Fit
    deviance: float  #: with as many residuals as the fit before
    phases: tuple[float | None, ...] | None = None  #: of a ripple, where they have followed; None: as they were

    def beside(self, problem: Problem) -> Problem:
        """Return the problem with the phases that the fit is of."""
        return problem if self.phases is None else replace(problem, phases=self.phases)


@dataclass(frozen=True)
class Refitted:
    """What came of some candidates."""

    found: tuple[Found, ...]  #: those that come close to the best of them
    hopeless: frozenset[str]  #: those that come nowhere near it


def refitted(
    problem: Problem, here: Fit, scores: Scores, candidates: Sequence[int], seed: int, far_off: bool,
    most: int | None = None, leave: float = math.inf,
) -> Refitted:  # fmt: skip
    """Return the models with one of these candidates more, fitted.

    Parameters
    ----------
    far_off
        The minima may be anywhere.
    most
        No more than so many go all the way there.
    leave
        See :func:`~bench.diagnosis.searching.race.race`.
    """
    entrants = [entrant(problem, here, scores, i, seed, far_off) for i in candidates]
    if far_off:
        raced = _raced(problem, [with_what_sets_in(problem, one) for one in entrants], most, leave)
    else:
        raced = [Raced(near_by(problem, one), hopeless=False) for one in entrants]
    names = [scores.probes[i].effect.id for i in candidates]
    ways = {k: one.way for k, one in enumerate(raced) if one.way is not None}
    fits = _Fits(problem, here, names, [float(scores.drop[i]) for i in candidates], seed)
    for k, way in ways.items():
        fits.add(k, way)
    if far_off:
        fits.follow_phases()
        fits.through_valleys(ways)
        fits.go_on()
    else:
        fits.look_closer()
        fits.on_one_scale()
    hopeless = frozenset(name for name, one in zip(names, raced, strict=True) if one.hopeless)
    return Refitted(tuple(fits.found.values()), hopeless)


class _Fits:
    """Candidates, fitted one after the other; those that come nowhere near one before them with less effort."""

    def __init__(
        self, problem: Problem, here: Fit, names: Sequence[str], promised: Sequence[float], seed: int
    ) -> None:  # fmt: skip
        self._problem, self._here, self._names, self._promised, self._seed = problem, here, names, promised, seed
        self.found: dict[int, Found] = {}

    def add(self, k: int, way: Approach) -> None:
        """Fit a candidate from some place on, and keep that if it is better than what is known of it."""
        problem, here = self._problem, self._here
        beat = min((loss_of_fit(problem, one.fit) for one in self.found.values()), default=math.inf)
        reached = finish(problem, way, beat=beat)
        fitted = _kept(problem, here, reached, self._promised[k], self._seed + _AGAIN)
        again = Found(self._names[k], fitted, deviance_beside(problem, fitted, here))
        self.found[k] = min(self.found.get(k, again), again, key=lambda one: one.deviance)

    def follow_phases(self) -> None:
        """Let the phases of an open ripple follow the best of them, until one leads somewhere.

        Those that went with a model which lacks the effect hold it back: it looks smaller than it is, or needless.
        """
        problem, here = self._problem, self._here
        for k in sorted(self.found, key=lambda k: self.found[k].deviance)[:_FOLLOWED]:
            one = self.found[k].fit
            if not has_open_ripple(problem, one.model):
                continue
            if _leads_somewhere(problem, here, self.found.values()):
                break
            there, turned = in_phase(problem, one, self._seed + _TURN * (k + 1))
            if turned is not one:
                left = deviance_beside(there, turned, here)
                self.found[k] = Found(self._names[k], turned, left, there.phases)

    def through_valleys(self, ways: Mapping[int, Approach]) -> None:
        """Try other sizes of each, the best way first, until one leads somewhere."""
        for k in sorted(ways, key=lambda k: ways[k].loss):
            if _leads_somewhere(self._problem, self._here, self.found.values()):
                break
            other = through_the_valley(self._problem, ways[k])
            if other is not None:
                self.add(k, other)

    def look_closer(self) -> None:
        """Fit those on with more effort that keep little of what straight lines promised of them.

        Near a true model a look differs by chance as much as by the effect, and a fit stops on its way.
        """
        before = deviance_beside(self._problem, self._here, self._here)
        for k, one in self.found.items():
            if self._promised[k] > _PROMISE and before - one.deviance < _SHORT * self._promised[k]:
                self.found[k] = _more_effort(self._problem, self._here, one, self._seed + _SHARPER)

    def on_one_scale(self) -> None:
        """Judge those of which as much is simulated as of the model before by the scatter that this one has.

        Near a true model an effect hardly changes how residuals scatter. Each fit knows that to some 3 %, which is
        more than a small effect takes away.
        """
        for k, one in self.found.items():
            if _as_many_pixels(self._problem, self._here, one.fit):
                fit = replace(one.fit, scale=self._here.scale)
                self.found[k] = replace(one, fit=fit, deviance=deviance_beside(self._problem, fit, self._here))

    def go_on(self) -> None:
        """Fit the best of them on."""
        if self.found:
            best = min(self.found, key=lambda k: self.found[k].deviance)
            one = self.found[best]
            problem = one.beside(self._problem)
            gone_on = _gone_on(problem, self._here, one, self._seed + _ON)
            self.found[best] = _with_more_effort(problem, self._here, gone_on, self._seed + _SHARPER)


def _leads_somewhere(problem: Problem, here: Fit, found: Iterable[Found]) -> bool:
    """Return whether an effect explains the run, or nearly all of what is too much in it."""
    return any(
        deviance_per_dof(problem, one.fit) <= _FAR or share(problem, here, one.deviance) > NEARLY_ALL for one in found
    )


def _gone_on(problem: Problem, here: Fit, found: Found, seed: int) -> Found:
    """Return a model that was fitted on from where it was, while that helps, or what its numbers change is not known.

    That is known from around where a fit began: far from there it leads nowhere.
    """
    for number in range(_GOES_ON):
        known = _knows_its_numbers(problem, found.fit)
        if known and not is_far_off(problem, found.fit):
            break
        again = finish(problem, from_here(problem, found.fit, seed + 20 * number))
        left = deviance_beside(problem, again, here)
        still = left < _FALLING * found.deviance
        if left < found.deviance or (not known and left < found.deviance / _FALLING):
            found = replace(found, fit=again, deviance=left)
        if not still:
            break
    return found


def _with_more_effort(problem: Problem, here: Fit, found: Found, seed: int) -> Found:
    """Return a model that nearly explains the run, fitted on with more effort if that is better."""
    if not EXPLAINS < deviance_per_dof(problem, found.fit) <= NEARBY:
        return found
    return _more_effort(problem, here, found, seed)


def _more_effort(problem: Problem, here: Fit, found: Found, seed: int) -> Found:
    """Return a fit that goes on with more effort if it is better."""
    again = fitted_on(problem, found.fit, seed)
    left = deviance_beside(problem, again, here)
    return replace(found, fit=again, deviance=left) if left < found.deviance else found


def _as_many_pixels(problem: Problem, one: Fit, other: Fit) -> bool:
    """Return whether two models are simulated with equally many pixels."""
    costs = [problem.cost(each.models(problem)) for each in (one, other)]
    return costs[0] == costs[1] and least_share(one.model) == least_share(other.model)


def _knows_its_numbers(problem: Problem, one: Fit) -> bool:
    """Return whether a fit says how well each of its numbers is known."""
    return bool(np.all(np.isfinite(np.diag(one.covariance(problem.measured.points)))))


def _kept(problem: Problem, here: Fit, fitted: Fit, promised: float, seed: int) -> Fit:
    """Return a fit, or a sharper one where it does not keep what straight lines promised of it.

    Of what takes long so little is simulated that chance may hide all of a fall.
    """
    before, after = loss_left(problem, here), loss_left(problem, fitted)
    # With a number more nothing is worse, but for the chance of the few pixels: there may be no hot one among them.
    worse = deviance_beside(problem, fitted, here) > deviance_beside(problem, here, here)
    short = promised > _PROMISE and (before - after < _SHORT * promised or worse) and after < _BEYOND_HELP * before
    if not short or not is_costly(problem, fitted):
        return fitted
    again = sharpened(problem, fitted, seed)
    return min(fitted, again, key=lambda one: deviance_beside(problem, one, here))


def _raced(problem: Problem, entrants: Sequence[Approach], most: int | None, leave: float) -> list[Raced]:
    """Return what a race leaves of them; those of which whole sensors are simulated go last.

    If another one explains the run, a few looks leave them behind, while their own way takes minutes.
    """
    order = sorted(range(len(entrants)), key=lambda k: least_share(entrants[k].model))
    raced = dict(zip(order, race(problem, [entrants[k] for k in order], most, leave), strict=True))
    return [raced[k] for k in range(len(entrants))]


def needless(problem: Problem, before: Fit, one: Fit, effect_id: str) -> bool:
    """Return whether all numbers of an effect are within chance of null; see :func:`strength`."""
    return strength(problem, before, one, effect_id) < NEEDED


def strength(problem: Problem, before: Fit, one: Fit, effect_id: str) -> float:
    """Return by how many standard errors the clearest of the numbers that switch an effect on is off null.

    How many pixels have what few of them have is known from so few to no better than their root, were it beyond doubt
    that there is one: of that the fall of the deviance tells, if the model still has half of one.

    Parameters
    ----------
    before
        A model without the effect.
    """
    effect = next(e for e in one.model.effects if e.id == effect_id)
    if is_of_few(effect_id):
        pixels = max(point.roi.pixels for point in problem.points)
        if getattr(effect, switches(type(effect))[0].field) * pixels < _HALF_A_PIXEL:
            return 0.0
        left = deviance(problem, one, before.scale) / freedom(one) * freedom(before)
        return math.sqrt(max(deviance(problem, before) - left, 0.0))
    sd = np.sqrt(np.diag(one.covariance(problem.measured.points)))
    names = {f.name for f in switches(type(effect))}
    mine = [i for i, s in enumerate(one.slots) if s.free.owner == effect_id and s.free.name in names]
    return float(max(abs(one.x[i]) / sd[i] for i in mine))
