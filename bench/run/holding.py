"""Before each point: the run goes on, stops, pauses, or waits until the conditions are right."""

from __future__ import annotations

import logging
import time
from typing import TYPE_CHECKING, Final

from bench.run.progress import HoldListener
from bench.run.states import State
from bench.run.suspenders import suspenders_of

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from bench.run.control import Control
    from bench.run.policies import Conduct
    from bench.run.progress import Progress, Stopwatch
    from bench.run.states import Course
    from bench.run.stop import StopFlag
    from bench.run.suspenders import Suspender
    from bench.station import Station
    from protocols.suspend import Suspend

__all__ = ["Holding"]

_log = logging.getLogger("evs_bench.run")
_BY_OPERATOR: Final = "by the operator"
_LOOK_S: Final = 0.2  #: so often a run that is paused looks whether it may go on
_SLICE_S: Final = 1.0  #: so often one that is suspended looks for the operator


class Holding:
    """Holds a run where it must not measure; the station is dark meanwhile.

    Parameters
    ----------
    station
        Made safe while the run is held.
    folder
        Of the run.
    control
        The wishes of an operator at another terminal.
    stop
        The wish to stop.
    course
        The state of the run.
    progress
        Where the operator is told.
    conduct
        What the protocol says of it.
    dark_rate
        Takes a recording in the dark, where the protocol asks for some.

    Attributes
    ----------
    touched
        Whether a person or a recording in the dark may have changed settings since the flag was last put down.
    """

    def __init__(
        self,
        station: Station,
        folder: Path,
        control: Control,
        stop: StopFlag,
        course: Course,
        progress: Progress,
        conduct: Conduct,
        dark_rate: Callable[[], tuple[int, float]],
    ) -> None:
        self._station = station
        self._folder = folder
        self._control = control
        self._stop = stop
        self._course = course
        self._progress = progress
        self._suspend = conduct.suspend
        self.touched = False
        self._given_up_for = ""  # what the run waited for, for too long: why it is paused
        self._suspenders = self._conditions(folder, dark_rate)

    def may_go_on(self, watch: Stopwatch) -> bool:
        """Wait as long as the run is to be held, and return whether it may go on; else somebody wishes to stop."""
        while not self._stop.requested:
            if self._control.pause:
                why_paused, self._given_up_for = self._given_up_for or _BY_OPERATOR, ""
                self.pause(watch, why_paused)
                continue
            why = self._why_not()
            if why is None or self._suspend is None:
                return True
            self._wait_until_right(watch, why, self._suspend)
        return False

    @property
    def is_free(self) -> bool:
        """Whether nothing keeps the run from its next point now."""
        return not (self._stop.requested or self._control.pause) and self._why_not() is None

    def pause(self, watch: Stopwatch, reason: str) -> None:
        """Pause the run until the operator lets it go on, or wishes to stop. Ctrl-C ends it at once."""
        self._control.hold()
        self._hold(State.PAUSED, reason, f"go on with: evs-bench continue {self._folder}")
        with watch.standing(), self._stop.idle():
            while self._control.pause and not self._stop.requested:
                time.sleep(_LOOK_S)
        self.touched = True
        self._let_go()

    def _wait_until_right(self, watch: Stopwatch, why: str, suspend: Suspend) -> None:
        """Suspend the run until nothing is against it, or it is given up."""
        clock = self._station.clock
        begin_s = clock.now()
        self._hold(State.SUSPENDED, why, "it goes on by itself")
        with watch.standing(), self._stop.idle():
            while not self._given_up(clock.now() - begin_s, why, suspend) and self._sleep(suspend.check_every_s):
                now = self._why_not()
                if now is None:
                    break
                why = now
        self._let_go()

    def _conditions(self, folder: Path, dark_rate: Callable[[], tuple[int, float]]) -> tuple[Suspender, ...]:
        if self._suspend is None:
            return ()

        def in_the_dark() -> tuple[int, float]:
            self.touched = True
            return dark_rate()

        return suspenders_of(self._suspend, self._station, folder, in_the_dark)

    def _given_up(self, waited_s: float, why: str, suspend: Suspend) -> bool:
        """Pause or end the run if it was suspended for too long; return whether it was."""
        if waited_s < suspend.give_up_after_s:
            return False
        text = f"suspended for {waited_s:.0f} s, and given up: {why}"
        if suspend.then == "pause":
            self._given_up_for = text
            self._control.hold()
        else:
            self._stop.reason = text
            self._stop.request()
        return True

    def _sleep(self, seconds: float) -> bool:
        """Let time pass on the station's clock; return False as soon as the operator wishes something."""
        clock = self._station.clock
        until_s = clock.now() + seconds
        while not (self._stop.requested or self._control.pause):
            left_s = until_s - clock.now()
            if left_s <= 0.0:
                return True
            clock.sleep(min(left_s, _SLICE_S))
        return False

    def _why_not(self) -> str | None:
        reasons = [why for suspender in self._suspenders if (why := suspender.why()) is not None]
        return "; ".join(reasons) or None

    def _hold(self, state: State, reason: str, advice: str) -> None:
        self._station.safe_state()
        self._course.go(state, reason)
        self._progress.message(f"{state}: {reason}; {advice}")
        if isinstance(self._progress, HoldListener):
            self._progress.held(str(state), reason)
        for error in self._station.unsafe:
            self._progress.message(str(error))

    def _let_go(self) -> None:
        """Say so, unless the run ends now."""
        if not self._stop.requested:
            self._course.go(State.IDLE)
            self._progress.message("going on")
            if isinstance(self._progress, HoldListener):
                self._progress.going_on()
