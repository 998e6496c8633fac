"""What a person picks, and what becomes of it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from bench.diagnosis.comparison import Residual
from bench.diagnosis.telling.interactive import Choice, choose, watch
from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from bench.diagnosis.result import Outcome, Step


class Stub:
    """A diagnosis that does as it is told, and fits nothing."""

    def __init__(self, outcome: Outcome) -> None:
        self._outcome = outcome
        self.steps: tuple[Step, ...] = outcome.steps[:1]
        self.done: list[str] = []
        self.findings = outcome.findings

    @property
    def proposal(self) -> str | None:
        return "dark_current" if len(self.steps) == 1 else None

    def add(self, effect: str) -> Step:
        if effect == "nd_error":
            raise InputError("nd_error: no point was taken with an ND filter")
        self.done.append(effect)
        number = len(self.steps)
        self.steps = (*self.steps, replace(self._outcome.steps[1], number=number, added=effect))
        return self.steps[-1]

    def undo(self) -> Step:
        self.done.append("undo")
        self.steps = self.steps[:-1]
        return self.steps[-1]

    def outcome(self, *, measure_next: bool = True) -> Outcome:
        missing = tuple(s.added for s in self.steps if s.added is not None)
        verdict = "explained" if missing else "unexplained"
        return replace(self._outcome, steps=self.steps, missing=missing, verdict=verdict)  # type: ignore[arg-type]


def played(outcome: Outcome, answers: Sequence[str]) -> tuple[Stub, Outcome, str]:
    """Return what came of some answers, after which nobody answers any more."""
    stub, told = Stub(outcome), list[str]()
    left: Iterator[str] = iter(answers)

    def ask(question: str) -> str | None:
        told.append(question)
        return next(left, None)

    return stub, watch(stub, ask, told.append), "\n".join(told)


def test_enter_accepts_the_proposal_and_then_stops(explained: Outcome) -> None:
    stub, found, told = played(explained, ["\n", "\n", "leak"])
    assert stub.done == ["dark_current"]
    assert found.missing == ("dark_current",)
    assert "ENTER adds dark_current; a number or a name adds that; q: stop > " in told
    assert "nothing more is significant" in told
    assert "\nENTER stops; a number or a name adds that; u: undo; q: stop > " in told
    assert "the error went from 41.7 to 1.06" in told
    assert told.endswith("separation 19 sigma")


def test_residuals_are_seen_to_flatten_where_they_stood_out(explained: Outcome) -> None:
    """The error falls in dim light, and the response is what it falls in."""

    def left(view: str, lux: float, z: float) -> Residual:
        return Residual(view, "on", round(lux), lux, 0.4, 0.1, 0.0, 0.5, 0.5, 0.1, z)

    new = replace(left("latency", 10.0, 7.0), width_s=math.nan)

    steps = {
        0: ([left("response", 0.1, 9.0), left("response", 10.0, 1.0), left("latency", 0.1, 0.6)], None),
        # of what only one of two models knows it cannot be said that it flattens
        1: ([left("response", 0.1, 1.2), left("response", 10.0, 1.0), left("latency", 0.1, 0.6), new], None),
    }
    told: list[str] = []
    answers = iter(["", None])
    watch(Stub(explained), lambda _: next(answers), told.append, lambda: steps)
    begin = next(i for i, line in enumerate(told) if "mean square residual" in line)
    assert "the error went from" in told[begin - 1]
    table = [line.split() for line in told[begin + 1 : begin + 5]]
    assert [row[:-3] for row in table] == [
        ["response", "41.0", "1.22"],  # (81 + 1) / 2, and (1.44 + 1) / 2
        ["latency", "0.36", "0.36"],
        ["illuminance", "100", "mlux", "40.7", "0.90"],
        ["illuminance", "10", "lux", "1.00", "1.00"],
    ]
    assert [line.split()[:2] for line in told[begin + 5 : begin + 7]] == [["point", "0"], ["point", "10"]]
    assert told[begin + 7].startswith("the model now")  # one contrast, one width: nothing to compare


@pytest.mark.parametrize(
    "answer", ["3", "photoreceptor_bandwidth\n", "Photoreceptor Bandwidth", " photoreceptor-bandwidth "]
)
def test_another_effect_is_picked_by_number_or_name(explained: Outcome, answer: str) -> None:
    stub, _, told = played(explained, [answer, "q"])
    assert stub.done == ["photoreceptor_bandwidth"]
    assert " 3  photoreceptor_bandwidth" in told


def test_an_effect_of_the_catalogue_that_is_no_candidate_can_be_added(explained: Outcome) -> None:
    assert played(explained, ["crosstalk"])[0].done == ["crosstalk"]


def test_undo_goes_back_and_nothing_is_left_to_undo(explained: Outcome) -> None:
    stub, found, told = played(explained, ["u", "leak", "u", "u", "q"])
    assert stub.done == ["leak", "undo"]
    assert found.missing == ()
    assert told.count("there is nothing to undo") == 2


@pytest.mark.parametrize(
    ("answer", "complaint"),
    [
        ("dark_curent", "dark_curent: no such effect; did you mean dark_current?"),
        ("light", "light: no such effect; did you mean"),
        ("zzzz", "zzzz: no such effect; there are comparator_delay, "),
        ("9", "9: is no row of the table; expected 1 to 4"),
        ("0", "0: is no row of the table; expected 1 to 4"),
        ("thresholds", "thresholds: the model has it already"),
        ("nd_error", "nd_error: no point was taken with an ND filter"),
    ],
)
def test_what_cannot_be_added_is_told_and_asked_again(explained: Outcome, answer: str, complaint: str) -> None:
    stub, _, told = played(explained, [answer, "q"])
    assert stub.done == []
    assert complaint in told
    assert told.count("q: stop > ") == 2


def test_nobody_answering_is_a_stop(explained: Outcome) -> None:
    stub, found, _ = played(explained, [])
    assert (stub.done, found.steps) == ([], explained.steps[:1])
    assert choose(None, stub) == Choice("stop")


def test_data_that_are_not_fit_are_told_and_looked_at(explained: Outcome) -> None:
    told = played(replace(explained, findings=("12 events in all points",)), ["q"])[2]
    assert told.startswith("not fit to judge: 12 events in all points\nstep 0")
