"""The real clock."""

from __future__ import annotations

import time

__all__ = ["RealClock"]


class RealClock:
    """The time of this computer: monotonic, unaffected by changes of the date."""

    def now(self) -> float:
        """Return the time in seconds since an arbitrary start; it never goes back."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Wait for `seconds`; a negative time raises `ValueError`."""
        time.sleep(seconds)
