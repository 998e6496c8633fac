"""Which effect is worth adding to a fitted model: the most promising are refitted, the best of them is proposed."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, Protocol

import numpy as np

from bench.diagnosis.expected.catalogue import RARE, TWINS, are_the_same
from bench.diagnosis.fitting.judging import deviance, freedom, is_far_off, loss_left, share
from bench.diagnosis.searching.likeness import nearer
from bench.diagnosis.searching.refit import Found
from bench.diagnosis.searching.screen import score
from bench.diagnosis.searching.sizing import at_other_sizes
from bench.diagnosis.searching.state import can_judge, leaves_little, may_be_added
from bench.diagnosis.searching.ties import tied_with

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from bench.diagnosis.expected.problem import Problem
    from bench.diagnosis.fitting.fitted import Fit
    from bench.diagnosis.searching.screen import Scores
    from bench.diagnosis.searching.state import State
    from bench.diagnosis.session import Session

__all__ = ["ALPHA", "Refit", "Shortlist"]

#: Chance of naming an effect where none is missing, at each step.
ALPHA: Final = 0.01
_SHORTLIST: Final = 3
#: If none on it is worth adding, the next ones are; so many in all. All at once, where none promises such a share of
#: what is too much in the loss.
_SHORTLISTS: Final = 2
_FORESEEN: Final = 0.3
#: Near a true model those are refitted together that promise such a share of what the clearest does.
_ABOUT_AS_MUCH: Final = 0.5
#: Only effects are on it that are expected to explain at least so much of what the first of them does.
_PROMISING: Final = 0.05
#: Where the model is far off, an effect that is worth its name takes away this share of what is too much.
_WORTH: Final = 0.15
#: What promises nothing, and is asked all the same, takes away so much of it; it is left soon unless the loss is down
#: to this share by then.
_SURE: Final = 0.75
_LEFT_SOON: Final = 0.7
#: Of effects that cannot be told apart one is only proposed in place of the best when its fit is about as good.
_AS_GOOD: Final = 1.1
#: Deviances of two fitted models that differ by fewer standard deviations may differ by the chance of simulations.
_ABOUT: Final = 4.0
#: The loss, in which large residuals count by their size, falls by so much, too.
_LEAST_FALL: Final = 4.0


class Refit(Protocol):
    """Fits the model of a state with each of some effects more; see :func:`.searching.refit.refitted`."""

    def __call__(
        self, state: State, effect_ids: Sequence[str], most: int | None = None, leave: float = math.inf
    ) -> list[Found]:
        """Return those that come close to the best of them."""


class Shortlist:
    """Finds the effect that is worth adding, and those that cannot be told from it.

    Parameters
    ----------
    session
        The runs.
    refit
        Fits the model with an effect more.
    seed
        Of the simulations.
    """

    def __init__(self, session: Session, refit: Refit, seed: int) -> None:
        self._session = session
        self._refit = refit
        self._seed = seed
        self._asked_all = False  # whether all effects were refitted, because nothing promised anything

    @property
    def _problem(self) -> Problem:
        return self._session.problem

    def choose(self, state: State, without: Collection[str] = ()) -> None:
        """Find the effect that is worth adding, and those that cannot be told from it.

        Parameters
        ----------
        without
            Effects that are not asked again: they were taken out.
        """
        names = [name for name in self._promising(state.fit, state.scores) if name not in without]
        if not is_far_off(self._problem, state.fit):
            names = names[:_SHORTLIST]
            clearest = self._with_twins(state, self._about_as_promising(state.scores, names), without)
            # These may be finer than what can be told, or needless.
            for some in (clearest, *([name] for name in names if name not in clearest)):
                if state.proposal is None and some:
                    self._propose(state, some)
            return
        together = _SHORTLIST if self._is_foreseen(state) else _SHORTLISTS * _SHORTLIST
        for first in range(0, min(len(names), _SHORTLISTS * _SHORTLIST), together):
            if state.proposal is None:
                self._propose(state, self._with_twins(state, names[first : first + together], without))
        if state.proposal is None and not self._asked_all:
            self._propose(state, self._all_others(state, without), _SURE, _SHORTLIST, _LEFT_SOON)
            self._asked_all = True
        if state.proposal is None:
            self._propose(state, self._at_other_sizes(state, without), _SURE)

    def promises(self, fit: Fit, scores: Scores) -> bool:
        """Return whether any effect is significant before it is refitted."""
        return bool(self._promising(fit, scores))

    def _is_foreseen(self, state: State) -> bool:
        """Return whether some effect promises a good part of what is missing: else their order says little."""
        left = loss_left(self._problem, state.fit) - freedom(state.fit)
        return float(max(state.scores.drop, default=0.0)) > _FORESEEN * left

    def _promising(self, fit: Fit, scores: Scores) -> list[str]:
        """Return the effects that are significant, the most promising first."""
        significant = [
            i for i in range(len(scores.probes))
            if scores.p_best[i] < ALPHA and scores.drop[i] > _LEAST_FALL and can_judge(self._problem, scores, i)
        ]  # fmt: skip
        if not significant:
            return []
        far_off = is_far_off(self._problem, fit)
        significant.sort(key=lambda i: -scores.drop[i] if far_off else scores.p_value[i])
        enough = _PROMISING * scores.drop[significant[0]] if far_off else -math.inf
        return [scores.probes[i].effect.id for i in significant if scores.drop[i] >= enough]

    @staticmethod
    def _about_as_promising(scores: Scores, names: Sequence[str]) -> list[str]:
        """Return the first of some effects, and those that promise about as much: the screen does not tell the best.

        Two that do nearly the same differ in it by the chance of the changes that are expected.
        """
        if not names:
            return []
        drop = {one.effect.id: float(drop) for one, drop in zip(scores.probes, scores.drop, strict=True)}
        return [name for name in names if name == names[0] or drop[name] > _ABOUT_AS_MUCH * drop[names[0]]]

    def _all_others(self, state: State, without: Collection[str]) -> list[str]:
        """Return the effects that were not refitted yet.

        In a bent valley straight lines promise nothing: where noise of the floor has taken the place of that of the
        resets, nothing but both numbers together makes it better.
        """
        scores = state.scores
        order = [int(i) for i in np.argsort(-scores.drop, kind="stable") if can_judge(self._problem, scores, int(i))]
        names = [scores.probes[i].effect.id for i in order]
        return [name for name in names if name not in state.refitted and name not in without]

    def _at_other_sizes(self, state: State, without: Collection[str]) -> list[str]:
        """Return the effects that promise something once they are probed at other sizes; they are refitted again."""
        problem, fit = self._problem, state.fit
        probes = at_other_sizes(problem, fit, state.scores.probes, self._seed + 87)
        moved = {new.effect.id for old, new in zip(state.scores.probes, probes, strict=True) if new is not old}
        scores = score(problem, fit, probes, self._seed, far_off=True)
        names = [name for name in self._promising(fit, scores) if name in moved and name not in without]
        names = names[: _SHORTLISTS * _SHORTLIST]
        if names:
            state.scores = scores
        state.refitted = {name: found for name, found in state.refitted.items() if name not in names}
        state.hopeless -= set(names)
        return names

    def _with_twins(self, state: State, names: Sequence[str], without: Collection[str]) -> list[str]:
        known = {one.effect.id for one in state.scores.probes} - state.refitted.keys() - set(without)
        twins = [TWINS[name] for name in names if name in TWINS]
        return [*names, *(name for name in dict.fromkeys(twins) if name in known and name not in names)]

    def _without_the_same(self, names: Sequence[str]) -> list[str]:
        """Return effects without those that are the same in this run as a more usual one among them."""
        points = self._problem.points
        return [n for n in names if n not in RARE or not any(are_the_same(n, other, points) for other in names)]

    def _propose(
        self, state: State, shortlist: Sequence[str], worth: float = _WORTH, most: int | None = None,
        leave: float = math.inf,
    ) -> None:  # fmt: skip
        """Propose the best of some effects once they are refitted, if it is worth adding.

        Parameters
        ----------
        worth
            Share that it must take away of what is too much in the deviance, where that is far off.
        most
            So many of them are fitted to the end.
        leave
            See :func:`~bench.diagnosis.searching.race.race`.
        """
        far_off = is_far_off(self._problem, state.fit)
        refitted = self._refit(state, self._without_the_same(shortlist), most, leave)
        found = sorted((f for f in refitted if may_be_added(self._problem, state.fit, f)), key=lambda f: f.deviance)
        if not far_off:  # what the screen promises of a small effect may be chance, in the changes it expects
            before = Found(state.added or "", state.fit, deviance(self._problem, state.fit))
            found = [f for f in found if nearer(self._problem, f, before, self._seed + 57) < 0.0]
        if not found or (far_off and share(self._problem, state.fit, found[0].deviance) < worth):
            return
        found = self._with_the_nearest_first(found)
        best = found[0]
        # The fit of its twin may have been given up early: what that can do is looked at all the same.
        refused = ({f.effect for f in refitted} - {f.effect for f in found}) | state.hopeless
        refused -= {TWINS.get(best.effect)}
        # Nor do straight lines tell what is like an effect of which they promised hardly anything.
        lines_tell = not far_off and best.effect in self._about_as_promising(state.scores, shortlist)
        rivals = () if lines_tell else [name for name in shortlist if name not in refused]
        problem = best.beside(self._problem)
        judged = [i for i in range(len(state.scores.probes)) if can_judge(self._problem, state.scores, i)]
        tied = (best.effect, *tied_with(problem, best, found, state.scores, judged, rivals, self._seed + 31))
        # Of effects that are the same to the data, the more usual one is proposed. While something else is missing,
        # what tells an effect from its twin may be that.
        good = {f.effect for f in found if f.deviance <= _AS_GOOD * best.deviance}
        alike = tied if leaves_little(self._problem, best.fit) else (*tied, TWINS.get(best.effect, best.effect))
        state.proposal = next((name for name in alike if name not in RARE and name in good), best.effect)
        state.tied = tuple(name for name in tied if name != state.proposal)

    def _with_the_nearest_first(self, found: Sequence[Found]) -> list[Found]:
        """Return fitted models; first the one to which the run is nearest, of those about as good as the best.

        Their deviances are no more different than the chance of the simulations. Where it is not sure which is nearer
        either, the better fit stays.
        """
        best = found[0]
        for other in found[1:]:
            if other.deviance - best.deviance < _ABOUT * math.sqrt(2.0 * freedom(best.fit)):
                problem = best.beside(self._problem)
                best = other if nearer(problem, best, other, self._seed + 57, surely=True) > 0.0 else best
        return [best, *(one for one in found if one is not best)]
