"""Going on with a run that was stopped or killed: what is done is kept, what was being taken is taken again."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from bench.run.by_workers import require_simulated
from bench.run.differences import differences
from bench.run.plan import plan_or_raise
from bench.run.protocol_run import conduct_of, read_task
from bench.run.refining import Refining
from bench.run.runner import Crew, Rest, RunResult, carry_out, require_conditions, require_operator
from bench.run.software import software_versions
from bench.store.errors import RunError
from bench.store.event_reader import read_events
from bench.store.journal import last_done, read_journal
from bench.store.layout import JOURNAL_FILE, RUN_FILE
from bench.store.probe import probe
from bench.store.reader import read_point
from bench.store.run import unsound_points
from bench.store.writer import RunWriter
from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from bench.compute import Workforce
    from bench.run.plan import PlannedPoint
    from bench.run.progress import Progress
    from bench.run.stop import StopFlag
    from bench.station import Station
    from bench.store.data import RunHeader
    from bench.store.journal import JournalEntry
    from protocols.points import Point

__all__ = ["resume"]

_log = logging.getLogger("evs_bench.run")
#: What of the software has no say in the events.
_NO_MATTER: Final = ("platform", "h5py", "pydantic")
_ACCEPT: Final = "make it as it was, take the run anew, or say --accept-differences"
_IDENTITIES: Final = "identities"


def resume(
    folder: Path,
    *,
    station: Station | None = None,
    progress: Progress | None = None,
    stop: StopFlag | None = None,
    operator: Callable[[str], None] | None = None,
    workforce: Workforce | None = None,
    retry_skipped: bool = False,
    accept_differences: bool = False,
) -> RunResult:
    """Take the points of the run in `folder` that are not done.

    The protocol, the seeds and the station are those in its ``run.yaml``, so that on a simulated station all events
    are those of a run that was never stopped, with the same software; another is told. A point that is called done
    is taken again where its file is not there as it was written. A whole file that has no ``done`` line is looked
    through and kept.

    Parameters
    ----------
    folder
        The run folder.
    station
        The station as it is now; default is the one that is written in the run. A run of a blind station keeps only
        its name, and needs it.
    progress, stop, operator, workforce
        See :func:`~bench.run.runner.take_run`, also for what is raised.
    retry_skipped
        Whether points that were left out are tried again.
    accept_differences
        Whether the run goes on although station, devices or points differ; the journal says so.

    Raises
    ------
    RunError
        If `folder` holds no run, or one that does not say how it was taken, or another process is writing it.
    InputError
        If station, devices or points are not those that it was begun with, one line for each thing that differs; if
        the run keeps only the name of its station and it is not given.
    """
    if not (folder / RUN_FILE).exists():
        raise RunError(f"{folder}: there is no such run")
    header, protocol, station = read_task(folder, station)
    if workforce is not None and not workforce.alone:
        require_simulated(station)
    other = _require_same_station(header, station, accept_differences)
    conduct = conduct_of(protocol)
    refining = Refining(protocol.refined_curves(), plan_or_raise(protocol.expand(), station), station)
    require_conditions(conduct, station)
    crew = Crew.of(progress, stop, operator, workforce)
    with RunWriter(folder, None) as writer:
        begun = _Begun(folder, header, tuple(read_journal(folder / JOURNAL_FILE)))
        refining.replay(begun.journal, str(folder / JOURNAL_FILE))
        sound = begun.look_through(writer, refining.in_order(), crew.progress)
        other += begun.require_same_points(refining.in_order(), sound, accept_differences)
        refining.open(writer, header.roi, crew.progress.message)
        refining.catch_up([item for item in refining.in_order() if _is_left(writer, item, retry_skipped)])
        planned = refining.in_order()
        left = [item for item in planned if _is_left(writer, item, retry_skipped)]
        require_operator([item.point for item in left], operator)
        before = _before(writer, planned, left)
        if not left:
            return _nothing_left(writer, begun, before, crew.progress)
        crew.progress.message(f"{before.done} of {len(planned)} points are done already")
        _tell_other_software(header.everything.get("software"), crew.progress)
        rest = Rest(_identities(header), header.roi, accept_differences, tuple(other))
        taken = carry_out(left, station, folder, lambda: writer, crew, conduct, refining, rest)
    done, skipped = before.done + taken.done, before.skipped + taken.skipped
    total = len(refining.in_order())
    return RunResult(folder, header.id, done, total, taken.stopped, resumable=True, skipped=skipped)


def _is_left(writer: RunWriter, item: PlannedPoint, retry_skipped: bool) -> bool:
    index = item.point.index
    return not writer.is_done(index) and (retry_skipped or not writer.is_skipped(index))


@dataclass(frozen=True, slots=True)
class _Before:
    """What was there before the run is gone on with."""

    done: int
    skipped: int


def _before(writer: RunWriter, planned: Sequence[PlannedPoint], left: Sequence[PlannedPoint]) -> _Before:
    done = sum(writer.is_done(item.point.index) for item in planned)
    return _Before(done, len(planned) - len(left) - done)


def _nothing_left(writer: RunWriter, begun: _Begun, before: _Before, progress: Progress) -> RunResult:
    if begun.journal[-1].state != "run_finished":
        writer.note("run_finished")
    progress.message(f"all {before.done} points of this run are done{_skipped_text(before.skipped)}")
    total = before.done + before.skipped
    return RunResult(
        begun.folder, begun.header.id, before.done, total, stopped=False, resumable=True, skipped=before.skipped
    )


def _skipped_text(skipped: int) -> str:
    return f"; {skipped} were skipped, try them again with --retry-skipped" if skipped else ""


def _require_same_station(header: RunHeader, station: Station, accepted: bool) -> list[str]:
    """Return where the station differs from the one in ``run.yaml``.

    Raises
    ------
    InputError
        If it does, and that is not accepted: one line for each place.
    """
    written = {key: value for key, value in _written(header).items() if key != _IDENTITIES}
    now = {key: value for key, value in station.recorded.items() if key != _IDENTITIES}
    found = differences(written, now)
    if found and not accepted:
        raise InputError(*[f"the run was begun on another station: {line}" for line in found], _ACCEPT)
    return list(found)


def _written(header: RunHeader) -> dict[str, Any]:
    station = header.everything.get("station")
    return station if isinstance(station, dict) else {}


def _identities(header: RunHeader) -> dict[str, Any]:
    found = _written(header).get(_IDENTITIES)
    return found if isinstance(found, dict) else {}


@dataclass(frozen=True, slots=True)
class _Begun:
    """A run that was begun, before it is gone on with."""

    folder: Path
    header: RunHeader
    journal: tuple[JournalEntry, ...]

    def look_through(
        self, writer: RunWriter, planned: Sequence[PlannedPoint], progress: Progress
    ) -> dict[int, JournalEntry]:
        """Give up points whose files are not sound, and adopt files that are whole and have no line.

        Returns the points that were done and are sound.
        """
        sound = last_done(self.journal)
        for index, why in unsound_points(self.folder, self.journal).items():
            writer.give_up(index, why)
            progress.message(f"point {index} is taken again: {why}")
            del sound[index]
        points = {item.point.index: item.point for item in planned}
        for index, file in writer.unadopted():
            try:
                probe([file])
                found = read_point(file, self.header.roi)
                for _ in read_events(file, roi=found.roi):
                    pass
            except RunError as error:
                _log.warning("%s; it is taken again", error)
                continue
            if index in points and (found.index, found.attributes.get("seed")) == (index, points[index].seed):
                writer.adopt(index, file)
        return sound

    def require_same_points(
        self, planned: Sequence[PlannedPoint], sound: dict[int, JournalEntry], accepted: bool
    ) -> list[str]:
        """Return where the points that are done are not those of the protocol.

        Raises
        ------
        InputError
            If some are not, and that is not accepted.
        """
        found = list(self._other_plan(planned, sound))
        if found and not accepted:
            raise InputError(*found, _ACCEPT)
        return found

    def _other_plan(self, planned: Sequence[PlannedPoint], sound: dict[int, JournalEntry]) -> Iterator[str]:
        written = {entry.point for entry in self.journal if entry.state == "planned"}
        now = {item.point.index for item in planned}
        if written and not written <= now:
            yield f"{self.folder / RUN_FILE}: the protocol in it has {len(now)} points, the run was begun with more"
        points = {item.point.index: item.point for item in planned}
        done = [(self.folder / e.file, points[i]) for i, e in sound.items() if i in points and e.file is not None]
        # Where the checksum is known, a sound file is as it was written: the HDF5 library survives it.
        probe(self.folder / e.file for e in sound.values() if e.file is not None and e.sha256 is None)
        for file, point in done:
            yield from _other_point(file, point)


def _other_point(file: Path, point: Point) -> Iterator[str]:
    found = read_point(file, point.roi)
    before = {name: found.attributes.get(name) for name in ("measurement", "seed")}
    for line in differences(before, {"measurement": point.measurement, "seed": point.seed}):
        yield f"{file}: it is not the point of the protocol in run.yaml: {line}"


def _tell_other_software(begun: object, progress: Progress) -> None:
    """Say so where the run was begun with other software: what is taken now may not be what would have been."""
    if not isinstance(begun, dict):
        return
    now = software_versions()
    names = [name for name in now if name not in _NO_MATTER and now[name] != begun.get(name)]
    if names:
        different = ", ".join(f"{name} {now[name]} instead of {begun.get(name)}" for name in names)
        _log.warning("begun with other software: %s", different)
        progress.message(f"begun with other software: {different}; the points that are left may have other events")
