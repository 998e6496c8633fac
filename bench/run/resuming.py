"""Going on with a run that was stopped or killed: what is done is kept, what was being taken is taken again."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Final

from bench.run.by_workers import require_simulated
from bench.run.plan import plan_or_raise
from bench.run.protocol_run import read_task
from bench.run.runner import Crew, RunResult, carry_out, require_operator
from bench.run.software import software_versions
from bench.store.errors import RunError
from bench.store.probe import probe
from bench.store.reader import read_events, read_point
from bench.store.run import Run
from bench.store.writer import RunWriter

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from bench.compute import Workforce
    from bench.run.plan import PlannedPoint
    from bench.run.progress import Progress
    from bench.run.stop import StopFlag
    from bench.station import Station

__all__ = ["resume"]

_log = logging.getLogger("evs_bench.run")
#: What of the software has no say in the events.
_NO_MATTER: Final = ("platform", "h5py", "pydantic")


def resume(
    folder: Path,
    *,
    station: Station | None = None,
    progress: Progress | None = None,
    stop: StopFlag | None = None,
    operator: Callable[[str], None] | None = None,
    workforce: Workforce | None = None,
) -> RunResult:
    """Take the points of the simulated run in `folder` that are not done.

    The protocol, the seeds and the station are those in its ``run.yaml``, so that all events are those of a run
    that was never stopped, with the same software; another is told. A whole file that has no ``done`` line is looked
    through and kept.

    Parameters
    ----------
    folder
        The run folder.
    station
        The station, where the run keeps only its name.
    progress, stop, operator, workforce
        See :func:`~bench.run.runner.take_run`, also for what is raised.

    Raises
    ------
    RunError
        If `folder` holds no run, or one that does not say how it was taken, or another process is writing it, or one
        of its points is damaged.
    InputError
        If the station is not wholly simulated, or if the run keeps only its name and it is not given.
    """
    run = Run.open(folder)
    header, protocol, station = read_task(folder, station)
    require_simulated(station)
    planned = plan_or_raise(protocol.expand(), station)
    crew = Crew.of(progress, stop, operator, workforce)
    with RunWriter(folder, None) as writer:
        _adopt(writer, planned, run)
        left = [item for item in planned if not writer.is_done(item.point.index)]
        require_operator([item.point for item in left], operator)
        before = len(planned) - len(left)
        if not left:
            if run.journal[-1].state != "run_finished":
                writer.note("run_finished")
            crew.progress.message(f"all {before} points of this run are done")
            return RunResult(folder, header.id, before, before, stopped=False)
        crew.progress.message(f"{before} of {len(planned)} points are done already")
        _tell_other_software(header.everything.get("software"), crew.progress)
        done = before + carry_out(left, station, folder, lambda: writer, crew, resumed=True)
    return RunResult(folder, header.id, done, len(planned), stopped=done < len(planned), resumable=True)


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


def _adopt(writer: RunWriter, planned: Sequence[PlannedPoint], run: Run) -> None:
    """Keep whole files without a ``done`` line: their writer was killed between the two."""
    points = {item.point.index: item.point for item in planned}
    for index, file in writer.unadopted().items():
        try:
            probe([file])
            found = read_point(file, run.header.roi)
            for _ in read_events(file, roi=found.roi):
                pass
        except RunError as error:
            _log.warning("%s; it is taken again", error)
            continue
        if index in points and (found.index, found.attributes.get("seed")) == (index, points[index].seed):
            writer.adopt(index)
