"""Taking the points of a simulated run by several workers; this process alone writes the run folder.

A worker leaves a whole file under a temporary name in the run folder, or sends it back; it is given its name and its
``done`` line here. So a run that is killed, stopped or resumed keeps the promises of one that one process takes.
"""

from __future__ import annotations

import logging
from contextlib import closing
from typing import TYPE_CHECKING, Any, Final

from bench.compute import ItemFailed
from bench.run.measuring import PointJob, measure
from bench.run.taking import Taking, description
from bench.store.errors import RunError
from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from bench.compute import Executor
    from bench.run.measuring import Measured
    from bench.run.plan import PlannedPoint
    from bench.run.progress import Progress, Stopwatch
    from bench.run.stop import StopFlag
    from bench.station import Station
    from bench.store.writer import RunWriter
    from protocols.points import Roi

__all__ = ["ByWorkers", "is_simulated", "require_simulated"]

#: What an argument says that stands for the world of the station.
_WORLD: Final = "$world"


class ByWorkers(Taking):
    """Points by several workers, in the order in which they are finished.

    Parameters
    ----------
    executor
        The workers.
    station
        Of a simulated world; each worker makes its own.
    roi
        The run's window.
    same_disk
        Whether the workers can write into the run folder.
    writer, progress, stop, operator
        See :class:`~bench.run.taking.Taking`.
    """

    def __init__(
        self,
        executor: Executor,
        station: Station,
        roi: Roi,
        same_disk: bool,
        writer: RunWriter,
        progress: Progress,
        stop: StopFlag,
        operator: Callable[[str], None],
    ) -> None:
        super().__init__(writer, progress, stop, operator)
        self._executor = executor
        self._station = station
        self._roi = roi
        self._same_disk = same_disk
        self._under_way: dict[int, PlannedPoint] = {}

    def _take(self, planned: Sequence[PlannedPoint], watch: Stopwatch) -> int:
        done = 0
        self._progress.update(watch.status(0, description(planned[0].point)))
        try:
            with closing(self._executor.map(measure, self._jobs(planned), name=_name)) as results:
                for _, measured in results:
                    self._keep(measured)
                    done += 1
                    for item in list(self._under_way.values())[:1]:  # the one that was begun first
                        self._progress.update(watch.status(done, description(item.point)))
        except ItemFailed as failed:
            self._drop(failed.error, planned[failed.index].point.index)
            raise failed.error from None
        except BaseException as error:
            self._drop(error)
            raise
        return done

    def _jobs(self, planned: Sequence[PlannedPoint]) -> Iterator[PointJob]:
        """Yield the points until the operator wishes to stop; each is asked for when a worker is free."""
        for item in planned:
            if self._stop.requested:
                return
            self._begin(item)
            index = item.point.index
            self._under_way[index] = item
            file = self._writer.part_of(index).resolve() if self._same_disk else None
            yield PointJob(item, self._station.resolved, self._station.name, self._roi, file)

    def _keep(self, measured: Measured) -> None:
        for record in measured.log:
            logging.getLogger(record.name).handle(record)
        self._writer.commit(measured.index, measured.sha256, measured.content)
        del self._under_way[measured.index]

    def _drop(self, error: BaseException, failed: int | None = None) -> None:
        """Clear away what is under way after an error, that of the point `failed` or of them all."""
        for index in list(self._under_way):
            self._writer.discard(index)
            own = failed is None or index == failed
            self._failed(index, error if own else RunError(f"given up when point {failed} failed"))


def require_simulated(station: Station) -> None:
    """Raise :class:`~protocols.InputError` unless everything of `station` lives in a simulated world.

    Only then can each worker have a station of its own, and a run go on with another than it was begun with.
    """
    if not is_simulated(station):
        real = [f"{role} ({part['driver']})" for role, part in _roles(station).items() if not _in_world(part)]
        raise InputError(
            f"station {station.name}: {', '.join(real) or 'it'} is no part of a simulated world; only a run that is "
            "simulated as a whole can have several workers, or be resumed"
        )


def is_simulated(station: Station) -> bool:
    """Return whether everything of `station` lives in a simulated world."""
    return bool(station.resolved.get("world")) and all(_in_world(part) for part in _roles(station).values())


def _roles(station: Station) -> dict[str, dict[str, Any]]:
    roles: dict[str, dict[str, Any]] = station.resolved.get("roles", {})
    return roles


def _in_world(role: dict[str, Any]) -> bool:
    return _WORLD in role["args"].values()


def _name(job: PointJob) -> str:
    return f"point {job.planned.point.index} ({description(job.planned.point)})"
