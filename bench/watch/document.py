"""The state of a run as one JSON document: everything that the page shows, and nothing that changes by itself.

Lengths of time are told by their ends, so that the document of a run that stands still stays the same.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Any, Final

from bench.watch.panels import background_panel, number, response_families
from bench.watch.tiles import is_live, is_over, tile_groups, tile_state
from bench.watch.wording import BADGES, WORDS, remark_text

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from bench.store.data import RunHeader
    from bench.watch.counting import PointCounts
    from bench.watch.history import History, Interval, PointHistory
    from bench.watch.planned import PlannedLook

__all__ = ["FORMAT", "Seen", "document"]

FORMAT: Final = "evs-bench-watch/1"
_MOST_LINES: Final = 20
_CAREFUL: Final = ("doubtful", "bad", "failed")


@dataclass(frozen=True, slots=True)
class Seen:
    """What was seen of a run folder at one look."""

    header: RunHeader
    history: History
    written: bool | None  #: whether a process writes it; None if that cannot be told
    planned: Mapping[int, PlannedLook]
    counts: Mapping[int, PointCounts]
    unreadable: Mapping[int, str]  #: why a finished point cannot be shown
    log: Sequence[str]  #: its last lines
    problems: Sequence[str]  #: what is wrong with the folder itself, for people
    may_add: int = 0  #: how many points may still be added to curves


def document(seen: Seen) -> dict[str, Any]:
    """Return the state of a run, all plain values; numbers that are not finite are None."""
    return {
        "format": FORMAT,
        "run": _run(seen.header),
        "problems": list(seen.problems),
        "state": _state(seen),
        "progress": _progress(seen),
        "words": WORDS,
        "points": tile_groups(seen.history, seen.planned, seen.counts, is_live(seen.history, seen.written)),
        "notes": _notes(seen),
        "careful": _careful(seen),
        "responses": response_families(seen.counts.values(), seen.planned.values()),
        "background": background_panel(seen.counts.values()),
        "log": list(seen.log)[-_MOST_LINES:],
    }


def _run(header: RunHeader) -> dict[str, Any]:
    station = header.everything.get("station")
    name = station.get("name") if isinstance(station, dict) else None
    sensor, roi = header.sensor, header.roi
    return {
        "id": header.id,
        "title": header.title or header.id,
        "created": header.created or None,
        "sensor": f"{sensor.name}, {sensor.width} \u00d7 {sensor.height} pixels",
        "window": f"{roi.width} \u00d7 {roi.height} pixels from x = {roi.x}, y = {roi.y}",
        "station": None if name is None else str(name),
    }


def _state(seen: Seen) -> dict[str, Any]:
    history = seen.history
    name = history.state if is_over(history) or is_live(history, seen.written) else "dead"
    return {
        "name": name,
        "badge": BADGES[name],
        "reason": history.reason,
        "writer": {True: "there", False: "gone", None: "unknown"}[seen.written],
        "over": is_over(history),
        "last": _text(history.last),
    }


def _progress(seen: Seen) -> dict[str, Any]:
    history = seen.history
    live = is_live(history, seen.written)
    states = [tile_state(point, live) for point in history.points.values()]
    closed = [_stopped(interval, history, live) for interval in history.intervals]
    lasting = history.intervals[-1].start if closed and closed[-1].stop is None else None
    return {
        "total": len(states),
        "at_most": len(states) + (0 if is_over(history) else seen.may_add),
        **{name: states.count(name) for name in sorted(set(states))},
        "finished": sum(point.done is not None for point in history.points.values()),
        "shown": len(seen.counts) + len(seen.unreadable),
        "begun": _text(history.intervals[0].start if history.intervals else None),
        # None of an interval in which the clock was set back by more than it is long: what it took is not known.
        "measured_s": number(sum(max(0.0, (i.stop - i.start).total_seconds()) for i in closed if i.stop is not None)),
        "running_since": _text(lasting),
        "ended": None if live or history.last is None else _text(history.last),
        "ends": _text(_end(history, seen.planned)) if lasting is not None else None,
    }


def _stopped(interval: Interval, history: History, live: bool) -> Interval:
    """Return the interval with its end; that of a writer that was killed is the last line of the journal."""
    if interval.stop is not None or (live and history.state == "measuring"):
        return interval
    return replace(interval, stop=history.last or interval.start)


def _end(history: History, planned: Mapping[int, PlannedLook]) -> datetime | None:
    """Return when the run will be over, if what is left goes as what was done; None before the first point."""
    start = history.intervals[-1].start
    expected = _expected(history, planned)
    over = [p for p in history.points.values() if p.state in ("done", "doubtful", "skipped") and p.ended is not None]
    lately = [(p.index, p.ended) for p in over if p.ended is not None and p.ended >= start]
    if not lately:
        return None
    last = max(ended for _, ended in lately)
    spent = sum(expected[index] for index, _ in lately)
    finished = {point.index for point in over}
    left = sum(seconds for index, seconds in expected.items() if index not in finished)
    if spent <= 0.0:
        return None
    try:
        return last + timedelta(seconds=(last - start).total_seconds() * left / spent)
    except OverflowError:
        return None


def _expected(history: History, planned: Mapping[int, PlannedLook]) -> dict[int, float]:
    """Return what each point is expected to cost, in proportion; all the same where the plan does not say."""
    if all(index in planned for index in history.points):
        return {index: planned[index].expected_s for index in history.points}
    return dict.fromkeys(history.points, 1.0)


def _text(at: datetime | None) -> str | None:
    if at is None:
        return None
    return at.astimezone(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def _careful(seen: Seen) -> list[int]:
    """Return the points that somebody should look at, the latest first."""
    points = seen.history.points
    found = [index for index in points if points[index].state in _CAREFUL or index in seen.unreadable]
    never = datetime.min.replace(tzinfo=UTC)
    return sorted(found, key=lambda index: points[index].ended or never, reverse=True)


def _notes(seen: Seen) -> dict[str, list[dict[str, Any]]]:
    """Return, for each point of which there is something to say, what it is."""
    live = is_live(seen.history, seen.written)
    notes = {str(index): _notes_of(point, seen, live) for index, point in seen.history.points.items()}
    return {index: found for index, found in notes.items() if found}


def _notes_of(point: PointHistory, seen: Seen, live: bool) -> list[dict[str, Any]]:
    notes = [{"t": remark.t, "text": remark_text(remark)} for remark in point.remarks]
    texts = []
    if point.state == "measuring" and not live:
        texts.append("was being taken when the run stopped; it is taken again")
    if point.index in seen.unreadable:
        texts.append(f"not shown: {seen.unreadable[point.index]}")
    counts = seen.counts.get(point.index)
    texts += counts.remarks if counts else ()
    return [*notes, *({"t": None, "text": text} for text in texts)]
