"""Clocks: what a device knows of time, and the real one."""

from __future__ import annotations

import time
from typing import Protocol, runtime_checkable

__all__ = ["Clock", "RealClock"]


@runtime_checkable
class Clock(Protocol):
    """The time a device lives in: the real one, or a simulated world's."""

    def now(self) -> float:
        """Return the time in seconds since an arbitrary start; it never goes back."""

    def sleep(self, seconds: float) -> None:
        """Let `seconds` pass."""


class RealClock:
    """The time of this computer: monotonic, unaffected by changes of the date."""

    def now(self) -> float:
        """Return the time in seconds since an arbitrary start; it never goes back."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Wait for `seconds`; a negative time raises `ValueError`."""
        time.sleep(seconds)
