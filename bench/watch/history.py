"""What the journal says of a run so far: the state of each point, of the run, and the time it took."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, Final, Literal

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from bench.store.journal import JournalEntry

__all__ = ["DoneFile", "History", "Interval", "PointHistory", "PointState", "Remark", "RunState", "history_of"]

PointState = Literal["planned", "measuring", "done", "doubtful", "bad", "failed", "skipped"]
RunState = Literal["measuring", "paused", "suspended", "finished", "aborted", "failed"]

_BEGINS: Final = ("run_started", "resumed")
_ENDS: Final[dict[str, RunState]] = {"paused": "paused", "suspended": "suspended", "run_finished": "finished"}
_OF_LINE: Final[dict[str, PointState]] = {
    "started": "measuring",
    "failed": "failed",
    "skipped": "skipped",
    "rejected": "bad",
}
_TOLD: Final = ("done", "failed", "skipped", "rejected")
_OF_VERDICT: Final[dict[object, PointState]] = {"amber": "doubtful", "red": "bad"}
#: How the reason of a run begins that ended because a person wished it, not because something failed.
_BY_OPERATOR: Final = "stopped"


@dataclass(frozen=True, slots=True)
class Remark:
    """One line of the journal about a point that is worth a word."""

    t: str  #: UTC, ISO 8601
    state: PointState  #: of the point, after it
    attempt: int
    text: str  #: why; empty where the journal does not say


@dataclass(frozen=True, slots=True)
class DoneFile:
    """The file of the last ``done`` line of a point."""

    point: int
    file: str | None  #: relative to the run folder
    sha256: str | None


@dataclass(frozen=True, slots=True)
class PointHistory:
    """What happened to a point so far."""

    index: int
    state: PointState = "planned"
    attempt: int = 1
    ended: datetime | None = None  #: when it came to its present state, if that is an end
    done: DoneFile | None = None
    remarks: tuple[Remark, ...] = ()


@dataclass(frozen=True, slots=True)
class Interval:
    """A stretch of time in which points were taken; `stop` is None while it lasts."""

    start: datetime
    stop: datetime | None


@dataclass(frozen=True, slots=True)
class History:
    """What the journal says of a run so far."""

    state: RunState
    reason: str | None  #: why the run ended, or stands still
    points: dict[int, PointHistory]  #: in the order of the plan
    intervals: tuple[Interval, ...]
    last: datetime | None  #: time of the last line

    @property
    def files(self) -> list[DoneFile]:
        """The files of all points that have one, the one that was finished last at the end."""
        ended = [point for point in self.points.values() if point.done is not None]
        ended.sort(key=lambda point: point.ended or datetime.min.replace(tzinfo=UTC))
        return [point.done for point in ended if point.done is not None]


@dataclass(slots=True)
class _Replay:
    """The journal, line by line."""

    points: dict[int, PointHistory] = field(default_factory=dict)
    intervals: list[Interval] = field(default_factory=list)
    state: RunState = "measuring"
    reason: str | None = None
    failed: bool = False  #: whether a point failed since the run was begun, or gone on with
    last: datetime | None = None

    def take(self, entry: JournalEntry) -> None:
        """Take one line in."""
        at = moment(entry.t)
        for index in _planned(entry):
            self.points.setdefault(index, PointHistory(index))
        if entry.point is not None:
            self.points[entry.point] = _after(self.points.get(entry.point, PointHistory(entry.point)), entry, at)
            self.failed = self.failed or entry.state == "failed"
        elif entry.state in _BEGINS:
            self._begin(at)
        elif entry.state in _ENDS or entry.state == "run_aborted":
            self._end(entry, at)
        self.last = at or self.last

    def _begin(self, at: datetime | None) -> None:
        if self.intervals and self.intervals[-1].stop is None:  # its writer was killed: its last line is its end
            self.intervals[-1] = Interval(self.intervals[-1].start, self.last)
        if at is not None:
            self.intervals.append(Interval(at, None))
        self.state, self.reason, self.failed = "measuring", None, False

    def _end(self, entry: JournalEntry, at: datetime | None) -> None:
        if self.intervals and self.intervals[-1].stop is None:
            self.intervals[-1] = Interval(self.intervals[-1].start, at or self.last)
        self.state = _ENDS.get(entry.state, "failed" if self._is_failure(entry) else "aborted")
        self.reason = entry.reason

    def _is_failure(self, entry: JournalEntry) -> bool:
        """Return whether an error ended the run, not a person; the lines of old runs do not tell it by themselves."""
        told = entry.everything.get("end")
        if isinstance(told, str):
            return told == "failed"
        return self.failed and not (entry.reason or "").startswith(_BY_OPERATOR)


def history_of(entries: Iterable[JournalEntry]) -> History:
    """Return what the lines of a journal, oldest first, say of the run."""
    replay = _Replay()
    for entry in entries:
        replay.take(entry)
    points = dict(sorted(replay.points.items()))
    return History(replay.state, replay.reason, points, tuple(replay.intervals), replay.last)


def moment(text: str) -> datetime | None:
    """Return the time that a line of the journal tells, None if it tells none."""
    try:
        found = datetime.fromisoformat(text)
    except ValueError:
        return None
    return found if found.tzinfo is not None else found.replace(tzinfo=UTC)


def _planned(entry: JournalEntry) -> Sequence[int]:
    """Return the points that a line for the whole run adds to the plan, where it lists some."""
    points = entry.everything.get("points") if entry.point is None else None
    if not isinstance(points, list):
        return ()
    found = [item.get("index", item.get("point")) if isinstance(item, dict) else item for item in points]
    return [index for index in found if isinstance(index, int) and not isinstance(index, bool) and index >= 0]


def _after(point: PointHistory, entry: JournalEntry, at: datetime | None) -> PointHistory:
    """Return `point` after one more line about it."""
    state = _state(point, entry)
    done = DoneFile(point.index, entry.file, entry.sha256) if entry.state == "done" else point.done
    remark = _remark(entry, state)
    return PointHistory(
        index=point.index,
        state=state,
        attempt=max(entry.attempt, point.attempt),
        ended=point.ended if entry.state in ("planned", "started") else at,
        done=done,
        remarks=(*point.remarks, remark) if remark else point.remarks,
    )


def _state(point: PointHistory, entry: JournalEntry) -> PointState:
    if entry.state == "done":
        return _OF_VERDICT.get(_hashable(entry.everything.get("verdict")), "done")
    if entry.state == "planned":  # of one that was found bad, that it is to be taken again is no news
        return "planned" if point.state in ("measuring", "failed", "skipped") else point.state
    return _OF_LINE.get(entry.state, point.state)


def _hashable(verdict: object) -> object:
    return verdict if isinstance(verdict, str) else None


def _remark(entry: JournalEntry, state: PointState) -> Remark | None:
    """Return what is to be told of a line: of all that did not go well, and of points that were taken again."""
    if entry.state not in _TOLD or (state == "done" and entry.attempt == 1 and not entry.reason):
        return None
    return Remark(entry.t, state, entry.attempt, _why(entry))


def _why(entry: JournalEntry) -> str:
    reasons = entry.everything.get("reasons")
    texts = [_plain(item) for item in reasons] if isinstance(reasons, list) else []
    if entry.reason and entry.reason not in texts:
        texts.insert(0, entry.reason)
    return "; ".join(text for text in texts if text)


def _plain(reason: Any) -> str:
    if isinstance(reason, dict):
        text = reason.get("text", reason.get("reason"))
        return str(text) if text is not None else ", ".join(f"{key} {value}" for key, value in reason.items())
    return str(reason)
