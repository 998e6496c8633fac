"""What became of the runs of a queue."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from pathlib import Path

    from bench.queueing.plan import QueuedRun

__all__ = ["QueueResult", "RunOutcome", "State"]

State = Literal["done", "failed", "suspended", "stopped", "not begun"]


@dataclass(frozen=True, slots=True)
class RunOutcome:
    """What became of one run."""

    run: QueuedRun
    folder: Path
    state: State
    points_done: int | None = None
    points: int | None = None
    reason: str | None = None  #: why it is not done
    cause: Literal["device", "input", "bug"] | None = None  #: what kind of failure it was
    took_s: float | None = None
    unsafe: bool = False  #: whether a device could not be brought to its safe state

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {
            "run": self.run.number,
            "name": self.run.name,
            "reference": self.run.is_reference,
            "protocol": self.run.protocol,
            "station": self.run.station,
            "folder": str(self.folder),
            **self.journal_facts(),
            "state": self.state,
        }

    def journal_facts(self) -> dict[str, Any]:
        """Return what the journal keeps of it."""
        return {
            "points_done": self.points_done,
            "points": self.points,
            "reason": self.reason,
            "cause": self.cause,
            "took_s": self.took_s,
        }


@dataclass(frozen=True, slots=True)
class QueueResult:
    """What a queue left behind."""

    folder: Path
    title: str
    outcomes: tuple[RunOutcome, ...]  #: one for each run, also those that were not begun
    stopped_by_operator: bool

    def count(self, state: State) -> int:
        """Return how many runs came to `state`."""
        return sum(outcome.state == state for outcome in self.outcomes)

    @property
    def left(self) -> int:
        """How many runs are not done."""
        return len(self.outcomes) - self.count("done")

    @property
    def text(self) -> str:
        """Return it on one line."""
        parts = [f"{self.count('done')} of {len(self.outcomes)} runs done"]
        named: tuple[State, ...] = ("failed", "suspended", "stopped", "not begun")
        parts += [f"{self.count(state)} {state}" for state in named if self.count(state)]
        return ", ".join(parts)

    @property
    def references(self) -> tuple[RunOutcome, ...]:
        """The reference runs that are done."""
        return tuple(o for o in self.outcomes if o.run.is_reference and o.state == "done")
