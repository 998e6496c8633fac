"""A diagnosis step by step: which effect is missing, add it, watch the error fall."""

from __future__ import annotations

import math
from contextlib import ExitStack
from copy import copy
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from bench.compute import Workforce
from bench.diagnosis.approach import approach
from bench.diagnosis.catalogue import RARE, TWINS, are_the_same, candidates
from bench.diagnosis.details import with_a_detail
from bench.diagnosis.fit import finish
from bench.diagnosis.gate import findings_of
from bench.diagnosis.judging import (
    deviance,
    deviance_beside,
    deviance_per_dof,
    excess,
    freedom,
    step_of,
)
from bench.diagnosis.likeness import nearer
from bench.diagnosis.next_measurement import next_measurement
from bench.diagnosis.refit import Found, needless, refitted
from bench.diagnosis.remainder import remainder_of
from bench.diagnosis.result import Candidate, Outcome
from bench.diagnosis.robust import loss
from bench.diagnosis.screen import score
from bench.diagnosis.session import open_session
from bench.diagnosis.settling import settled
from bench.diagnosis.sizing import probe
from bench.diagnosis.ties import tied_with, told_apart
from bench.store import Run
from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Sequence
    from types import TracebackType

    from bench.diagnosis.fitted import Fit
    from bench.diagnosis.parameters import Free
    from bench.diagnosis.probing import Probe, Probed
    from bench.diagnosis.problem import Problem
    from bench.diagnosis.result import Step, Verdict
    from bench.diagnosis.screen import Scores
    from bench.diagnosis.session import Session
    from sim_backend.pixel.model import PixelModel

__all__ = ["ALPHA", "Diagnosis"]

#: Chance of naming an effect where none is missing, at each step.
ALPHA: Final = 0.01
#: Above this deviance per degree of freedom straight lines do not tell the best effect: the shortlist is refitted.
_FAR_OFF: Final = 1.3
_SHORTLIST: Final = 3
#: If none on it is worth adding, the next ones are; so many in all. All at once, where none promises such a share of
#: what is too much in the loss.
_SHORTLISTS: Final = 2
_FORESEEN: Final = 0.3
#: Above this one, effects are gross: each does something else at another size.
_GROSS: Final = 4.0
#: Only effects are on it that are expected to explain at least so much of what the first of them does.
_PROMISING: Final = 0.05
#: Where the model is far off, an effect that is worth its name takes away this share of what is too much.
_WORTH: Final = 0.15
#: Where something is left that nothing explains, only effects that take away so much of it are named.
_SURE: Final = 0.75
#: What promises nothing, and is asked all the same, is left soon unless the loss is down to this share of it by then.
_LEFT_SOON: Final = 0.7
#: Up to this deviance per degree of freedom not much is left.
_NEARLY: Final = 1.5
#: The deviance of a true model is larger than expected by so many standard deviations hardly ever.
_EXPLAINED: Final = 5.0
#: Where something is left that nothing explains, other ways are tried, at the most so many: with an effect that took
#: away more than this share of what the one that was added did.
_DETOURS: Final = 2
_NEARLY_AS_WELL: Final = 0.5
#: Of effects that cannot be told apart one is only proposed in place of the best when its fit is about as good.
_AS_GOOD: Final = 1.1
#: Deviances of two fitted models that differ by fewer standard deviations may differ by the chance of simulations.
_ABOUT: Final = 4.0
#: The loss, in which large residuals count by their size, falls by so much, too.
_LEAST_FALL: Final = 4.0
#: Times shorter than so many looks of the comparators are not told from how time is cut into samples.
_LOOKS: Final = 2.0
#: Details of effects that are set free in one step, at the most.
_DETAILS: Final = 2
#: Standard errors at which an effect is found as a rule.
_DETECTED: Final = 4.5


class _State:
    """A fitted model, what is known about what it lacks, and how it came about."""

    def __init__(self, fit: Fit, scores: Scores, added: str | None, fall: float) -> None:
        self.fit = fit
        self.scores = scores
        self.added = added
        self.fall = fall  #: share of what was too much in the deviance that the effect took away
        self.refitted: dict[str, Found] = {}
        self.hopeless: frozenset[str] = frozenset()  #: effects that come nowhere near the best
        self.tied: tuple[str, ...] = ()
        self.proposal: str | None = None
        self.chosen = False  #: whether a proposal was looked for


class Diagnosis:
    """One or several runs of a sensor, and the model that is to explain them.

    Parameters
    ----------
    runs
        Folders, or opened runs.
    model
        To start from; None for the base pixel. Its base numbers are fitted, and those of the effects that it has.
    seed
        The same seed gives the same verdict.
    workers
        Processes that simulate.
    without
        Effects that are not thought of.
    tell
        Called with what is being done.
    workforce
        Who simulates, instead of `workers` processes.
    whole
        Look at all of long recordings, however long that takes; default is their beginnings.

    Raises
    ------
    InputError
        The runs cannot be diagnosed together.

    Examples
    --------
    >>> with Diagnosis("runs/night-1") as d:  # doctest: +SKIP
    ...     d.add("leak")
    ...     print(d.steps[-1].error)
    """

    def __init__(
        self,
        runs: Run | Path | str | Sequence[Run | Path | str],
        model: PixelModel | None = None,
        *,
        seed: int = 1,
        workers: int = 1,
        without: Collection[str] = (),
        tell: Callable[[str], None] | None = None,
        workforce: Workforce | None = None,
        whole: bool = False,
    ) -> None:
        several = [runs] if isinstance(runs, Run | Path | str) else list(runs)
        opened = [r if isinstance(r, Run) else Run.open(Path(r)) for r in several]
        self._say = tell or (lambda _: None)
        self._seed = seed
        self._without = frozenset(without)
        self._open = ExitStack()
        self._session: Session = self._open.enter_context(
            open_session(opened, model, workforce or Workforce(workers), whole=whole)
        )
        self._states: list[_State] = []
        self._next: tuple[Fit, dict[str, Any] | None] | None = None
        self._asked_all = False  # whether all effects were refitted, because nothing promised anything
        self._seen: Probed = {}  # how well each effect is seen hardly depends on the step
        self.findings: tuple[str, ...] = findings_of(self._session.problem)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Let the workers go."""
        self._open.close()

    @property
    def problem(self) -> Problem:
        """The runs, as they are laid beside a model."""
        return self._session.problem

    @property
    def shortened(self) -> str:
        """How much of the recordings is looked at; empty where it is all."""
        return self._session.shortened

    @property
    def fits(self) -> tuple[Fit, ...]:
        """The fitted model of each step."""
        return tuple(state.fit for state in self._all())

    @property
    def steps(self) -> tuple[Step, ...]:
        """What was found in each step; the first is the model to start from."""
        return tuple(self._step(number, state) for number, state in enumerate(self._all()))

    @property
    def proposal(self) -> str | None:
        """The effect that the data ask for most; None if none is significant."""
        state = self._all()[-1]
        if not state.chosen:
            self._choose(state)
            state.chosen = True
        return state.proposal

    def add(self, effect_id: str) -> Step:
        """Add an effect, fit the model again, and look at what is still missing.

        Raises
        ------
        InputError
            There is no such effect, or the model has it.
        """
        state = self._all()[-1]
        found = self._refitted(state, [effect_id])[0]
        self._states.append(self._look(found.fit, effect_id, self._share(state, found)))
        return self._last_step()

    def undo(self) -> Step:
        """Take the last effect out again.

        Raises
        ------
        InputError
            None was added.
        """
        if len(self._all()) == 1:
            raise InputError("nothing was added; there is nothing to take back")
        self._states.pop()
        return self._last_step()

    def run(self, most: int = 3) -> Outcome:
        """Add what is missing, step by step, until nothing more is significant; drop what is needless."""
        if self.findings:
            return self.outcome()
        self._go_on(most)
        if not self._is_explained(self._states[-1]):
            self._try_others(most)
        return self.outcome()

    def outcome(self) -> Outcome:
        """Return what was found so far."""
        states = self._all() if not self.findings else self._states
        verdict, missing = self._verdict(states)
        last = states[-1].fit if states else None
        ties = _ties(states, missing)
        ties = told_apart(ties, self.problem, last) if last is not None else ties
        return Outcome(
            runs=self._session.ids,
            findings=self.findings,
            steps=self.steps if states else (),
            verdict=verdict,
            missing=missing,
            ties=ties,
            next_measurement=self._next_measurement(last, ties),
            remainder=remainder_of(self.problem, last) if last is not None and verdict == "unexplained" else (),
            model=last.model if last is not None else None,
            shortened=self.shortened,
        )

    def _next_measurement(self, last: Fit | None, ties: dict[str, tuple[str, ...]]) -> dict[str, Any] | None:
        """Return what to measure next; it is simulated once for each fitted model."""
        if last is None or not ties:
            return None
        if self._next is None or self._next[0] is not last:
            self._say("looking for the measurement that tells them apart")
            self._next = last, next_measurement(self.problem, last, ties, self._seed + 61)
        return self._next[1]

    def _go_on(self, most: int) -> None:
        """Add what is missing until nothing more is significant; what was taken out does not come back."""
        added: set[str] = set()
        while len(self._all()) <= most:
            proposal = self.proposal
            if proposal is None or proposal in added:
                break
            added.add(proposal)
            self.add(proposal)
            self._drop()

    def _try_others(self, most: int) -> None:
        """Go back to where another effect did nearly as well, and on from there; keep what explains the run, if any.

        While several effects are missing, one that is not may do best at first, and leave what nothing explains.
        """
        known = self._states
        for depth, other in self._others(known)[:_DETOURS]:
            self._say(f"step {depth + 1}: another way, with {other.effect}")
            self._states = [*known[:depth], self._proposing(known[depth], other.effect)]
            share = self._share(known[depth], other)
            self._states = [*self._states, self._look(other.fit, other.effect, share)]
            self._drop()
            self._go_on(most)
            if self._is_explained(self._states[-1]):
                return
        self._states = known

    def _proposing(self, state: _State, effect_id: str) -> _State:
        """Return the state with another proposal; it is tied with what is the same to a pixel."""
        other = copy(state)
        ids = [one.effect.id for one in state.scores.probes if one.effect.id != effect_id]
        other.proposal = effect_id
        other.tied = tuple(name for name in ids if are_the_same(name, effect_id, self.problem.points))
        return other

    def _others(self, states: Sequence[_State]) -> list[tuple[int, Found]]:
        """Return effects that did nearly as well as what was added, and the step before; the last step first."""
        found = []
        for depth, (before, after) in reversed(list(enumerate(pairwise(states)))):
            tried = {after.added, before.proposal, *before.tied}
            known = [f for f in before.refitted.values() if f.effect not in tried and self._may_be_added(f)]
            known.sort(key=lambda f: f.deviance)
            found += [(depth, f) for f in known if self._share(before, f) > _NEARLY_AS_WELL * after.fall]
        return found

    def _may_be_added(self, found: Found) -> bool:
        return self._is_coarse(found.fit, found.effect) and not needless(self.problem, found.fit, found.effect)

    def _is_explained(self, state: _State) -> bool:
        return excess(self.problem, state.fit) <= _EXPLAINED

    def _all(self) -> list[_State]:
        """Return the states, of which there is at least one."""
        if not self._states:
            self._say("fitting the model")
            first = self._session.fit(self._seed)
            self._states.append(self._look(first, None, 0.0))
        return self._states

    def _look(self, fitted: Fit, added: str | None, fall: float) -> _State:
        number = len(self._states)
        fitted = self._session.in_phase(fitted, self._seed + 100 * number + 76)
        fitted = settled(self.problem, fitted, self._seed + 100 * number + 71)
        self._say(f"step {number}: looking for what is missing")
        scores = self._probed(fitted, number)
        for more in range(_DETAILS):
            promised = float(max(scores.drop, default=0.0))
            detailed = with_a_detail(self.problem, fitted, self._seed + 100 * number + 79 + 3 * more, promised)
            if detailed is fitted:
                break
            self._say(f"step {number}: with a detail more, looking again")
            fitted = settled(self.problem, detailed, self._seed + 100 * number + 81 + 3 * more)
            scores = self._probed(fitted, number)
        return _State(fitted, scores, added, fall)

    def _probed(self, fitted: Fit, number: int) -> Scores:
        """Return what each effect that is not in the model promises."""
        possible = candidates(fitted.model, self.problem.points, without=self._without)
        seed = self._seed + 100 * number + 17
        gross = deviance_per_dof(self.problem, fitted) > _GROSS
        return self._scores(fitted, probe(self.problem, fitted, possible, seed, gross, self._seen))

    def _scores(self, fitted: Fit, probes: Sequence[Probe]) -> Scores:
        """Return what probes say; near the minimum what may be how time is cut is no sign of anything else."""
        if self._far_off(fitted):
            return score(self.problem, fitted, probes, self._seed, far_off=True)
        scores = score(self.problem, fitted, probes, self._seed)
        fine = [p for i, p in enumerate(probes) if scores.p_best[i] < ALPHA and not self._can_judge(scores, i)]
        if not fine:
            return scores
        beside = score(self.problem, fitted, probes, self._seed, fine)
        return replace(scores, p_value=beside.p_value, p_best=beside.p_best)

    def _choose(self, state: _State) -> None:
        """Find the effect that is worth adding, and those that cannot be told from it."""
        names = self._promising(state)
        if not self._far_off(state.fit):
            self._propose(state, names[:1])
            return
        together = _SHORTLIST if self._is_foreseen(state) else _SHORTLISTS * _SHORTLIST
        for first in range(0, min(len(names), _SHORTLISTS * _SHORTLIST), together):
            if state.proposal is None:
                self._propose(state, self._with_twins(state, names[first : first + together]))
        if state.proposal is None and not self._asked_all:
            self._asked_all = True
            self._propose(state, self._all_others(state), _SURE, _SHORTLIST, _LEFT_SOON)

    def _is_foreseen(self, state: _State) -> bool:
        """Return whether some effect promises a good part of what is missing: else their order says little."""
        left = loss(state.fit.whiten(state.fit.residual, self.problem.measured.points)) - freedom(state.fit)
        return float(max(state.scores.drop, default=0.0)) > _FORESEEN * left

    def _promising(self, state: _State) -> list[str]:
        """Return the effects that are significant, the most promising first."""
        scores = state.scores
        significant = [
            i for i in range(len(scores.probes))
            if scores.p_best[i] < ALPHA and scores.drop[i] > _LEAST_FALL and self._can_judge(scores, i)
        ]  # fmt: skip
        if not significant:
            return []
        far_off = self._far_off(state.fit)
        significant.sort(key=lambda i: -scores.drop[i] if far_off else scores.p_value[i])
        enough = _PROMISING * scores.drop[significant[0]] if far_off else -math.inf
        return [scores.probes[i].effect.id for i in significant if scores.drop[i] >= enough]

    def _all_others(self, state: _State) -> list[str]:
        """Return the effects that were not refitted yet.

        In a bent valley straight lines promise nothing: where noise of the floor has taken the place of that of the
        resets, nothing but both numbers together makes it better.
        """
        scores = state.scores
        order = [int(i) for i in np.argsort(-scores.drop, kind="stable") if self._can_judge(scores, int(i))]
        names = [scores.probes[i].effect.id for i in order]
        return [name for name in names if name not in state.refitted]

    def _with_twins(self, state: _State, names: Sequence[str]) -> list[str]:
        known = {one.effect.id for one in state.scores.probes} - state.refitted.keys()
        twins = [TWINS[name] for name in names if name in TWINS]
        return [*names, *(name for name in dict.fromkeys(twins) if name in known and name not in names)]

    def _without_the_same(self, names: Sequence[str]) -> list[str]:
        """Return effects without those that are the same in this run as a more usual one among them."""
        points = self.problem.points
        return [n for n in names if n not in RARE or not any(are_the_same(n, other, points) for other in names)]

    def _propose(
        self, state: _State, shortlist: Sequence[str], worth: float = _WORTH, most: int | None = None,
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
            See :func:`~bench.diagnosis.race.race`.
        """
        far_off = self._far_off(state.fit)
        refitted = self._refitted(state, self._without_the_same(shortlist), most, leave)
        found = sorted((f for f in refitted if self._may_be_added(f)), key=lambda f: f.deviance)
        if not far_off:  # what the screen promises of a small effect may be chance, in the changes it expects
            before = Found(state.added or "", state.fit, deviance(self.problem, state.fit))
            found = [f for f in found if nearer(self.problem, f, before, self._seed + 57) < 0.0]
        if not found or (far_off and self._share(state, found[0]) < worth):
            return
        found = self._with_the_nearest_first(found)
        best = found[0]
        refused = ({f.effect for f in refitted} - {f.effect for f in found}) | state.hopeless
        rivals = [name for name in shortlist if name not in refused] if far_off else ()
        judged = [i for i in range(len(state.scores.probes)) if self._can_judge(state.scores, i)]
        tied = (best.effect, *tied_with(self.problem, best, found, state.scores, judged, rivals, self._seed + 31))
        # Of effects that are the same to the data, the more usual one is proposed. While something else is missing,
        # what tells an effect from its twin may be that.
        good = {f.effect for f in found if f.deviance <= _AS_GOOD * best.deviance}
        alike = tied if excess(self.problem, best.fit) <= _EXPLAINED else (*tied, TWINS.get(best.effect, best.effect))
        state.proposal = next((name for name in alike if name not in RARE and name in good), best.effect)
        state.tied = tuple(name for name in tied if name != state.proposal)

    def _with_the_nearest_first(self, found: Sequence[Found]) -> list[Found]:
        """Return fitted models; first the one to which the run is nearest, of those about as good as the best.

        Their deviances are no more different than the chance of the simulations.
        """
        best = found[0]
        for other in found[1:]:
            if other.deviance - best.deviance < _ABOUT * math.sqrt(2.0 * freedom(best.fit)):
                best = other if nearer(self.problem, best, other, self._seed + 57) > 0.0 else best
        return [best, *(one for one in found if one is not best)]

    def _refitted(
        self, state: _State, effect_ids: Sequence[str], most: int | None = None, leave: float = math.inf
    ) -> list[Found]:  # fmt: skip
        """Return the models with one of these effects more, the most promising of them fitted."""
        ids = [one.effect.id for one in state.scores.probes]
        for name in effect_ids:
            if name not in ids:
                raise InputError(
                    f"{name}: not among the effects that may be missing; expected one of {', '.join(ids)}"
                )
        unknown = [name for name in effect_ids if name not in state.refitted]
        if unknown:
            self._say(f"refitting with {', '.join(unknown)}")
            far_off = self._far_off(state.fit)
            seed = self._seed + 100 * len(self._states) + 21
            numbers = [ids.index(name) for name in unknown]
            made = refitted(self.problem, state.fit, state.scores, numbers, seed, far_off, most, leave)
            state.refitted |= {found.effect: found for found in made.found}
            state.hopeless |= made.hopeless
        return [state.refitted[name] for name in effect_ids if name in state.refitted]

    def _can_judge(self, scores: Scores, i: int) -> bool:
        """Return whether an effect is coarser than the grid of the simulation, if it is a matter of time."""
        sizes = zip(scores.probes[i].free, scores.size[i], strict=True)
        return all(size == 0.0 or self._coarse(free, float(size)) for free, size in sizes)

    def _is_coarse(self, fitted: Fit, effect_id: str) -> bool:
        """Return the same of a fitted effect."""
        numbers = zip(fitted.slots, fitted.x, strict=True)
        return all(self._coarse(slot.free, float(x)) for slot, x in numbers if slot.free.owner == effect_id)

    def _coarse(self, free: Free, coordinate: float) -> bool:
        finest = _LOOKS * self.problem.forward.dt_s
        return free.unit != "s" or free.scale == "log" or free.value(abs(coordinate)) >= finest

    def _far_off(self, fitted: Fit) -> bool:
        """Return whether straight lines do not tell what is missing."""
        return deviance_per_dof(self.problem, fitted) > _FAR_OFF

    def _share(self, state: _State, found: Found) -> float:
        """Return the share of what is too much in the deviance that an effect takes away."""
        n = freedom(state.fit)
        before = max(deviance(self.problem, state.fit) - n, math.sqrt(2.0 * n))
        return (deviance(self.problem, state.fit) - found.deviance) / before

    def _drop(self) -> None:
        """Take out effects that were added before and have turned out to be needless."""
        while len(self._states) > 2:
            last = self._states[-1]
            names = [s.added for s in self._states[1:-1] if s.added is not None]
            weak = [name for name in names if needless(self.problem, last.fit, name, before=True)]
            if not weak:
                return
            self._say(f"taking out {weak[0]}")
            kept = [s for s in self._states if s.added != weak[0]]
            slots = [i for i, s in enumerate(last.fit.slots) if s.free.owner != weak[0]]
            again = finish(
                self.problem,
                approach(
                    self.problem, last.fit.model.without(weak[0]), [last.fit.slots[i] for i in slots],
                    [float(last.fit.x[i]) for i in slots], seed=self._seed + 41, iterations=3,
                    prior=last.fit.start[slots],
                ),
            )  # fmt: skip
            self._states = kept[:-1]
            before = self._states[-1]
            left = deviance_beside(self.problem, again, before.fit)
            share = self._share(before, Found(last.added or "", again, left))
            self._states.append(self._look(again, last.added, share))

    def _verdict(self, states: Sequence[_State]) -> tuple[Verdict, tuple[str, ...]]:
        if self.findings:
            return "data_not_fit_to_judge", ()
        named = tuple(s.added for s in states[1:] if s.added is not None)
        if self._is_explained(states[-1]):
            return ("explained" if named else "nothing_missing"), named
        # Effects that leave much behind may only have mimicked what no catalogue knows.
        nearly = deviance_per_dof(self.problem, states[-1].fit) < _NEARLY
        sure = (
            after.added for before, after in pairwise(states)
            if after.added is not None and (nearly or min(after.fall, self._share_of_loss(before, after)) > _SURE)
        )  # fmt: skip
        return "unexplained", tuple(sure)

    def _share_of_loss(self, before: _State, after: _State) -> float:
        """Return the share of what was too much in the loss that an effect took away.

        The deviance may be that of a few statistics, of which hardly anything was to be expected: an effect that lets
        a little more be expected of them takes most of it away, and they are as wrong as before.
        """
        one, other = (loss(s.fit.whiten(s.fit.residual, self.problem.measured.points)) for s in (before, after))
        n = freedom(before.fit)
        return (one - other) / max(one - n, math.sqrt(2.0 * n))

    def _last_step(self) -> Step:
        return self._step(len(self._states) - 1, self._states[-1])

    def _step(self, number: int, state: _State) -> Step:
        scores = state.scores
        before = deviance(self.problem, state.fit)
        rows = []
        for i in np.argsort(-scores.drop, kind="stable"):
            one = scores.probes[i]
            name = one.effect.id
            found = state.refitted.get(name)
            rows.append(
                Candidate(
                    name,
                    float(scores.drop[i]),
                    before - found.deviance if found is not None else None,
                    float(scores.p_best[i]),
                    state.tied if name == state.proposal else (),
                    _smallest(scores, int(i)),
                )
            )
        return step_of(self.problem, state.fit, number, state.added, rows)


def _ties(states: Sequence[_State], missing: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Return for each effect that was added what could take its place, but for what was added as well."""
    found = {}
    for before, state in pairwise(states):
        others = tuple(name for name in before.tied if states[-1].fit.model.effect(name) is None)
        if state.added is not None and state.added in missing and others and before.proposal == state.added:
            found[state.added] = others
    return found


def _smallest(scores: Scores, i: int) -> float | None:
    """Return the least size of an effect that would have been seen, in the unit of its first number."""
    one, seen = scores.probes[i], float(scores.seen[i])
    if seen <= 0.0 or one.free[0].scale == "inverse":
        return None
    return one.free[0].value(one.at[0] * _DETECTED / seen)
