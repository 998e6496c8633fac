"""The event stream as every part of the bench sees it: chunks of two structured arrays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

__all__ = ["EVENT_DTYPE", "TRIGGER_DTYPE", "EventChunk", "empty_events", "empty_triggers"]

#: One event: time in us, column, row, polarity (1 = ON, 0 = OFF).
EVENT_DTYPE: Final = np.dtype([("t", "<i8"), ("x", "<u2"), ("y", "<u2"), ("p", "u1")])

#: One edge at an external trigger input: time in us, polarity (1 = rising, 0 = falling), channel.
TRIGGER_DTYPE: Final = np.dtype([("t", "<i8"), ("p", "u1"), ("id", "u1")])


def empty_events() -> npt.NDArray[np.void]:
    """Return an empty array of :data:`EVENT_DTYPE`."""
    return np.empty(0, EVENT_DTYPE)


def empty_triggers() -> npt.NDArray[np.void]:
    """Return an empty array of :data:`TRIGGER_DTYPE`."""
    return np.empty(0, TRIGGER_DTYPE)


@dataclass(frozen=True, slots=True)
class EventChunk:
    """A stretch of an event stream, in the order in which the sensor sent it."""

    events: npt.NDArray[np.void]  #: (n,) of EVENT_DTYPE
    triggers: npt.NDArray[np.void]  #: (m,) of TRIGGER_DTYPE
