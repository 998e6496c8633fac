"""The clock of a simulated world: time passes only when someone waits."""

from __future__ import annotations

from typing import Final

__all__ = ["NS_PER_S", "VirtualClock", "to_ns"]

NS_PER_S: Final = 1_000_000_000


def to_ns(seconds: float) -> int:
    """Return `seconds` in whole nanoseconds."""
    return round(seconds * NS_PER_S)


class VirtualClock:
    """Time in whole nanoseconds, which passes by waiting alone: a night in it takes as long as its computation.

    Whole numbers keep the difference of two times the same however late it is, so that a recording gives the same
    events whenever it is taken.
    """

    def __init__(self) -> None:
        self._now_ns = 0
        self.reads = 0  #: how often a driver looked at it; an emulated instrument can wait until one has

    @property
    def now_ns(self) -> int:
        """Nanoseconds since the world began."""
        return self._now_ns

    def now(self) -> float:
        """Return the seconds since the world began."""
        self.reads += 1
        return self._now_ns / NS_PER_S

    def sleep(self, seconds: float) -> None:
        """Let `seconds` pass; a negative time raises `ValueError`."""
        if not seconds >= 0.0:
            raise ValueError(f"sleep of {seconds} s; expected 0 or more")
        self._now_ns += to_ns(seconds)

    def advance_to(self, time_ns: int) -> None:
        """Let time pass until `time_ns`; a time that is over raises `ValueError`."""
        if time_ns < self._now_ns:
            raise ValueError(f"time cannot go back from {self._now_ns} ns to {time_ns} ns")
        self._now_ns = time_ns
