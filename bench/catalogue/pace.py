"""What points took beside their recordings in earlier runs of a station: what the next run will take, too.

A protocol says how long it records and how long it waits for light, filters and biases. What devices, disk and
operator take beside that only runs tell: in the journal, a point's ``done`` less its ``started``.
"""

from __future__ import annotations

import statistics
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

from protocols.estimation import recording_s

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

    from bench.catalogue.entry import RunEntry
    from bench.station import Station
    from bench.store.journal import JournalEntry
    from protocols.points import Point

__all__ = ["Changed", "Pace", "changes_of", "learned_pace", "pace_of_journal", "waits_s"]

#: From how many of the latest runs it is learned.
_RUNS: Final = 5
#: So many folders that are not in the index yet are read at most: a look at a protocol must not take long.
_READ_AT_MOST: Final = 20
#: How much larger a recording may be than those from which it is learned what one takes.
_MUCH_LARGER: Final = 4.0
#: States of a run whose journal grows no more.
_OVER: Final = ("finished", "aborted", "interrupted")
_KINDS: Final = ("plain", "filter", "bias")


@dataclass(frozen=True, slots=True)
class Pace:
    """What points of a station take beside recording and waiting, s: each the median of the runs' medians."""

    runs: int  #: from how many runs it was learned
    plain_s: float  #: a point for which only the light changed
    filter_s: float | None  #: one for which the filter changed; None if there was none
    bias_s: float | None  #: one for which biases or window changed
    took_s_per_pixel_s: float  #: all that points took, for each second and pixel of their recordings
    fastest_s: float  #: all that the quickest point took
    largest_pixel_s: float  #: seconds times pixels of the largest recording

    def beside_s(self, changed: Changed) -> float:
        """Return what a point is expected to take beside recording and waiting, s."""
        extra = [(changed.filter, self.filter_s), (changed.bias, self.bias_s)]
        return max(0.0, self.plain_s) + sum(
            max(0.0, one - self.plain_s) for happens, one in extra if happens and one is not None
        )

    def computing_s(self, points: Iterable[Point]) -> float | None:
        """Return what `points` are expected to take where recording and waiting take no time of their own, s.

        None where a recording is much larger than all that were seen: what small ones take is no measure of it.
        """
        pixels_s = [recording_s(point) * point.roi.pixels for point in points]
        if max(pixels_s, default=0.0) > _MUCH_LARGER * self.largest_pixel_s:
            return None
        return sum(max(self.fastest_s, self.took_s_per_pixel_s * pixel_s) for pixel_s in pixels_s)


@dataclass(frozen=True, slots=True)
class Changed:
    """What has to be changed before a point, beside the light."""

    filter: bool
    bias: bool  #: biases or window

    @property
    def kind(self) -> str:
        """Which kind of point it is; empty for one that tells nothing of one kind."""
        if self.filter and self.bias:
            return ""
        return "filter" if self.filter else "bias" if self.bias else "plain"


def changes_of(point: Point, before: Point | None) -> Changed:
    """Return what has to be changed for `point` after the point `before`; everything for the first one."""
    if before is None:
        return Changed(filter=True, bias=True)
    return Changed(before.nd_od != point.nd_od, (before.settings, before.roi) != (point.settings, point.roi))


def waits_s(point: Point, changed: Changed) -> float:
    """Return how long the protocol waits before the recording of `point`, s."""
    settle = point.settle
    return settle.light_s + settle.filter_s * changed.filter + settle.bias_s * changed.bias


def learned_pace(runs_folder: Path, station: Station) -> Pace | None:
    """Return what points take beside their recordings, from the last few runs in `runs_folder` on `station`.

    Runs on the same station are those on one of its name and with its drivers. Runs that several workers took at
    once tell nothing. Returns None where there is no such run, or no such folder.
    """
    if not runs_folder.is_dir():
        return None
    from bench.catalogue.catalogue import read_catalogue
    from bench.catalogue.summary import roles_text
    from bench.store.errors import RunError

    try:
        entries = read_catalogue(runs_folder, at_most=_READ_AT_MOST).entries
    except RunError:
        return None
    drivers = roles_text(station.recorded)
    same = [e for e in entries if (e.station, e.drivers) == (station.name, drivers) and e.done > 1]
    found = _paces(runs_folder, [e for e in same if e.state in _OVER][: 2 * _RUNS])
    return _together(found[:_RUNS])


def _paces(folder: Path, entries: Sequence[RunEntry]) -> list[dict[str, Any]]:
    """Return the pace of each run that tells one; what was worked out before stands in the index."""
    from bench.catalogue.catalogue import stamp_of
    from bench.catalogue.index import Index

    index = Index(folder)
    known = index.read()
    found, fresh = [], {}
    for entry in entries:
        one = known.get(entry.folder)
        pace = one.pace if one is not None else None
        if pace is None:
            stamp, pace = stamp_of(folder / entry.folder), _pace_of(folder / entry.folder)
            fresh[entry.folder] = (stamp, pace)
        if pace.get("plain") is not None:
            found.append(pace)
    index.write_paces(fresh)
    return found


def _pace_of(folder: Path) -> dict[str, Any]:
    """Return the pace of the run in `folder`; an empty one where it does not tell."""
    from pydantic import ValidationError

    from bench.catalogue.summary import read_run_file
    from bench.store.journal import read_journal
    from bench.store.layout import JOURNAL_FILE
    from protocols.errors import InputError
    from protocols.schema import Protocol

    try:
        points = Protocol.model_validate(read_run_file(folder).get("protocol")).expand()
        journal = read_journal(folder / JOURNAL_FILE)
    except (InputError, ValidationError):
        return {}
    return pace_of_journal(journal, {point.index: point for point in points})


def pace_of_journal(journal: Sequence[JournalEntry], points: Mapping[int, Point]) -> dict[str, Any]:
    """Return what the points of one run took, as plain data: medians in s by kind, and how many.

    Parameters
    ----------
    journal
        Of the run.
    points
        Its points by their number.

    Returns
    -------
    dict
        Empty where nothing can be told: no point after the first, or several at once.
    """
    taken = list(_taken(journal, points))
    if not taken or _at_once(journal):
        return {}
    beside: dict[str, list[float]] = {kind: [] for kind in _KINDS}
    for point, changed, took_s in taken:
        if changed.kind:
            beside[changed.kind].append(took_s - recording_s(point) - waits_s(point, changed))
    pixels_s = [recording_s(point) * point.roi.pixels for point, _, _ in taken]
    if not beside["plain"] or sum(pixels_s) <= 0.0:
        return {}
    took = [took_s for *_, took_s in taken]
    return {
        **{kind: statistics.median(values) if values else None for kind, values in beside.items()},
        "took_s_per_pixel_s": sum(took) / sum(pixels_s),
        "fastest_s": min(took),
        "largest_pixel_s": max(pixels_s),
    }


def _taken(journal: Iterable[JournalEntry], points: Mapping[int, Point]) -> Iterator[tuple[Point, Changed, float]]:
    """Yield the points that were taken, what was changed for each, and how long it took, s.

    The first point of a session is left out: devices and computer have to get going. So is one during which the
    clock was set back.
    """
    before: Point | None = None
    began: JournalEntry | None = None
    for entry in journal:
        if entry.point is None or entry.state == "failed":  # devices may be in another state after it
            before, began = None, None
        elif entry.state == "started":
            began = entry
        elif entry.state in ("done", "rejected") and began is not None and began.point == entry.point:
            point, took_s = points.get(entry.point), _between_s(began, entry)
            if point is not None and before is not None and took_s is not None:
                yield point, changes_of(point, before), took_s
            before, began = point, None


def _between_s(begin: JournalEntry, end: JournalEntry) -> float | None:
    from bench.catalogue.counts import journal_time

    first, last = journal_time(begin), journal_time(end)
    if first is None or last is None or last < first:
        return None
    return (last - first).total_seconds()


def _at_once(journal: Iterable[JournalEntry]) -> bool:
    """Return whether a point was begun before the one before it came to its end: workers took them."""
    steps = [entry.state for entry in journal if entry.point is not None and entry.state != "planned"]
    return any(first == second == "started" for first, second in pairwise(steps))


def _together(paces: Sequence[Mapping[str, Any]]) -> Pace | None:
    if not paces:
        return None

    def known(key: str) -> list[float]:
        return [pace[key] for pace in paces if isinstance(pace.get(key), float | int)]

    def median(key: str) -> float | None:
        return statistics.median(known(key)) if known(key) else None

    return Pace(
        runs=len(paces),
        plain_s=median("plain") or 0.0,
        filter_s=median("filter"),
        bias_s=median("bias"),
        took_s_per_pixel_s=median("took_s_per_pixel_s") or 0.0,
        fastest_s=median("fastest_s") or 0.0,
        largest_pixel_s=max(known("largest_pixel_s"), default=0.0),
    )
