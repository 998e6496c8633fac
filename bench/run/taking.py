"""Taking the points of a run, one after the other or by workers, and what the journal hears of it."""

from __future__ import annotations

import contextlib
import logging
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from bench.run.policies import BadPoints
from bench.run.progress import Stopwatch
from bench.run.states import State
from bench.store.errors import RunError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from bench.run.holding import Holding
    from bench.run.plan import PlannedPoint
    from bench.run.policies import Conduct
    from bench.run.progress import Progress
    from bench.run.states import Course
    from bench.run.stop import StopFlag
    from bench.store.writer import RunWriter
    from protocols.points import Point

__all__ = ["Hands", "Taken", "Taking", "cost", "description", "reason_of"]

_log = logging.getLogger("evs_bench.run")


@dataclass(frozen=True, slots=True)
class Hands:
    """What every way of taking points has to do with."""

    writer: RunWriter  #: of the run folder
    course: Course  #: the state of the run
    holding: Holding  #: asked before each point
    progress: Progress  #: where to tell how far it is
    stop: StopFlag  #: the wish to stop
    operator: Callable[[str], None]  #: called with each step that a person has to do
    conduct: Conduct  #: what is done when something goes wrong


@dataclass(frozen=True, slots=True)
class Taken:
    """What came of the points that were to be taken."""

    done: int
    skipped: int
    total: int

    @property
    def stopped(self) -> bool:
        """Whether some were neither taken nor left out."""
        return self.done + self.skipped < self.total


class Taking(ABC):
    """The points of one run on their way into its folder.

    Parameters
    ----------
    hands
        What it has to do with.
    """

    def __init__(self, hands: Hands) -> None:
        self._hands = hands
        self._writer = hands.writer
        self._course = hands.course
        self._progress = hands.progress
        self._stop = hands.stop
        self._bad = BadPoints(hands.conduct.policy.on_bad_point)

    def take_all(self, planned: Sequence[PlannedPoint], *, begin: str = "run_started", **more: Any) -> Taken:
        """Take the points, and return what came of them before the end or the wish to stop.

        Parameters
        ----------
        planned
            The points, in the order of the plan.
        begin
            ``run_started``; ``resumed`` if these are what was left of a run.
        **more
            Further keys of that line in the journal.
        """
        self._writer.note(begin, points=len(planned), **more)
        watch = Stopwatch([cost(item) for item in planned])
        try:
            self._writer.note_plan([item.point.index for item in planned])
            self._take(planned, watch)
            taken = self._taken(planned)
            self._end(taken, watch)
        except BaseException as error:
            self._ended_by(error)
            if isinstance(error, KeyboardInterrupt):
                raise KeyboardInterrupt(self._stopped_at_once(planned)) from error
            raise
        return taken

    def _taken(self, planned: Sequence[PlannedPoint]) -> Taken:
        indexes = [item.point.index for item in planned]
        done = sum(self._writer.is_done(index) for index in indexes)
        return Taken(done, sum(self._writer.is_skipped(index) for index in indexes), len(indexes))

    def _end(self, taken: Taken, watch: Stopwatch) -> None:
        if taken.stopped:
            self._course.go(State.ABORTED, self._stop.reason or "stopped by the operator")
            return
        self._course.go(State.FINISHING)
        self._progress.update(watch.status(taken.total, "", taken.skipped))
        self._course.go(State.COMPLETED)

    def _ended_by(self, error: BaseException) -> None:
        """Note what ended the run; the error itself matters more than a disk that takes no line."""
        state = State.ABORTED if isinstance(error, KeyboardInterrupt) else State.FAILED
        with contextlib.suppress(RunError):
            self._course.go(state, self._reason_of(error))

    def _stopped_at_once(self, planned: Sequence[PlannedPoint]) -> str:
        """Return what an operator should know who did not wait for the end of a point."""
        done = self._taken(planned).done
        text = f"stopped at once, after {done} of {len(planned)} points; what was being taken is not kept"
        return f"{text}, the others are, in {self._writer.folder}" if done else text

    @abstractmethod
    def _take(self, planned: Sequence[PlannedPoint], watch: Stopwatch) -> None:
        """Take the points until the end or the wish to stop."""

    def _tell(self, planned: Sequence[PlannedPoint], watch: Stopwatch, label: str) -> None:
        taken = self._taken(planned)
        self._progress.update(watch.status(taken.done + taken.skipped, label, taken.skipped))

    def _ask_operator(self, point: Point) -> None:
        """See to what a person has to do before a point."""
        step = point.operator_before
        if step is not None:
            _log.info("operator step: %s", step)
            self._course.go(State.WAITING, step)
            with self._stop.idle():
                self._hands.operator(step)

    def _failed(self, index: int, error: BaseException) -> None:
        """Note that a point was begun and did not come to its end."""
        if not self._writer.is_done(index):  # else it ended well, and what ends the run came after it
            _log.error("point %d failed", index, exc_info=error)
            with contextlib.suppress(RunError):
                self._writer.note("failed", index, reason=self._reason_of(error))

    def _skip(self, index: int, reason: str) -> None:
        self._writer.skip(index, reason)
        self._progress.message(f"point {index} is skipped: {reason}")

    def _reason_of(self, error: BaseException) -> str:
        if isinstance(error, KeyboardInterrupt):
            return self._stop.reason or "stopped at once by the operator"
        return reason_of(error)


def description(point: Point) -> str:
    """Return what a point is, for people."""
    text = f"{point.measurement}, {point.baseline_lux:.4g} lux"
    return f"{text}, log contrast {point.log_contrast:.3f}" if point.log_contrast else text


def cost(item: PlannedPoint) -> float:
    """Return what a point is expected to cost: its recording and the settling of the light, s."""
    return item.waveform.duration_s + item.point.settle.light_s


def reason_of(error: BaseException) -> str:
    """Return why an error came, in one line."""
    return " ".join(str(error).split()) or type(error).__name__
