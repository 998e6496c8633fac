"""Taking points one after the other on the station that is connected here, again where the policy says so."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

from bench.run.deadline import measuring_s, preparing_s
from bench.run.judging import Judge
from bench.run.policies import Failures
from bench.run.reconnecting import OtherDevices
from bench.run.states import State
from bench.run.taking import Taking, cost, description, reason_of
from drivers.errors import DeviceError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bench.run.deadline import Watchdog
    from bench.run.judging import Judged
    from bench.run.plan import PlannedPoint
    from bench.run.progress import Stopwatch
    from bench.run.reconnecting import Rig
    from bench.run.refining import Refining
    from bench.run.taking import Hands
    from bench.store.point_writer import PointWriter
    from bench.store.record import PointRecord

__all__ = ["OneByOne"]


class OneByOne(Taking):
    """Points one after the other.

    Parameters
    ----------
    rig
        The connected station.
    watchdog
        What cuts a step short that hangs.
    hands
        See :class:`~bench.run.taking.Taking`.
    refining
        Adds points to curves.
    """

    def __init__(self, rig: Rig, watchdog: Watchdog, hands: Hands, refining: Refining) -> None:
        super().__init__(hands)
        self._rig = rig
        self._watchdog = watchdog
        self._refining = refining
        self._policy = hands.conduct.policy.on_failure
        self._judge = Judge(hands.conduct.dark_light_lux)

    def _take(self, planned: Sequence[PlannedPoint], watch: Stopwatch) -> None:
        todo = deque(planned)
        watch.grow((), self._refining.may_add())
        while todo:
            item = todo.popleft()
            if not self._may_go_on(watch):
                return
            self._tell(planned, watch, description(item.point))
            self._ask_operator(item.point)
            if not self._deal_with(item, watch):
                return
            todo.extendleft(reversed(self._refining.after(item, watch)))

    def _may_go_on(self, watch: Stopwatch) -> bool:
        going_on = self._hands.holding.may_go_on(watch)
        if self._hands.holding.touched:
            self._hands.holding.touched = False
            self._rig.forget()
        return going_on

    def _deal_with(self, item: PlannedPoint, watch: Stopwatch) -> bool:
        """Take a point as often as the policy says; return False if somebody wishes to stop."""
        failures = Failures(self._policy)
        while not self._attempt_ended_well(item, failures, watch):
            watch.again(cost(item))
            if not self._may_go_on(watch):
                return False
        return True

    def _attempt_ended_well(self, item: PlannedPoint, failures: Failures, watch: Stopwatch) -> bool:
        """Take a point once, and return whether it is dealt with: taken, or left out."""
        index = item.point.index
        try:
            worth = self._attempt(item)
        except DeviceError as error:
            if not self._writer.is_done(index):
                return self._see_to_failure(index, error, failures, watch)
            self._recover(watch)  # what went wrong came after it
            return True
        if worth.left_out:
            self._skip(index, worth.reason)
        return not worth.again

    def _attempt(self, item: PlannedPoint) -> _Worth:
        """Take one point; whatever happens, the journal has it."""
        index = item.point.index
        self._course.go(State.PREPARING)
        self._writer.begin(index)
        try:
            with self._watchdog.step(f"prepare point {index}", preparing_s(item)):
                self._rig.recorder.prepare(item)
            self._course.go(State.MEASURING)
            with self._writer.point(index) as file:
                with self._watchdog.step(f"take point {index}", measuring_s(item)):
                    record, judged = self._judge.record(self._rig.recorder, item, file)
                worth = self._keep(file, record, judged)
        except BaseException as error:
            self._failed(index, error)
            raise
        self._course.go(State.IDLE)
        return worth

    def _keep(self, file: PointWriter, record: PointRecord, judged: Judged) -> _Worth:
        """Complete the file of a point: as done, or as evidence of a bad one."""
        reason = "; ".join(judged.reasons)
        again = judged.is_bad and self._bad.again(record.index)
        if again or (judged.is_bad and self._bad.are_skipped):
            self._writer.reject(file, record, reason=reason, **judged.keys())
            if again:
                self._progress.message(f"point {record.index} is bad and taken again: {reason}")
            return _Worth(again, not again, reason)
        self._writer.finish(file, record, **judged.keys())
        return _Worth()

    def _see_to_failure(self, index: int, error: DeviceError, failures: Failures, watch: Stopwatch) -> bool:
        """Do what the policy says; return whether the point is dealt with.

        Raises
        ------
        DeviceError
            If the run is to end.
        """
        again = failures.again()
        if not again and self._policy.then == "abort":
            raise error
        self._course.go(State.WAITING, reason_of(error))
        if not again and self._policy.then == "skip":
            self._skip(index, reason_of(error))
            self._recover(watch)
            return True
        if again:
            self._progress.message(f"point {index} failed and is tried again: {reason_of(error)}")
        else:
            self._hands.holding.pause(watch, f"point {index} failed: {reason_of(error)}")
            failures.forgive()
        self._recover(watch)
        return False

    def _recover(self, watch: Stopwatch) -> None:
        """Let the devices come to themselves in the dark, and reach them again."""
        while not self._stop.requested:
            self._course.go(State.WAITING)
            try:
                self._rig.station.safe_state()
                self._rig.station.clock.sleep(self._policy.wait_s)
                self._rig.reconnect()
            except OtherDevices:
                raise
            except DeviceError as error:
                if self._policy.then != "pause":
                    raise
                self._hands.holding.pause(watch, reason_of(error))
            else:
                self._course.go(State.IDLE)
                return


@dataclass(frozen=True, slots=True)
class _Worth:
    """What becomes of a point that was taken."""

    again: bool = False
    left_out: bool = False
    reason: str = ""
