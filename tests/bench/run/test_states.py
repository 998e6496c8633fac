"""The table of states: what may follow what, and what the journal tells another process."""

from __future__ import annotations

from typing import Any

import pytest

from bench.run.states import ENDS, FOLLOWS, Course, State, WrongTransition, state_of
from bench.store.journal import JournalEntry


class _Journal(list[tuple[str, dict[str, Any]]]):
    def note(self, state: str, **more: Any) -> None:
        self.append((state, more))

    @property
    def entries(self) -> list[JournalEntry]:
        return [JournalEntry(state, reason=more.get("reason"), everything=more) for state, more in self]


def test_a_run_that_ended_stays_so_and_each_other_one_can_be_ended() -> None:
    for state in State:
        assert FOLLOWS[state] >= {State.ABORTED, State.FAILED} if state not in ENDS else not FOLLOWS[state]
    reached = {State.IDLE}.union(*FOLLOWS.values())
    assert reached == set(State)


def test_the_journal_tells_every_state_that_lasts() -> None:
    journal = _Journal()
    course = Course(journal.note)
    course.go(State.PREPARING)
    course.go(State.MEASURING)
    course.go(State.IDLE)
    assert journal == []
    course.go(State.PAUSED, "by the operator")
    assert state_of(journal.entries) == (State.PAUSED, "by the operator")
    course.go(State.PAUSED, "once more")
    course.go(State.IDLE)
    course.go(State.SUSPENDED, "it is too warm")
    assert state_of(journal.entries) == (State.SUSPENDED, "it is too warm")
    course.go(State.IDLE)
    course.go(State.FINISHING)
    course.go(State.COMPLETED)
    states = [state for state, _ in journal]
    assert states == ["paused", "resumed", "suspended", "resumed", "run_finished"]
    assert state_of(journal.entries)[0] == State.COMPLETED


@pytest.mark.parametrize("end", [State.ABORTED, State.FAILED])
def test_an_end_that_came_early_says_which(end: State) -> None:
    journal = _Journal()
    Course(journal.note).go(end, "why")
    assert [state for state, _ in journal] == ["run_aborted"]
    assert state_of(journal.entries) == (end, "why")


def test_a_wrong_transition_is_a_bug() -> None:
    course = Course(_Journal().note)
    with pytest.raises(WrongTransition, match="a run that is idle cannot become measuring"):
        course.go(State.MEASURING)
    course.go(State.ABORTED)
    with pytest.raises(WrongTransition):
        course.go(State.IDLE)
