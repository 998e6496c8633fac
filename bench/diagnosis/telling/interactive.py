"""Adding effects by hand: the table is shown, a person picks, the error falls."""

from __future__ import annotations

from dataclasses import dataclass
from difflib import get_close_matches
from typing import TYPE_CHECKING, Literal, Protocol

from bench.diagnosis.telling.axis_wording import flattening_lines
from bench.diagnosis.telling.by_axis import first_places, in_both
from bench.diagnosis.telling.wording import end_lines, fall_line, gain_of, step_lines
from protocols.errors import InputError
from sim_backend.pixel.effects.registry import effects

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from bench.diagnosis.comparison import ResidualsByStep
    from bench.diagnosis.result import Outcome, Step

__all__ = ["Choice", "Stepwise", "choose", "watch"]


class Stepwise(Protocol):
    """A diagnosis that goes on step by step."""

    findings: tuple[str, ...]  #: why the data are not fit to be judged

    @property
    def steps(self) -> tuple[Step, ...]:
        """The steps so far, the first one without an addition."""

    @property
    def proposal(self) -> str | None:
        """Id of the effect that the data ask for most; None if nothing is significant."""

    def add(self, effect: str) -> Step:
        """Add an effect."""

    def undo(self) -> Step:
        """Go back by one step."""

    def outcome(self, *, measure_next: bool = True) -> Outcome:
        """Return what was found so far, with what to measure next, which takes a while."""


@dataclass(frozen=True, slots=True)
class Choice:
    """What a person wants to do."""

    what: Literal["add", "undo", "stop", "again"]
    effect: str = ""
    complaint: str = ""  #: why they are asked again


def watch(
    diagnosis: Stepwise,
    ask: Callable[[str], str | None],
    show: Callable[[str], None],
    residuals: Callable[[], ResidualsByStep] = lambda: {},
) -> Outcome:
    """Show each step, do what is asked for, and return the outcome in the end.

    Data that are not fit to be judged are told so, and looked at all the same.

    Parameters
    ----------
    ask
        Returns the answer to a question; None where nobody answers any more, which stops.
    show
        Shows a line.
    residuals
        Returns what each step leaves: it is told where the model fails most, and how it all flattens.
    """
    for finding in diagnosis.findings:
        show(f"not fit to judge: {finding}")
    _show_step(diagnosis, show, residuals())
    while True:
        choice = choose(ask(question(diagnosis)), diagnosis)
        if choice.what == "stop":
            break
        if choice.what == "again":
            show(choice.complaint)
            continue
        try:
            if choice.what == "undo":
                diagnosis.undo()
            else:
                diagnosis.add(choice.effect)
        except InputError as error:
            show(str(error))
            continue
        left = residuals()
        _show_step(diagnosis, show, left)
        if choice.what == "add":
            _show_fall(diagnosis, show, left)
    outcome = diagnosis.outcome()
    for line in end_lines(outcome):
        show(line)
    return outcome


def question(diagnosis: Stepwise) -> str:
    """Return what the person is asked."""
    proposal = diagnosis.proposal
    first = f"ENTER adds {proposal}" if proposal is not None else "ENTER stops"
    undo = "; u: undo" if len(diagnosis.steps) > 1 else ""
    return f"{first}; a number or a name adds that{undo}; q: stop > "


def choose(answer: str | None, diagnosis: Stepwise) -> Choice:
    """Return what an answer means."""
    if answer is None:
        return Choice("stop")
    said = answer.strip()
    if not said:
        return Choice("stop") if diagnosis.proposal is None else Choice("add", diagnosis.proposal)
    if said.lower() in ("q", "quit", "stop"):
        return Choice("stop")
    if said.lower() in ("u", "undo"):
        alone = len(diagnosis.steps) == 1
        return Choice("again", complaint="there is nothing to undo") if alone else Choice("undo")
    return _effect(said, diagnosis.steps[-1])


def _effect(said: str, step: Step) -> Choice:
    shown = [c.effect for c in step.candidates]
    if said.isdigit():
        number = int(said)
        if 1 <= number <= len(shown):
            return Choice("add", shown[number - 1])
        return Choice("again", complaint=f"{said}: is no row of the table; expected 1 to {len(shown)}")
    name = said.lower().replace(" ", "_").replace("-", "_")
    if name in step.effects:
        return Choice("again", complaint=f"{name}: the model has it already")
    known = list(dict.fromkeys([*shown, *(e for e in effects() if e not in step.effects)]))
    return Choice("add", name) if name in known else Choice("again", complaint=_unknown(name, known))


def _unknown(name: str, known: Sequence[str]) -> str:
    close = [*get_close_matches(name, known, n=3), *(k for k in known if name in k)]
    hint = f"did you mean {' or '.join(dict.fromkeys(close))}?" if close else f"there are {', '.join(sorted(known))}"
    return f"{name}: no such effect; {hint}"


def _show_step(diagnosis: Stepwise, show: Callable[[str], None], residuals: ResidualsByStep) -> None:
    proposal = diagnosis.proposal  # the best candidates are refitted for it, so that the table can show them
    step = diagnosis.steps[-1]
    place = first_places(residuals).get(step.number)
    for line in step_lines(step, place, gain_of(diagnosis.outcome(measure_next=False)), numbered=True):
        show(line)
    if proposal is None:
        show("nothing more is significant")


def _show_fall(diagnosis: Stepwise, show: Callable[[str], None], residuals: ResidualsByStep) -> None:
    """Show by how much the last step has lowered the error, and where."""
    before, after = diagnosis.steps[-2:]
    show(fall_line(before, after))
    if before.number in residuals and after.number in residuals:
        for line in flattening_lines(*in_both(*(residuals[one.number] for one in (before, after)))):
            show(f"{' ' * 8}{line}")
