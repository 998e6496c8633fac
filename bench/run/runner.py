"""Taking all points of a protocol on a station, and leaving a run folder."""

from __future__ import annotations

import contextlib
import logging
import re
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from bench.logs import log_into
from bench.run.plan import plan_or_raise
from bench.run.progress import NoProgress, Stopwatch
from bench.run.recorder import Recorder
from bench.run.software import software_versions
from bench.run.stop import StopFlag
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

__all__ = ["LOG_FILE", "RunResult", "Task", "assume_done", "new_run_id", "take_run"]

_log = logging.getLogger("evs_bench.run")
LOG_FILE: Final = "evs-bench.log"


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

    Raises
    ------
    InputError
        If points cannot be taken on this station (all reasons at once; nothing was switched on), a step needs an
        operator and there is none, or `out` cannot be written.
    DeviceError
        If a device fails: the point is noted as failed, the run as aborted. Also if a device could not be brought to
        its safe state at the end (:class:`~bench.station.DevicesFailed`), whatever else went wrong.
    KeyboardInterrupt
        If the operator wants to stop at once.
    """
    planned = plan_or_raise(task.points, station)
    _require_operator(task.points, operator)
    run_id = new_run_id(task.name)
    if out is None:
        run_id = _free_name(Path("runs") / run_id).name
    folder = out or Path("runs") / run_id
    if folder.exists():
        raise RunError(f"{folder}: exists already, and a run never overwrites; choose another name")
    progress = progress or NoProgress()
    stop = stop or StopFlag(progress.message)
    roi = planned[0].point.roi
    with contextlib.closing(progress), stop.listening(), contextlib.ExitStack() as until_closed, _connected(station):
        header = _header(task, station, run_id, roi)
        with RunWriter(folder, header) as writer:
            until_closed.enter_context(log_into(folder / LOG_FILE))  # it sees the station being closed
            _log.info("run %s on station %s", run_id, station.name)
            done = _Run(writer, Recorder(station, roi), progress, stop, operator or assume_done).take_all(planned)
    return RunResult(folder, run_id, done, len(planned), stopped=done < len(planned))


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


class _Run:
    """The points of one run, one after the other."""

    def __init__(
        self,
        writer: RunWriter,
        recorder: Recorder,
        progress: Progress,
        stop: StopFlag,
        operator: Callable[[str], None],
    ) -> None:
        self._writer = writer
        self._recorder = recorder
        self._progress = progress
        self._stop = stop
        self._operator = operator

    def take_all(self, planned: Sequence[PlannedPoint]) -> int:
        """Take the points, and return how many were taken before the end or the operator's wish to stop."""
        note = self._writer.note
        note("run_started", points=len(planned))
        try:
            done = self._take_until_stopped(planned)
        except BaseException as error:
            self._note_if_possible("run_aborted", reason=_reason(error))
            raise
        if done < len(planned):
            note("run_aborted", reason="stopped by the operator")
        else:
            note("run_finished")
        return done

    def _take_until_stopped(self, planned: Sequence[PlannedPoint]) -> int:
        self._writer.note_plan([item.point.index for item in planned])
        watch = Stopwatch([_cost(item) for item in planned])
        for done, item in enumerate(planned):
            if self._stop.requested:
                return done
            self._progress.update(watch.status(done, _description(item.point)))
            self._take(item)
        self._progress.update(watch.status(len(planned), ""))
        return len(planned)

    def _take(self, item: PlannedPoint) -> None:
        """Take one point; whatever happens, the journal has it."""
        index = item.point.index
        if item.point.operator_before is not None:
            self._ask_operator(item.point.operator_before)
        self._writer.note("started", index)
        try:
            self._recorder.prepare(item)
            with self._writer.point(index) as file:
                self._writer.finish(file, self._recorder.take(item, file))
        except BaseException as error:
            if not self._writer.is_done(index):  # else it ended well, and what ends the run came after it
                _log.exception("point %d failed", index)
                self._note_if_possible("failed", index, reason=_reason(error))
            raise

    def _ask_operator(self, step: str) -> None:
        _log.info("operator step: %s", step)
        with self._stop.idle():
            self._operator(step)

    def _note_if_possible(self, state: str, point: int | None = None, *, reason: str) -> None:
        """Write a journal line about an error; the error itself matters more than a disk that takes no line."""
        with contextlib.suppress(RunError):
            self._writer.note(state, point, reason=reason)


def assume_done(step: str) -> None:
    """Take a step that a person has to do as done, and say so in the log."""
    _log.info("operator step taken as done: %s", step)


def _require_operator(points: Sequence[Point], operator: Callable[[str], None] | None) -> None:
    steps = [point for point in points if point.operator_before is not None]
    if steps and operator is None:
        raise InputError(
            f"{steps[0].measurement}: somebody has to do this first: {steps[0].operator_before!r}; run it at a "
            "terminal, or with --operator-steps assume if it needs no doing"
        )


def _reason(error: BaseException) -> str:
    if isinstance(error, KeyboardInterrupt):
        return "stopped at once by the operator"
    return " ".join(str(error).split()) or type(error).__name__


def _cost(item: PlannedPoint) -> float:
    """Return what a point is expected to cost: its recording and the settling of the light, s."""
    return item.waveform.duration_s + item.point.settle.light_s


def _description(point: Point) -> str:
    text = f"{point.measurement}, {point.baseline_lux:.4g} lux"
    return f"{text}, log contrast {point.log_contrast:.3f}" if point.log_contrast else text


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
        "station": station.resolved,
        "software": _software(station),
    }


def _software(station: Station) -> dict[str, Any]:
    """Return the versions, and where effects came from that the station names and that are not built in."""
    from bench.models.effect_sources import sources_in_use

    sources = sources_in_use(station.resolved)
    return {**software_versions(), **({"effects": sources} if sources else {})}
