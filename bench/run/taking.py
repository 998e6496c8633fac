"""Taking the points of a run, one after the other or by workers, and what the journal hears of it."""

from __future__ import annotations

import contextlib
import logging
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

from bench.run.progress import Stopwatch
from bench.store.errors import RunError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from bench.run.plan import PlannedPoint
    from bench.run.progress import Progress
    from bench.run.recorder import Recorder
    from bench.run.stop import StopFlag
    from bench.store.writer import RunWriter
    from protocols.points import Point

__all__ = ["OneByOne", "Taking", "description"]

_log = logging.getLogger("evs_bench.run")


class Taking(ABC):
    """The points of one run on their way into its folder.

    Parameters
    ----------
    writer
        Of the run folder.
    progress
        Where to tell how far it is.
    stop
        The operator's wish to stop, looked at before each point.
    operator
        Called with each step that a person has to do.
    """

    def __init__(
        self, writer: RunWriter, progress: Progress, stop: StopFlag, operator: Callable[[str], None]
    ) -> None:
        self._writer = writer
        self._progress = progress
        self._stop = stop
        self._operator = operator

    def take_all(self, planned: Sequence[PlannedPoint], *, resumed: bool = False) -> int:
        """Take the points, and return how many were taken before the end or the operator's wish to stop.

        Parameters
        ----------
        planned
            The points, in the order of the plan.
        resumed
            Whether these are what was left of a run.
        """
        note = self._writer.note
        note("resumed" if resumed else "run_started", points=len(planned))
        try:
            self._writer.note_plan([item.point.index for item in planned])
            done = self._take_until_stopped(planned)
        except BaseException as error:
            self._note_if_possible("run_aborted", reason=_reason(error))
            if isinstance(error, KeyboardInterrupt):
                raise KeyboardInterrupt(self._stopped_at_once(planned)) from error
            raise
        if done < len(planned):
            note("run_aborted", reason="stopped by the operator")
        else:
            note("run_finished")
        return done

    def _stopped_at_once(self, planned: Sequence[PlannedPoint]) -> str:
        """Return what an operator should know who did not wait for the end of a point."""
        done, folder = sum(self._writer.is_done(item.point.index) for item in planned), self._writer.folder
        text = f"stopped at once, after {done} of {len(planned)} points; what was being taken is not kept"
        if not done:
            return f"{text}; take the run again, with another --out"
        return f"{text}, the others are, in {folder}; evaluate them with: evs-bench report {folder}"

    def _take_until_stopped(self, planned: Sequence[PlannedPoint]) -> int:
        watch = Stopwatch([_cost(item) for item in planned])
        done = self._take(planned, watch)
        if done == len(planned):
            self._progress.update(watch.status(done, ""))
        return done

    @abstractmethod
    def _take(self, planned: Sequence[PlannedPoint], watch: Stopwatch) -> int:
        """Take the points until the end or the wish to stop; return how many."""

    def _begin(self, item: PlannedPoint) -> None:
        """See to the operator's step before a point, and note that it is started."""
        step = item.point.operator_before
        if step is not None:
            _log.info("operator step: %s", step)
            with self._stop.idle():
                self._operator(step)
        self._writer.note("started", item.point.index)

    def _failed(self, index: int, error: BaseException) -> None:
        """Note that a point was begun and did not come to its end."""
        if not self._writer.is_done(index):  # else it ended well, and what ends the run came after it
            _log.error("point %d failed", index, exc_info=error)
            self._note_if_possible("failed", index, reason=_reason(error))

    def _note_if_possible(self, state: str, point: int | None = None, *, reason: str) -> None:
        """Write a journal line about an error; the error itself matters more than a disk that takes no line."""
        with contextlib.suppress(RunError):
            self._writer.note(state, point, reason=reason)


class OneByOne(Taking):
    """Points one after the other, on the station that is connected here.

    Parameters
    ----------
    recorder
        Of the connected station.
    writer, progress, stop, operator
        See :class:`Taking`.
    """

    def __init__(
        self,
        recorder: Recorder,
        writer: RunWriter,
        progress: Progress,
        stop: StopFlag,
        operator: Callable[[str], None],
    ) -> None:
        super().__init__(writer, progress, stop, operator)
        self._recorder = recorder

    def _take(self, planned: Sequence[PlannedPoint], watch: Stopwatch) -> int:
        for done, item in enumerate(planned):
            if self._stop.requested:
                return done
            self._progress.update(watch.status(done, description(item.point)))
            self._begin(item)
            self._take_one(item)
        return len(planned)

    def _take_one(self, item: PlannedPoint) -> None:
        """Take one point; whatever happens, the journal has it."""
        index = item.point.index
        try:
            self._recorder.prepare(item)
            with self._writer.point(index) as file:
                self._writer.finish(file, self._recorder.take(item, file))
        except BaseException as error:
            self._failed(index, error)
            raise


def description(point: Point) -> str:
    """Return what a point is, for people."""
    text = f"{point.measurement}, {point.baseline_lux:.4g} lux"
    return f"{text}, log contrast {point.log_contrast:.3f}" if point.log_contrast else text


def _cost(item: PlannedPoint) -> float:
    """Return what a point is expected to cost: its recording and the settling of the light, s."""
    return item.waveform.duration_s + item.point.settle.light_s


def _reason(error: BaseException) -> str:
    if isinstance(error, KeyboardInterrupt):
        return "stopped at once by the operator"
    return " ".join(str(error).split()) or type(error).__name__
