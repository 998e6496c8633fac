"""A diagnosis step by step: which effect is missing, add it, watch the error fall."""

from __future__ import annotations

import math
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self

from bench.diagnosis.expected.catalogue import candidates, why_not
from bench.diagnosis.expected.gate import cautions_of, findings_of
from bench.diagnosis.fitting.details import with_a_detail
from bench.diagnosis.fitting.judging import (
    deviance_beside,
    deviance_per_dof,
    is_far_off,
    leaves_more_than_chance,
    share,
)
from bench.diagnosis.fitting.settling import settled
from bench.diagnosis.fitting.sharpening import asks_for_more, fitted_on
from bench.diagnosis.result import Outcome
from bench.diagnosis.searching.better_place import better_place
from bench.diagnosis.searching.candidate_table import step_with_candidates
from bench.diagnosis.searching.detours import other_ways, proposing
from bench.diagnosis.searching.fall_of_errors import errors_of
from bench.diagnosis.searching.next_measurement import next_measurement, with_rivals
from bench.diagnosis.searching.refit import refitted
from bench.diagnosis.searching.remainder import remainder_of
from bench.diagnosis.searching.screen import score
from bench.diagnosis.searching.shortlist import ALPHA, Shortlist
from bench.diagnosis.searching.sizing import probe
from bench.diagnosis.searching.state import State, can_judge, is_explained, leaves_little, strengths
from bench.diagnosis.searching.taking_out import to_take_out, without
from bench.diagnosis.searching.ties import told_apart
from bench.diagnosis.searching.trends import clear_trends
from bench.diagnosis.searching.verdict import group_of, ties_of, verdict_of
from bench.diagnosis.session import open_session
from bench.diagnosis.workers import processes
from bench.store import Run
from protocols.errors import InputError
from sim_backend.pixel.effects.registry import effects

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Sequence
    from types import TracebackType

    from bench.compute import Workforce
    from bench.diagnosis.expected.problem import Problem
    from bench.diagnosis.fitting.fitted import Fit
    from bench.diagnosis.fitting.probe import Probe
    from bench.diagnosis.result import Error, Step, Verdict
    from bench.diagnosis.searching.probing import Probed
    from bench.diagnosis.searching.refit import Found
    from bench.diagnosis.searching.screen import Scores
    from bench.diagnosis.session import Session
    from sim_backend.pixel.model import PixelModel

__all__ = ["Diagnosis"]

#: Above this one, effects are gross: each does something else at another size.
_GROSS: Final = 4.0
#: Where something is left that nothing explains, other ways are tried, at the most so many.
_DETOURS: Final = 2
#: Details of effects that are set free in one step, at the most.
_DETAILS: Final = 2
#: What promises where little is missing is looked at again with a seed so much larger.
_CLOSER_SEED: Final = 5_000


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
            open_session(opened, model, workforce or processes(workers), whole=whole)
        )
        self._states: list[State] = []
        self._next: tuple[Fit, dict[str, Any] | None] | None = None
        self._errors: list[tuple[Fit, Error]] = []
        self._shortlist = Shortlist(self._session, self._refitted, seed)
        self._searching = False  # or a search was cut short
        self._seen: Probed = {}  # how well each effect is seen hardly depends on the step
        self.findings: tuple[str, ...] = findings_of(self._session.problem)
        self.cautions: tuple[str, ...] = () if self.findings else cautions_of(self._session.problem)

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
    def begun(self) -> bool:
        """Whether anything was found so far."""
        return bool(self._states)

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
        states = self._all()
        steps = (self._step(number) for number in range(len(states)))
        return tuple(replace(step, error=error) for step, error in zip(steps, self._errors_of(states), strict=True))

    def _errors_of(self, states: Sequence[State]) -> Sequence[Error]:
        """Return the errors that are told; what they need is simulated once for the fits that they are of."""
        fits = [state.fit for state in states]
        if [id(fit) for fit in fits] != [id(fit) for fit, _ in self._errors]:
            self._errors = list(zip(fits, errors_of(states, self._seed + 57), strict=True))
        return [error for _, error in self._errors]

    @property
    def proposal(self) -> str | None:
        """The effect that the data ask for most; None if none is significant."""
        return self._proposal()

    def _proposal(self, without: Collection[str] = ()) -> str | None:
        """Return the same, of other effects than some."""
        state = self._all()[-1]
        if not state.chosen:
            self._shortlist.choose(state, without)
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
        self._states.append(self._with(self._refitted(state, [effect_id])[0]))
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
        self._back_to(self._states[:-1])
        return self._last_step()

    def run(self, most: int = 3, *, measure_next: bool = True) -> Outcome:
        """Add what is missing, step by step, until nothing more is significant; drop what is needless.

        Where Ctrl-C ends it, :meth:`outcome` tells what was found until then.

        Parameters
        ----------
        most
            Effects that are added at the most.
        measure_next
            As of :meth:`outcome`.
        """
        if self.findings:
            return self.outcome(measure_next=measure_next)
        self._searching = True
        self._go_on(most)
        if not is_explained(self.problem, self._states[-1]):
            self._try_others(most)
        self._searching = False
        return self.outcome(measure_next=measure_next)

    def outcome(self, *, measure_next: bool = True) -> Outcome:
        """Return what was found so far.

        Parameters
        ----------
        measure_next
            Simulate what to measure next, where effects cannot be told apart, or hardly can.
        """
        states = self._all() if not self.findings else self._states
        if states:
            self._back_to(states)  # a step may have been cut short
        verdict: Verdict = "data_not_fit_to_judge"
        missing: tuple[str, ...] = ()
        stopped = False
        if not self.findings:
            stopped = self._searching or self._might_go_on(states[-1])
            verdict, missing = verdict_of(self.problem, states, stopped, self._seed + 59, self._say)
        last = states[-1].fit if states else None
        ties = ties_of(states, missing)
        ties = told_apart(ties, self.problem, last) if last is not None else ties
        return Outcome(
            runs=self._session.ids,
            findings=self.findings,
            steps=self.steps if states else (),
            verdict=verdict,
            missing=missing,
            ties=ties,
            next_measurement=self._next_measurement(states, missing, ties) if measure_next else None,
            remainder=remainder_of(self.problem, states[-1]) if states and verdict == "unexplained" else (),
            model=last.model if last is not None else None,
            shortened=self.shortened,
            stopped=stopped,
            cautions=self.cautions,
            not_asked=self._not_asked(states[-1]) if states else {},
        )

    def _not_asked(self, state: State) -> dict[str, str]:
        """Return the effects that are neither in the model nor candidates, and why."""
        known = {*(e.id for e in state.fit.model.effects), *(one.effect.id for one in state.scores.probes)}
        return {name: self._why_not(name, state) for name in effects() if name not in known}

    def _next_measurement(
        self, states: Sequence[State], missing: Sequence[str], ties: dict[str, tuple[str, ...]]
    ) -> dict[str, Any] | None:
        """Return what to measure next; it is simulated once for each fitted model."""
        rivals = with_rivals(self.problem.points, states, missing, ties)
        if not rivals:
            return None
        last = states[-1].fit
        if self._next is None or self._next[0] is not last:
            self._say("looking for the measurement that tells effects apart")
            self._next = last, next_measurement(self.problem, last, rivals, self._seed + 61) or {}
        return self._next[1]

    def _go_on(self, most: int) -> None:
        """Add what is missing until nothing more is significant; what was taken out does not come back."""
        added: set[str] = set()
        while len(self._all()) <= most:
            proposal = self._proposal(without=added)
            if proposal in added:  # it was taken out
                proposal = self._states[-1].proposal = None
            if proposal is None:
                if not self._moved():
                    break
                continue
            added.add(proposal)
            self.add(proposal)
            self._drop()

    def _moved(self) -> bool:
        """Go on from a better place of the same model, if an effect that it does not need has led to one."""
        last = self._states[-1]
        again = better_place(self.problem, last, self._seed + 100 * len(self._states) + 51)
        if again is None:
            return False
        self._say("going on from a better place of the same model")
        left = self._states[:-1]
        self._states = [*left, self._look_again(left, again, last)]
        return True

    def _try_others(self, most: int) -> None:
        """Go back to where another effect did nearly as well, and on from there; keep what explains the run, if any.

        While several effects are missing, one that is not may do best at first, and leave what nothing explains.
        """
        known = self._states
        try:
            for depth, other in other_ways(self.problem, known)[:_DETOURS]:
                self._say(f"step {depth + 1}: another way, with {other.effect}")
                self._back_to([*known[:depth], proposing(self.problem, known[depth], other.effect)])
                self._states = [*self._states, self._with(other)]
                self._drop()
                self._go_on(most)
                if is_explained(self.problem, self._states[-1]):
                    break
        finally:  # also where it is cut short
            if not is_explained(self._states[-1].problem, self._states[-1]):
                self._back_to(known)

    def _back_to(self, states: list[State]) -> None:
        """Go on from states that were there before; phases of a ripple are those that the last of them had."""
        self._states = states
        self._session.problem = states[-1].problem

    def _all(self) -> list[State]:
        """Return the states, of which there is at least one."""
        if not self._states:
            self._say("fitting the model")
            first = self._session.fit(self._seed)
            self._states.append(self._look(first, None, []))
        return self._states

    def _with(self, found: Found) -> State:
        """Return the state in which an effect was added to the last one."""
        before = self._states[-1]
        self._session.problem = found.beside(self.problem)
        state = self._look(found.fit, found.effect, self._states, in_phase=found.phases is not None)
        state.group = group_of(before, found.effect)
        return state

    def _look_again(self, left: Sequence[State], again: Fit, like: State) -> State:
        """Return the state of a model that was fitted again, for one like it, behind the states that are left."""
        state = self._look(again, like.added, left)
        state.group = like.group
        return state

    def _look(self, fitted: Fit, added: str | None, before: Sequence[State], in_phase: bool = False) -> State:
        """Return the state of a fitted model behind others, made better where it can be."""
        number = len(before)
        fitted = self._session.in_time(fitted, self._seed + 100 * number + 66)
        if not in_phase:
            fitted = self._session.in_phase(fitted, self._seed + 100 * number + 76)
        if asks_for_more(self.problem, fitted):
            self._say(f"step {number}: fitting with more pixels")
        fitted = self._session.sharpened(fitted, self._seed + 100 * number + 31)
        still = settled(self.problem, fitted, self._seed + 100 * number + 71)
        if still is not fitted:  # it may have been too far off for its clock to be believed
            fitted = self._session.in_time(still, self._seed + 100 * number + 63)
        self._say(f"step {number}: looking for what is missing")
        scores = self._probed(fitted, number)
        for more in range(_DETAILS):
            promised = float(max(scores.drop, default=0.0))
            detailed = with_a_detail(self.problem, fitted, self._seed + 100 * number + 79 + 3 * more, promised)
            if detailed is fitted:
                break
            self._say(f"step {number}: with a detail more, looking again")
            fitted = settled(self.problem, detailed, self._seed + 100 * number + 81 + 3 * more)
            fitted = self._session.in_time(fitted, self._seed + 100 * number + 96 + more)
            scores = self._probed(fitted, number)
        fitted, scores = self._looked_closer(fitted, scores, number)
        little = leaves_little(self.problem, fitted)
        trends = clear_trends(self.problem, fitted, self._seed + 100 * number + 91) if little else ()
        state = State(fitted, scores, added, self.problem, trends=trends)
        if before:
            last = before[-1]
            state.fall = share(last.problem, last.fit, deviance_beside(self.problem, fitted, last.fit))
        return state

    def _looked_closer(self, fitted: Fit, scores: Scores, number: int) -> tuple[Fit, Scores]:
        """Return a fit, and what effects promise; of more pixels where little is missing and something promises.

        Where a fit ends is known to no better than half a standard error from so many pixels: what promises by chance
        of the simulation does so once.
        """
        if is_far_off(self.problem, fitted) or not self._shortlist.promises(fitted, scores):
            return fitted, scores
        self._say(f"step {number}: looking closer")
        again = fitted_on(self.problem, fitted, self._seed + 100 * number + 36)
        worse = deviance_per_dof(self.problem, again) >= deviance_per_dof(self.problem, fitted)
        if worse and leaves_more_than_chance(self.problem, again):
            again = fitted
        return again, self._probed(again, number, _CLOSER_SEED)

    def _probed(self, fitted: Fit, number: int, more: int = 0) -> Scores:
        """Return what each effect that is not in the model promises."""
        possible = candidates(fitted.model, self.problem.points, without=self._without)
        seed = self._seed + 100 * number + 17 + more
        gross = deviance_per_dof(self.problem, fitted) > _GROSS
        return self._scores(fitted, probe(self.problem, fitted, possible, seed, gross, self._seen))

    def _scores(self, fitted: Fit, probes: Sequence[Probe]) -> Scores:
        """Return what probes say; near the minimum what may be how time is cut is no sign of anything else."""
        if is_far_off(self.problem, fitted):
            return score(self.problem, fitted, probes, self._seed, far_off=True)
        scores = score(self.problem, fitted, probes, self._seed)
        fine = [
            p for i, p in enumerate(probes) if scores.p_best[i] < ALPHA and not can_judge(self.problem, scores, i)
        ]
        if not fine:
            return scores
        beside = score(self.problem, fitted, probes, self._seed, fine)
        return replace(scores, p_value=beside.p_value, p_best=beside.p_best)

    def _refitted(
        self, state: State, effect_ids: Sequence[str], most: int | None = None, leave: float = math.inf
    ) -> list[Found]:  # fmt: skip
        """Return the models with one of these effects more, the most promising of them fitted."""
        ids = [one.effect.id for one in state.scores.probes]
        for name in effect_ids:
            if name not in ids:
                raise InputError(f"{name}: {self._why_not(name, state)}; expected one of {', '.join(ids)}")
        unknown = [name for name in effect_ids if name not in state.refitted]
        if unknown:
            self._say(f"refitting with {', '.join(unknown)}")
            far_off = is_far_off(self.problem, state.fit)
            seed = self._seed + 100 * len(self._states) + 21
            numbers = [ids.index(name) for name in unknown]
            made = refitted(self.problem, state.fit, state.scores, numbers, seed, far_off, most, leave)
            state.refitted |= {found.effect: found for found in made.found}
            state.hopeless |= made.hopeless
        return [state.refitted[name] for name in effect_ids if name in state.refitted]

    def _why_not(self, name: str, state: State) -> str:
        if name not in effects():
            return "no such effect"
        return why_not(effects()[name], state.fit.model, self.problem.points) or "it was left out"

    def _drop(self) -> None:
        """Take out effects that were added before and have turned out to be needless."""
        while len(self._states) > 2:
            last = self._states[-1]
            sigmas = strengths(self.problem, self._states)
            earlier = {name: sigmas[name] for name in sigmas if name != last.added}
            explained = is_explained(self.problem, last)
            found = to_take_out(self.problem, last.fit, earlier, explained, self._seed + 41, self._say)
            if found is None:
                return
            name, again = found
            self._say(f"taking out {name}")
            left = self._left_without(name)
            self._states = [*left, self._look_again(left, again, last)]

    def _left_without(self, name: str) -> list[State]:
        """Return the states before the last one without an effect; those that had it are fitted without it."""
        left: list[State] = []
        for state in self._states[:-1]:
            if state.added == name:
                continue
            if state.fit.model.effect(name) is not None:
                self._session.problem = state.problem
                again = without(state.problem, state.fit, name, self._seed + 100 * len(left) + 43)
                left.append(self._look_again(left, again, state))
            else:
                left.append(state)
        self._session.problem = self._states[-1].problem
        return left

    def _last_step(self) -> Step:
        return self._step(len(self._states) - 1)

    def _step(self, number: int) -> Step:
        state, last = self._states[number], self._states[-1].fit
        ties = {} if state.proposal is None else {state.proposal: state.tied}
        return step_with_candidates(state, number, told_apart(ties, self.problem, last))

    def _might_go_on(self, state: State) -> bool:
        """Return whether something was to be added, or may have been: nobody has looked."""
        if state.chosen:
            return state.proposal is not None
        return not is_explained(self.problem, state) or self._shortlist.promises(state.fit, state.scores)
