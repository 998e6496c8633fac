"""What a journal says of a whole run: how many points stand how, how it ended, how long it took."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, Final

from bench.catalogue.entry import VERDICTS
from bench.store.journal import RUN_STATES

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from bench.store.journal import JournalEntry

__all__ = ["JournalCounts", "count_journal", "journal_time"]

_OUTCOMES: Final = ("done", "failed", "skipped", "rejected")
_BEGINNINGS: Final = ("run_started", "resumed")
#: What a run is after its last line; after any other it is running.
_AFTER: Final = {"run_finished": "finished", "run_aborted": "aborted", "paused": "paused", "suspended": "suspended"}
#: Outcomes that somebody has looked at.
_JUDGED: Final = ("done", "rejected")


@dataclass(frozen=True, slots=True)
class JournalCounts:
    """A journal in numbers."""

    planned: int
    outcomes: dict[str, int]  #: points by how they stand: done, failed, skipped, rejected
    verdicts: dict[str, int]
    state: str  #: as the last line leaves it: running, too, where its process has been killed
    duration_s: float | None  #: None where no line has a time


def count_journal(entries: Sequence[JournalEntry]) -> JournalCounts:
    """Return the journal in numbers; for a point that was taken several times its last outcome counts."""
    last = {e.point: e for e in entries if e.point is not None and e.state in _OUTCOMES}
    states = Counter(e.state for e in last.values())
    judged = {e.point: _verdict(e) for e in entries if e.point is not None and e.state in _JUDGED}
    verdicts = Counter(judged.values())
    return JournalCounts(
        planned=len(set(_points(entries))),
        outcomes={state: states[state] for state in _OUTCOMES},
        verdicts={verdict: verdicts[verdict] for verdict in VERDICTS},
        state=_state(entries),
        duration_s=_duration_s(entries),
    )


def _verdict(entry: JournalEntry) -> str | None:
    verdict = entry.everything.get("verdict")
    return verdict if isinstance(verdict, str) and verdict in VERDICTS else None


def _points(entries: Iterable[JournalEntry]) -> Iterator[int]:
    """Yield every point that a line speaks of, also those that a change of plan added."""
    for entry in entries:
        if entry.point is not None:
            yield entry.point
        elif isinstance(added := entry.everything.get("points"), list):
            yield from (index for point in added if (index := _index(point)) is not None)


def _index(point: Any) -> int | None:
    found = point.get("index") if isinstance(point, dict) else point
    return found if isinstance(found, int) and not isinstance(found, bool) else None


def _state(entries: Sequence[JournalEntry]) -> str:
    told = [e.state for e in entries if e.point is None and e.state in RUN_STATES]
    return _AFTER.get(told[-1], "running") if told else "running"


def _duration_s(entries: Sequence[JournalEntry]) -> float | None:
    """Return the sum of the sessions: a night between an interruption and `resume` is not the run's.

    It is added up from line to line: where the clock was set back, only what passed between two lines is not known.
    """
    total_s, last = None, None
    for entry in entries:
        now = journal_time(entry)
        if now is None:
            continue
        begins = entry.point is None and entry.state in _BEGINNINGS
        total_s = (total_s or 0.0) + (0.0 if begins else _between_s(last, now))
        last = now
    return total_s


def _between_s(begin: datetime | None, end: datetime | None) -> float:
    """Return the seconds between two times; none where the clock was set back between them."""
    return max(0.0, (end - begin).total_seconds()) if begin is not None and end is not None else 0.0


def journal_time(entry: JournalEntry) -> datetime | None:
    """Return the time of a line; None where it has none, or one that cannot be read."""
    try:
        moment = datetime.fromisoformat(entry.t)
    except ValueError:
        return None
    return moment if moment.tzinfo is not None else moment.replace(tzinfo=UTC)
