"""A step that hangs is cut short: a watchdog interrupts it, and it counts as a device that failed.

Drivers have time-outs of their own; this is for what they did not foresee, so that one step cannot eat the night.
"""

from __future__ import annotations

import contextlib
import threading
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

from bench.run.stop import Interruption
from drivers.clock import RealClock
from drivers.errors import DeviceTimeout

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bench.run.plan import PlannedPoint
    from bench.run.stop import StopFlag
    from bench.station import Station
    from protocols.policy import Deadline

__all__ = ["Watchdog", "measuring_s", "preparing_s"]

_LOOK_S: Final = 0.1
#: A virtual clock says nothing of how long the computer needs: there, so many times the limit in real time.
_VIRTUAL: Final = 10.0


@dataclass(frozen=True, slots=True)
class _Step:
    """A step under way, and when it is late, on the station's clock and on the real one."""

    begin_s: float
    limit_s: float
    real_begin_s: float
    real_limit_s: float


class Watchdog:
    """Sees to it that no step takes longer than it may. As a context manager; it has a thread of its own.

    It can interrupt the main thread only: elsewhere, the drivers' own time-outs must do.

    Parameters
    ----------
    deadline
        How long a step may take; None for any time.
    station
        Whose steps they are; its clock counts, and the real one.
    stop
        What interrupts the main thread.
    """

    def __init__(self, deadline: Deadline | None, station: Station, stop: StopFlag) -> None:
        self._deadline = deadline
        self._station = station
        self._stop = stop
        self._patience = 1.0 if isinstance(station.clock, RealClock) else _VIRTUAL
        self._lock = threading.Lock()
        self._step: _Step | None = None
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="evs-bench watchdog", daemon=True)

    def __enter__(self) -> Self:
        """Begin to watch."""
        if self._deadline is not None:
            self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Watch no more."""
        self._over.set()
        if self._deadline is not None:
            self._thread.join()

    @contextlib.contextmanager
    def step(self, what: str, expected_s: float) -> Iterator[None]:
        """Let the block take `expected_s` times the factor, and never less than the protocol says.

        Raises
        ------
        DeviceTimeout
            If it took longer.
        """
        if self._deadline is None:
            yield
            return
        limit_s = max(self._deadline.factor * expected_s, self._deadline.at_least_s)
        try:
            try:
                self._begin(limit_s)
                yield
            finally:
                self._end()
        except Interruption as error:
            raise DeviceTimeout(
                f"station {self._station.name}",
                what,
                f"took longer than {limit_s:.4g} s, and was cut short",
                "see in the log what was done last",
            ) from error

    def _begin(self, limit_s: float) -> None:
        now_s = self._station.clock.now()
        with self._lock:
            self._step = _Step(now_s, limit_s, time.monotonic(), limit_s * self._patience)

    def _end(self) -> None:
        """Forget the step: once the lock is held, the watchdog has either bitten or never will."""
        with self._lock:
            self._step = None
            self._stop.calm()

    def _watch(self) -> None:
        while not self._over.wait(_LOOK_S):
            with self._lock:
                if self._step is not None and self._is_late(self._step):
                    self._step = None
                    self._stop.interrupt(Interruption())

    def _is_late(self, step: _Step) -> bool:
        if time.monotonic() - step.real_begin_s > step.real_limit_s:
            return True
        return self._station.clock.now() - step.begin_s > step.limit_s


def preparing_s(planned: PlannedPoint) -> float:
    """Return how long the devices should need, at most, to get to where a point begins, s."""
    settle = planned.point.settle
    return settle.light_s + settle.filter_s + settle.bias_s


def measuring_s(planned: PlannedPoint) -> float:
    """Return how long the recording of a point takes, s."""
    return planned.waveform.duration_s
