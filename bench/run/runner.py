"""Taking all points of a protocol on a station, and leaving a run folder."""

from __future__ import annotations

import contextlib
import logging
import re
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bench.compute import Workforce
from bench.logs import LOG_FILE, log_into
from bench.run.by_workers import ByWorkers, is_simulated, require_simulated
from bench.run.plan import plan_or_raise
from bench.run.progress import NoProgress
from bench.run.recorder import Recorder
from bench.run.software import software_versions
from bench.run.stop import StopFlag
from bench.run.taking import OneByOne
from bench.station.station import DevicesFailed
from bench.store.errors import RunError
from bench.store.writer import RunWriter
from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from bench.run.plan import PlannedPoint
    from bench.run.progress import Progress
    from bench.station import Station
    from protocols.points import Point, Roi

__all__ = [
    "Crew",
    "RunResult",
    "Task",
    "assume_done",
    "carry_out",
    "new_run_id",
    "require_operator",
    "take_run",
]

_log = logging.getLogger("evs_bench.run")


@dataclass(frozen=True, slots=True)
class Task:
    """What is to be taken: the points, and what ``run.yaml`` says of them."""

    name: str  #: short name, for the id of the run
    title: str
    points: tuple[Point, ...]
    protocol: dict[str, Any]  #: resolved
    protocol_text: str  #: as it was written
    seed: int


@dataclass(frozen=True, slots=True)
class RunResult:
    """What a run left behind."""

    folder: Path
    run_id: str
    done: int  #: points that were taken
    total: int
    stopped: bool  #: by the operator, before the last point
    resumable: bool = False  #: whether :func:`bench.run.resume` takes the rest of it


def new_run_id(name: str, now: datetime | None = None) -> str:
    """Return a sortable id: the time in UTC and the name in small letters, ``2026-11-20T21-03-11.042Z-on-family``."""
    moment = now or datetime.now(UTC)
    at = f"{moment:%Y-%m-%dT%H-%M-%S}.{moment.microsecond // 1000:03d}Z"
    slug = re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-")
    return f"{at}-{slug}" if slug else at


def take_run(
    task: Task,
    station: Station,
    out: Path | None = None,
    *,
    progress: Progress | None = None,
    stop: StopFlag | None = None,
    operator: Callable[[str], None] | None = None,
    workforce: Workforce | None = None,
) -> RunResult:
    """Take all points of `task` on `station`.

    The station is connected after everything has been checked, and is in its safe state when this returns or raises.

    Parameters
    ----------
    out
        The run folder to make; default is ``runs/ID``. It must not exist.
    progress
        Where to tell how far it is; default is nowhere.
    stop
        The operator's wish to stop; it is looked at after each point. Ctrl-C is listened to meanwhile.
    operator
        Called with each step that a person has to do; returns when it is done. Ctrl-C in it stops the run at once.
        :func:`assume_done` takes every step as done; without one, points with such a step are refused.
    workforce
        Who measures, where the whole station is simulated; default is this process. The events are the same.

    Raises
    ------
    InputError
        If points cannot be taken on this station (all reasons at once; nothing was switched on), a step needs an
        operator and there is none, or `out` cannot be written. Also if there are several workers and the station is
        not simulated, or if there is nobody to compute.
    DeviceError
        If a device fails: the point is noted as failed, the run as aborted. Also if a device could not be brought to
        its safe state at the end (:class:`~bench.station.DevicesFailed`), whatever else went wrong.
    KeyboardInterrupt
        If the operator wants to stop at once.
    """
    if workforce is not None and not workforce.alone:
        require_simulated(station)
    planned = plan_or_raise(task.points, station)
    require_operator(task.points, operator)
    run_id = new_run_id(task.name)
    if out is None:
        run_id = _free_name(Path("runs") / run_id).name
    folder = out or Path("runs") / run_id
    if folder.exists():
        raise RunError(f"{folder}: exists already, and a run never overwrites; choose another name")
    roi = planned[0].point.roi
    crew = Crew.of(progress, stop, operator, workforce)
    done = carry_out(planned, station, folder, lambda: RunWriter(folder, _header(task, station, run_id, roi)), crew)
    return RunResult(folder, run_id, done, len(planned), done < len(planned), is_simulated(station))


@dataclass(frozen=True, slots=True)
class Crew:
    """Who sees to a run: those who compute, and the operator."""

    progress: Progress
    stop: StopFlag
    operator: Callable[[str], None]
    workforce: Workforce

    @classmethod
    def of(
        cls,
        progress: Progress | None,
        stop: StopFlag | None,
        operator: Callable[[str], None] | None,
        workforce: Workforce | None,
    ) -> Crew:
        """Return the crew, with the default for who is not there."""
        progress = progress or NoProgress()
        return cls(progress, stop or StopFlag(progress.message), operator or assume_done, workforce or Workforce())


def carry_out(
    planned: Sequence[PlannedPoint],
    station: Station,
    folder: Path,
    open_writer: Callable[[], RunWriter],
    crew: Crew,
    *,
    resumed: bool = False,
) -> int:
    """Take points into a run folder, and return how many were taken; `open_writer` is called when all is ready.

    Raises what :func:`take_run` does.
    """
    roi = planned[0].point.roi
    with contextlib.ExitStack() as after:
        after.enter_context(contextlib.closing(crew.progress))
        after.enter_context(crew.stop.listening())
        executor = None
        if not crew.workforce.alone:
            executor = after.enter_context(crew.workforce.open(crew.progress.message))
        log = after.enter_context(contextlib.ExitStack())  # it sees the station being closed
        after.enter_context(_connected(station))
        writer = after.enter_context(open_writer())
        log.enter_context(log_into(folder / LOG_FILE))
        _log.info("run in %s on station %s", folder, station.name)
        told = (writer, crew.progress, crew.stop, crew.operator)
        if executor is None:
            return OneByOne(Recorder(station, roi), *told).take_all(planned, resumed=resumed)
        same_disk = crew.workforce.cluster is None
        return ByWorkers(executor, station, roi, same_disk, *told).take_all(planned, resumed=resumed)


@contextlib.contextmanager
def _connected(station: Station) -> Iterator[None]:
    """Connect `station`, and close it on every way out; it sees to the exit of the interpreter itself.

    A device that could not be brought to its safe state is an error, beside the one that is on its way.
    """
    error: BaseException | None = None
    try:
        station.connect()
        yield
    except BaseException as caught:
        error = caught
        raise
    finally:
        station.close()
        if station.unsafe:
            first = () if error is None or isinstance(error, KeyboardInterrupt) else (error,)
            raise DevicesFailed(station.name, (*first, *station.unsafe)) from error


def assume_done(step: str) -> None:
    """Take a step that a person has to do as done, and say so in the log."""
    _log.info("operator step taken as done: %s", step)


def require_operator(points: Sequence[Point], operator: Callable[[str], None] | None) -> None:
    """Raise :class:`InputError` if a point has a step for a person, and there is nobody to do it."""
    steps = [point for point in points if point.operator_before is not None]
    if steps and operator is None:
        raise InputError(
            f"{steps[0].measurement}: somebody has to do this first: {steps[0].operator_before!r}; run it at a "
            "terminal, or with --operator-steps assume if it needs no doing"
        )


def _free_name(folder: Path) -> Path:
    """Return `folder`, with a number behind it if another run began in the same moment."""
    number, name = 1, folder
    while name.exists():
        number += 1
        name = folder.with_name(f"{folder.name}-{number}")
    return name


def _header(task: Task, station: Station, run_id: str, roi: Roi) -> dict[str, Any]:
    """Return the keys of ``run.yaml``, all plain values."""
    return {
        "id": run_id,
        "created": datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
        "title": task.title,
        "sensor": asdict(station.sensor),
        "roi": asdict(roi),
        "seed": task.seed,
        "protocol": task.protocol,
        "protocol_text": task.protocol_text,
        "station": station.recorded,
        "software": _software(station),
    }


def _software(station: Station) -> dict[str, Any]:
    """Return the versions, and where effects came from that the station names and that are not built in."""
    from bench.models.effect_sources import sources_in_use

    sources = sources_in_use(station.recorded)
    return {**software_versions(), **({"effects": sources} if sources else {})}
