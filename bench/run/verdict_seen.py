"""What a verdict needs of the events of a point, gathered while they pass."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from drivers.events.types import EventChunk
    from protocols.points import Roi

__all__ = ["Seen"]

_BIN_US: Final = 1000
_FIRST_BINS: Final = 1 << 12
#: With more bins than these, two become one: 17 minutes in bins of 1 ms, 8 MB.
_MOST_BINS: Final = 1 << 20


class Seen:
    """Counts of the events of one point: of each pixel, of each polarity over time, and the triggers.

    The memory does not grow with the number of events: a bin of time is 1 ms in the first 17 minutes of a recording
    and becomes longer with the recording.

    Parameters
    ----------
    roi
        The window of the point; events outside it are counted as such.

    Attributes
    ----------
    bin_us
        Width of a bin of time, us.
    """

    def __init__(self, roi: Roi) -> None:
        self.roi = roi
        self.bin_us = _BIN_US
        self._pixels = np.zeros((roi.height + 1, roi.width), np.int64)
        self._bins = np.zeros((2, _FIRST_BINS), np.uint32)
        self._polarities: list[npt.NDArray[np.uint8]] = []

    def add(self, chunk: EventChunk) -> None:
        """Count the events and triggers of the next chunk."""
        if len(chunk.triggers):
            self._polarities.append(np.ascontiguousarray(chunk.triggers["p"]))
        if len(chunk.events):
            self._count(chunk.events)

    def _count(self, events: npt.NDArray[np.void]) -> None:
        from bench.run.verdict_kernels import count_events

        t, x, y, p = (events[name] for name in ("t", "x", "y", "p"))
        done = 0
        while True:
            done = count_events(t, x, y, p, done, self.bin_us, self.roi.x, self.roi.y, self._pixels, self._bins)
            if done == len(t):
                break
            self._reach(int(t[done]))

    def _reach(self, t_us: int) -> None:
        """Make bins until that of `t_us`, or longer ones."""
        while t_us // self.bin_us >= _MOST_BINS:
            self._bins = self._bins.reshape(2, -1, 2).sum(axis=2, dtype=np.uint32)
            self.bin_us *= 2
        size = self._bins.shape[1]
        while size <= t_us // self.bin_us:
            size *= 2
        self._bins = np.pad(self._bins, ((0, 0), (0, size - self._bins.shape[1])))

    @property
    def n_events(self) -> int:
        """All events, those outside the window too."""
        return int(self._pixels.sum())

    @property
    def n_outside(self) -> int:
        """Events outside the window."""
        return int(self._pixels[-1, 0])

    @property
    def n_triggers(self) -> int:
        """Edges at the trigger inputs."""
        return sum(len(part) for part in self._polarities)

    @property
    def trigger_p(self) -> npt.NDArray[np.uint8]:
        """Polarities of the triggers in the order in which they came (n,), 1 = rising."""
        return np.concatenate(self._polarities) if self._polarities else np.empty(0, np.uint8)

    @property
    def pixels(self) -> npt.NDArray[np.int64]:
        """Events of each pixel of the window, (height, width)."""
        return self._pixels[:-1]

    def binned(self, duration_s: float) -> npt.NDArray[np.uint32]:
        """Return OFF and ON events in bins of `bin_us`, (2, n), from 0 to `duration_s`; what is later is left out."""
        wanted = max(1, round(duration_s * 1e6 / self.bin_us))
        found = self._bins[:, :wanted]
        return np.pad(found, ((0, 0), (0, wanted - found.shape[1])))

    def per_second(self, duration_s: float) -> npt.NDArray[np.int64]:
        """Return OFF and ON events of each second that has begun within `duration_s`, (2, seconds)."""
        seconds = np.arange(int(np.ceil(duration_s)) + 1, dtype=np.float64)
        return np.rint(self.between(seconds[:-1], seconds[1:])).astype(np.int64)

    def between(self, start_s: npt.NDArray[np.float64], stop_s: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return OFF and ON events between times (k,), (2, k); bins that a limit cuts count in part."""
        sums = np.zeros((2, self._bins.shape[1] + 1))
        np.cumsum(self._bins, axis=1, out=sums[:, 1:], dtype=np.float64)
        at = np.arange(sums.shape[1], dtype=np.float64) * self.bin_us
        until = [np.stack([np.interp(1e6 * t_s, at, one) for one in sums]) for t_s in (start_s, stop_s)]
        return np.asarray(until[1] - until[0])
