"""Taking the points of a simulated run by several workers; this process alone writes the run folder.

A worker leaves a whole file under a temporary name in the run folder, or sends it back; it is given its name and its
``done`` line here. So a run that is killed, stopped or resumed keeps the promises of one that one process takes.
"""

from __future__ import annotations

import logging
from contextlib import closing
from typing import TYPE_CHECKING, Any, Final

from bench.compute import ItemFailed
from bench.run.measuring import NotMeasured, PointJob, measure
from bench.run.policies import Failures
from bench.run.states import State
from bench.run.taking import Taking, cost, description, reason_of
from bench.store.errors import RunError
from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from bench.compute import Executor
    from bench.run.measuring import Measured
    from bench.run.plan import PlannedPoint
    from bench.run.progress import Stopwatch
    from bench.run.refining import Refining
    from bench.run.taking import Hands
    from bench.station import Station
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
    hands
        See :class:`~bench.run.taking.Taking`.
    refining
        Adds points to curves; it decides here, on whole files, so that the points are those of one process.
    """

    def __init__(
        self, executor: Executor, station: Station, roi: Roi, same_disk: bool, hands: Hands, refining: Refining
    ) -> None:
        super().__init__(hands)
        self._refining = refining
        self._executor = executor
        self._station = station
        self._roi = roi
        self._same_disk = same_disk
        self._policy = hands.conduct.policy.on_failure
        self._under_way: dict[int, PlannedPoint] = {}
        self._failures: dict[int, Failures] = {}
        self._asked: set[int] = set()  # points whose step of a person was seen to
        self._left: list[PlannedPoint] = []  # not dealt with
        self._pause: str | None = None  # why the run is to be paused when the workers are done

    def _take(self, planned: Sequence[PlannedPoint], watch: Stopwatch) -> None:
        """Take the points in rounds; what is to be taken again comes into the next one, and so what was held back."""
        self._left = list(planned)
        watch.grow((), self._refining.may_add())
        self._tell(planned, watch, description(planned[0].point))
        while self._left and self._hands.holding.may_go_on(watch):
            self._round(planned, watch)
            self._course.go(State.IDLE)
            if self._pause is not None:
                self._hands.holding.pause(watch, self._pause)
                self._pause = None

    def _round(self, planned: Sequence[PlannedPoint], watch: Stopwatch) -> None:
        todo = list(self._left)
        try:
            with closing(self._executor.map(measure, self._jobs(todo), name=_name)) as results:
                for _, measured in results:
                    item = self._keep(measured)
                    if item in self._left:
                        watch.again(cost(item))
                    else:
                        todo += self._more_after(item, watch)
                    for under_way in list(self._under_way.values())[:1]:  # the one that was begun first
                        self._tell(planned, watch, description(under_way.point))
        except ItemFailed as failed:
            self._drop(failed.error, todo[failed.index].point.index)
            raise failed.error from None
        except _Ends as ends:
            self._drop(ends.error, ends.index)
            raise ends.error from None
        except BaseException as error:
            self._drop(error)
            raise

    def _more_after(self, item: PlannedPoint, watch: Stopwatch) -> list[PlannedPoint]:
        """Return the points that are added because of one that is dealt with; they are left to be taken."""
        more = self._refining.after(item, watch)
        self._left += more
        return more

    def _jobs(self, todo: Sequence[PlannedPoint]) -> Iterator[PointJob]:
        """Yield the points until the run is to be held; each is asked for when a worker is free.

        What is added to `todo` meanwhile is yielded, too; where it comes too late, it is left for the next round.
        """
        for item in todo:
            if self._pause is not None or not self._hands.holding.is_free:
                return
            if item.point.index not in self._asked:
                self._asked.add(item.point.index)
                self._ask_operator(item.point)
            self._measuring()
            index = item.point.index
            self._writer.begin(index)
            self._under_way[index] = item
            file = self._writer.part_of(index).resolve() if self._same_disk else None
            yield PointJob(item, self._station.resolved, self._station.name, self._roi, file)

    def _measuring(self) -> None:
        if self._course.state != State.MEASURING:
            self._course.go(State.PREPARING)
            self._course.go(State.MEASURING)

    def _keep(self, measured: Measured | NotMeasured) -> PlannedPoint:
        """Keep what a worker has measured, and return the point; it is left where it is to be taken again."""
        for record in measured.log:
            logging.getLogger(record.name).handle(record)
        item = self._under_way[measured.index]
        # It stays under way until it is in the journal.
        dealt_with = self._see_to_failure(measured) if isinstance(measured, NotMeasured) else self._commit(measured)
        del self._under_way[measured.index]
        if dealt_with:
            self._left.remove(item)
        return item

    def _commit(self, measured: Measured) -> bool:
        judged, index = measured.judged, measured.index
        reason = "; ".join(judged.reasons)
        again = judged.is_bad and self._bad.again(index)
        left_out = judged.is_bad and not again and self._bad.are_skipped
        more = {**judged.keys(), **({"state": "rejected", "reason": reason} if again or left_out else {})}
        self._writer.commit(index, measured.sha256, measured.content, **more)
        if left_out:
            self._skip(index, reason)
        return not again

    def _see_to_failure(self, found: NotMeasured) -> bool:
        """Do what the policy says; return whether the point is dealt with."""
        index, error = found.index, found.failure.error()
        failures = self._failures.setdefault(index, Failures(self._policy))
        again = failures.again()
        if not again and self._policy.then == "abort":
            raise _Ends(index, error)
        self._writer.discard(index)
        self._failed(index, error)
        if again:
            return False
        if self._policy.then == "skip":
            self._skip(index, reason_of(error))
            return True
        self._pause = f"point {index} failed: {reason_of(error)}"
        failures.forgive()
        return False

    def _drop(self, error: BaseException, failed: int | None = None) -> None:
        """Clear away what is under way after an error, that of the point `failed` or of them all."""
        for index in list(self._under_way):
            self._writer.discard(index)
            own = failed is None or index == failed
            self._failed(index, error if own else RunError(f"given up when point {failed} failed"))


class _Ends(Exception):
    """What ends the run, and the point over which it came."""

    def __init__(self, index: int, error: BaseException) -> None:
        super().__init__(str(error))
        self.index = index
        self.error = error


def require_simulated(station: Station) -> None:
    """Raise :class:`~protocols.InputError` unless everything of `station` lives in a simulated world.

    Only then can each worker have a station of its own.
    """
    if not is_simulated(station):
        real = [f"{role} ({part['driver']})" for role, part in _roles(station).items() if not _in_world(part)]
        raise InputError(
            f"station {station.name}: {', '.join(real) or 'it'} is no part of a simulated world; only a run that is "
            "simulated as a whole can have several workers"
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
