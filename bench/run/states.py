"""The states of a run: one table of them, of what may follow what, and of their lines in the journal.

The journal's own states are fixed by the run format; a reader in another process learns the state from them.
"""

from __future__ import annotations

import logging
from enum import StrEnum
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from bench.store.journal import JournalEntry

__all__ = ["ENDS", "FOLLOWS", "Course", "State", "WrongTransition", "state_of"]

_log = logging.getLogger("evs_bench.run")


class State(StrEnum):
    """What a run is doing."""

    IDLE = "idle"  #: nothing yet, or between two points
    WAITING = "waiting"  #: for a person's step, or for a device to come to itself
    PREPARING = "preparing"  #: filter, biases, window and light go to where a point begins
    MEASURING = "measuring"
    PAUSED = "paused"  #: by the operator, or for one; the light is dark
    SUSPENDED = "suspended"  #: until what is against measuring is over; the light is dark
    FINISHING = "finishing"  #: all points are dealt with
    COMPLETED = "completed"
    ABORTED = "aborted"  #: somebody ended it
    FAILED = "failed"  #: an error ended it


#: States in which a run is over.
ENDS: Final = frozenset({State.COMPLETED, State.ABORTED, State.FAILED})
_STOPPED: Final = frozenset({State.ABORTED, State.FAILED})
#: What may follow each state. A run can be ended in each of them.
FOLLOWS: Final[Mapping[State, frozenset[State]]] = {
    State.IDLE: _STOPPED | {State.WAITING, State.PREPARING, State.PAUSED, State.SUSPENDED, State.FINISHING},
    State.WAITING: _STOPPED | {State.IDLE, State.PREPARING, State.PAUSED},
    State.PREPARING: _STOPPED | {State.IDLE, State.MEASURING, State.WAITING},
    State.MEASURING: _STOPPED | {State.IDLE, State.WAITING},
    State.PAUSED: _STOPPED | {State.IDLE, State.WAITING},
    State.SUSPENDED: _STOPPED | {State.IDLE},
    State.FINISHING: _STOPPED | {State.COMPLETED},
    **{end: frozenset() for end in ENDS},
}
#: What the journal calls what has a line of its own.
_LINES: Final[Mapping[State, str]] = {
    State.PAUSED: "paused",
    State.SUSPENDED: "suspended",
    State.COMPLETED: "run_finished",
    State.ABORTED: "run_aborted",
    State.FAILED: "run_aborted",
}
_HELD: Final = frozenset({State.PAUSED, State.SUSPENDED})


class WrongTransition(RuntimeError):
    """A state that cannot follow the one before: a bug of ours."""


class Course:
    """The state of one run, from its beginning to its end.

    Parameters
    ----------
    note
        Writes a line about the run as a whole into the journal: its state in the journal, its reason, further keys.
    """

    def __init__(self, note: Callable[..., Any]) -> None:
        self.state = State.IDLE
        self.reason: str | None = None
        self._note = note

    def go(self, state: State, reason: str | None = None) -> None:
        """Enter `state`, and leave a line in the journal where it has one; harmless if it is the present one.

        Raises
        ------
        WrongTransition
            If it cannot follow the present one.
        """
        if state == self.state:
            return
        if state not in FOLLOWS[self.state]:
            raise WrongTransition(f"a run that is {self.state} cannot become {state}")
        level = logging.INFO if state in _LINES else logging.DEBUG
        _log.log(level, "%s%s", state, f": {reason}" if reason else "")
        if self.state in _HELD and state not in ENDS:
            self._note("resumed", reason=f"was {self.state}")
        if state in _LINES:
            more = {"end": str(state)} if state in _STOPPED else {}
            self._note(_LINES[state], reason=reason, **more)
        self.state, self.reason = state, reason  # now: a line that could not be written may still end the run


def state_of(journal: Iterable[JournalEntry]) -> tuple[State, str | None]:
    """Return the state that the lines of a journal tell, and its reason.

    Whether a process is still at it, :func:`bench.store.writer.is_being_written` says: a run that was killed looks
    as it did in its last moment.
    """
    state, reason = State.IDLE, None
    for entry in journal:
        found = _READ.get(entry.state)
        if entry.state == "run_aborted" and entry.everything.get("end") == State.FAILED:
            found = State.FAILED
        if found is not None:
            state, reason = found, entry.reason
    return state, reason


_READ: Final[Mapping[str, State]] = {
    "run_started": State.IDLE,
    "resumed": State.IDLE,
    "started": State.MEASURING,
    "done": State.IDLE,
    "failed": State.IDLE,
    "rejected": State.IDLE,
    "skipped": State.IDLE,
    "paused": State.PAUSED,
    "suspended": State.SUSPENDED,
    "run_finished": State.COMPLETED,
    "run_aborted": State.ABORTED,
}
