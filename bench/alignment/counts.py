"""Events of a recording counted in short bins as they pass by: what an alignment by events needs of them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from protocols.errors import InputError

if TYPE_CHECKING:
    import numpy.typing as npt

__all__ = ["BIN_S", "EventCounts"]

BIN_S: Final = 5e-5  #: a quarter of the accuracy that is wanted of an edge
_BIN_US: Final = 50
_FIRST_BINS: Final = 1 << 16


class EventCounts:
    """ON and OFF events of the whole window in bins of 50 us.

    The memory grows with the length of the recording, not with its events.
    """

    def __init__(self) -> None:
        self._counts = np.zeros((2, _FIRST_BINS), np.uint32)
        self._used = 0

    @classmethod
    def of(cls, t_us: npt.NDArray[np.int64], p: npt.NDArray[np.uint8]) -> EventCounts:
        """Return the counts of events whose times (us) and polarities (1 = ON, 0 = OFF) are all there."""
        counts = cls()
        counts.add(t_us, p)
        return counts

    def add(self, t_us: npt.NDArray[np.int64], p: npt.NDArray[np.uint8]) -> None:
        """Count the next events, in any order; times in us since the start of the recording, 0 or more."""
        if not len(t_us):
            return
        first, last = int(t_us.min()), int(t_us.max())
        if first < 0:
            raise InputError(f"event counts: an event at {first} us; expected 0 or later")
        self._used = max(self._used, last // _BIN_US + 1)
        self._reach(self._used)
        base = first // _BIN_US
        bins = np.asarray(t_us // _BIN_US - base)
        for polarity in (0, 1):
            counted = np.bincount(bins[p == polarity]).astype(np.uint32)
            self._counts[polarity, base : base + len(counted)] += counted

    def _reach(self, bins: int) -> None:
        """Make room for so many bins."""
        if bins > self._counts.shape[1]:
            size = max(2 * self._counts.shape[1], bins)
            grown = np.zeros((2, size), np.uint32)
            grown[:, : self._counts.shape[1]] = self._counts
            self._counts = grown

    @property
    def duration_s(self) -> float:
        """End of the last bin with an event, s; 0 without events."""
        return self._used * BIN_S

    def binned(self, factor: int = 1, duration_s: float = 0.0) -> npt.NDArray[np.uint32]:
        """Return the OFF and ON events in bins of `factor` times 50 us, (2, n), reaching to `duration_s` at least."""
        whole = -(-max(self._used, round(duration_s / BIN_S)) // factor)
        self._reach(whole * factor)
        counted = self._counts[:, : whole * factor]
        # Long recordings have many bins: they are not copied where that can be helped.
        return counted if factor == 1 else counted.reshape(2, whole, factor).sum(axis=2, dtype=np.uint32)
