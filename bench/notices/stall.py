"""Noticing that a run makes no progress, on a monotonic clock."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

__all__ = ["StallWatch"]


class StallWatch:
    """Says, once for each standstill and limit, that a limit is exceeded.

    Parameters
    ----------
    limits_s
        The times without progress that matter, s.
    factor
        How many times its expected length a point may take, where that is longer than a limit.
    now
        A monotonic clock, s.
    """

    def __init__(self, limits_s: Sequence[float], factor: float, now: Callable[[], float] = time.monotonic) -> None:
        self._limits_s = tuple(limits_s)
        self._factor = factor
        self._now = now
        self._lock = threading.Lock()
        self._since_s: float | None = None  # None: nothing is expected to happen
        self._expected_s = 0.0
        self._told: set[int] = set()

    def progressed(self, expected_s: float = 0.0) -> None:
        """Take note that something new has begun, which is expected to take `expected_s`."""
        with self._lock:
            self._since_s, self._expected_s = self._now(), expected_s
            self._told.clear()

    def rest(self) -> None:
        """Expect nothing until the next progress: the run is paused, or over."""
        with self._lock:
            self._since_s = None

    def overdue(self) -> list[tuple[int, float]]:
        """Return the limits that are exceeded and were not returned yet: their number, and how long nothing came."""
        with self._lock:
            if self._since_s is None:
                return []
            passed_s = self._now() - self._since_s
            found = [
                (number, passed_s)
                for number, limit_s in enumerate(self._limits_s)
                if number not in self._told and passed_s > max(limit_s, self._factor * self._expected_s)
            ]
            self._told.update(number for number, _ in found)
            return found
