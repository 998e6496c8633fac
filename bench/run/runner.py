"""Taking all points of a protocol on a station, and leaving a run folder."""

from __future__ import annotations

import contextlib
import logging
import re
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from bench.compute import Workforce
from bench.logs import LOG_FILE, log_into
from bench.run.by_workers import ByWorkers, require_simulated
from bench.run.control import Control
from bench.run.deadline import Watchdog
from bench.run.differences import differences
from bench.run.holding import Holding
from bench.run.one_by_one import OneByOne
from bench.run.plan import plan_or_raise
from bench.run.policies import Conduct
from bench.run.progress import NoProgress
from bench.run.reconnecting import Rig
from bench.run.refining import Refining
from bench.run.software import software_versions
from bench.run.states import Course
from bench.run.stop import StopFlag
from bench.run.suspenders import problems_with
from bench.run.suspenders_ambient import DarkRecording
from bench.run.taking import Hands
from bench.station.station import DevicesFailed
from bench.store.errors import RunError
from bench.store.writer import RunWriter
from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from bench.compute import Executor
    from bench.run.plan import PlannedPoint
    from bench.run.progress import Progress
    from bench.run.taking import Taken, Taking
    from bench.station import Station
    from protocols.points import Point, Roi
    from protocols.refining import RefinedCurve

__all__ = [
    "Crew",
    "Rest",
    "RunResult",
    "Task",
    "assume_done",
    "carry_out",
    "new_run_id",
    "require_conditions",
    "require_operator",
    "take_run",
]

_log = logging.getLogger("evs_bench.run")
_ABORTED: Final = "aborted by the operator, from another terminal"
_HOW_TO_ACCEPT: Final = "put back what it was begun with, or say --accept-differences"


@dataclass(frozen=True, slots=True)
class Task:
    """What is to be taken: the points, and what ``run.yaml`` says of them."""

    name: str  #: short name, for the id of the run
    title: str
    points: tuple[Point, ...]
    protocol: dict[str, Any]  #: resolved
    protocol_text: str  #: as it was written
    seed: int
    conduct: Conduct = field(default_factory=Conduct)  #: what is done when something goes wrong
    curves: tuple[RefinedCurve, ...] = ()  #: those to which points may be added


@dataclass(frozen=True, slots=True)
class RunResult:
    """What a run left behind."""

    folder: Path
    run_id: str
    done: int  #: points that were taken
    total: int
    stopped: bool  #: by the operator, before the last point
    resumable: bool = False  #: whether :func:`bench.run.resume` takes the rest of it
    skipped: int = 0  #: points that were left out, as the protocol's policy says


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
    require_conditions(task.conduct, station)
    require_operator(task.points, operator)
    run_id = new_run_id(task.name)
    if out is None:
        run_id = _free_name(Path("runs") / run_id).name
    folder = out or Path("runs") / run_id
    if folder.exists():
        raise RunError(f"{folder}: exists already, and a run never overwrites; choose another name")
    roi = planned[0].point.roi
    crew = Crew.of(progress, stop, operator, workforce)

    def open_writer() -> RunWriter:  # called once the devices have told who they are
        return RunWriter(folder, _header(task, station, run_id, roi))

    refining = Refining(task.curves, planned, station)
    taken = carry_out(planned, station, folder, open_writer, crew, task.conduct, refining)
    resumable = bool(task.protocol)
    return RunResult(folder, run_id, taken.done, taken.total, taken.stopped, resumable, taken.skipped)


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


@dataclass(frozen=True, slots=True)
class Rest:
    """What is known of a run that is gone on with."""

    identities: dict[str, Any]  #: of the devices that it was begun with; empty if they are not known
    roi: Roi  #: its window, which need not be that of the first point that is left
    accepted: bool = False  #: whether it goes on with others, too
    differences: tuple[str, ...] = ()  #: that the operator has accepted


def carry_out(
    planned: Sequence[PlannedPoint],
    station: Station,
    folder: Path,
    open_writer: Callable[[], RunWriter],
    crew: Crew,
    conduct: Conduct,
    refining: Refining,
    rest: Rest | None = None,
) -> Taken:
    """Take points into a run folder, and return what came of them; `open_writer` is called when all is ready.

    Raises what :func:`take_run` does.

    Parameters
    ----------
    conduct
        What is done when something goes wrong.
    refining
        Adds points to curves.
    rest
        Where the points are what was left of a run.
    """
    with contextlib.ExitStack() as after:
        after.enter_context(contextlib.closing(crew.progress))
        after.enter_context(crew.stop.listening())
        executor = None
        if not crew.workforce.alone:
            executor = after.enter_context(crew.workforce.open(crew.progress.message))
        log = after.enter_context(contextlib.ExitStack())  # it sees the station being closed
        after.enter_context(_connected(station))
        begin = _begin(station, rest)
        roi = planned[0].point.roi if rest is None else rest.roi
        writer = after.enter_context(open_writer())
        after.enter_context(_telling_how_to_go_on(folder, station, crew.progress))
        log.enter_context(log_into(folder / LOG_FILE))
        _log.info("run in %s on station %s", folder, station.name)
        watchdog = after.enter_context(Watchdog(conduct.policy.deadline, station, crew.stop))
        control = after.enter_context(Control(folder, lambda: crew.stop.at_once(_ABORTED)))
        course = Course(writer.note)
        dark = DarkRecording(station, planned[0].point.roi, planned[0].biases)
        holding = Holding(station, folder, control, crew.stop, course, crew.progress, conduct, dark)
        hands = Hands(writer, course, holding, crew.progress, crew.stop, crew.operator, conduct)
        refining.open(writer, roi, crew.progress.message)
        taking = _taking(roi, station, executor, watchdog, hands, crew, refining)
        return taking.take_all(refining.plan(planned), **begin)


def _taking(
    roi: Roi,
    station: Station,
    executor: Executor | None,
    watchdog: Watchdog,
    hands: Hands,
    crew: Crew,
    refining: Refining,
) -> Taking:
    if executor is None:
        return OneByOne(Rig(station, roi, hands.conduct.policy.reconnect, watchdog), watchdog, hands, refining)
    return ByWorkers(executor, station, roi, crew.workforce.cluster is None, hands, refining)


def _begin(station: Station, rest: Rest | None) -> dict[str, Any]:
    """Return how the run begins in the journal, on the station that is connected now.

    Raises
    ------
    InputError
        If it is gone on with, and the devices are not those that it was begun with.
    """
    if rest is None:
        return {}
    other = differences(rest.identities, station.identities()) if rest.identities else ()
    if other and not rest.accepted:
        raise InputError(*[f"the run was begun with other devices: {line}" for line in other], _HOW_TO_ACCEPT)
    found = [*rest.differences, *other]
    return {"begin": "resumed", **({"differences": found} if found else {})}


@contextlib.contextmanager
def _telling_how_to_go_on(folder: Path, station: Station, progress: Progress) -> Iterator[None]:
    """Say how to go on with a run that ends before its time, whatever the reason."""
    try:
        yield
    except BaseException as error:
        if folder.exists():
            file = " --station FILE" if station.blind else ""
            advice = f"go on with: evs-bench resume {folder}{file}"
            if isinstance(error, KeyboardInterrupt):
                raise KeyboardInterrupt(f"{error or 'stopped at once'}; {advice}") from error
            progress.message(advice)
        raise


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


def require_conditions(conduct: Conduct, station: Station) -> None:
    """Raise :class:`InputError` if the run is to wait for something that `station` cannot tell."""
    problems = () if conduct.suspend is None else problems_with(conduct.suspend, station)
    if problems:
        raise InputError(*problems)


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
