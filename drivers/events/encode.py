"""Encoder of EVT3: events in, the words out that a sensor would send. For emulated cameras and for tests."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from drivers.events.types import EVENT_DTYPE, TRIGGER_DTYPE, empty_triggers

if TYPE_CHECKING:
    import numpy.typing as npt

__all__ = ["Evt3Encoder", "raw_header"]


class Evt3Encoder:
    """Encodes a stream of events piece by piece; the stream begins at time 0.

    Events of one row, polarity and time whose columns ascend are put into vectors where that is shorter.

    Parameters
    ----------
    width, height
        Size of the sensor, pixels, at most 2048.
    """

    def __init__(self, width: int, height: int) -> None:
        if not (1 <= width <= 2048 and 1 <= height <= 2048):
            raise ValueError(f"sensor is {width} x {height}; EVT3 can hold 1 to 2048 columns and rows")
        self.width = width
        self.height = height
        self._state: npt.NDArray[np.int64] | None = None
        self._last_t = 0

    def feed(self, events: npt.NDArray[np.void], triggers: npt.NDArray[np.void] | None = None) -> bytes:
        """Encode the next events and triggers.

        Parameters
        ----------
        events, triggers
            Arrays of EVENT_DTYPE and TRIGGER_DTYPE, each ascending in time, and not before what was fed last.

        Raises
        ------
        ValueError
            If a time goes back or is negative, or a pixel or a channel is outside what can be encoded.
        """
        from drivers.events import encode_kernels

        if self._state is None:
            self._state = np.full(encode_kernels.STATE_SIZE, -1, np.int64)
        events = np.ascontiguousarray(events, EVENT_DTYPE)
        triggers = empty_triggers() if triggers is None else np.ascontiguousarray(triggers, TRIGGER_DTYPE)
        self._require_encodable(events, triggers)
        last_t = max((int(array["t"][-1]) for array in (events, triggers) if len(array)), default=self._last_t)
        n_time_high = (last_t >> 12) - int(self._state[encode_kernels.LAST_HIGH])
        words = np.empty(3 * len(events) + 2 * len(triggers) + n_time_high, "<u2")
        n = encode_kernels.encode(events, triggers, self.width, self._state, words)
        self._last_t = last_t
        return words[:n].tobytes()

    def _require_encodable(self, events: npt.NDArray[np.void], triggers: npt.NDArray[np.void]) -> None:
        for name, array in (("events", events), ("triggers", triggers)):
            if len(array) and (array["t"][0] < self._last_t or np.any(np.diff(array["t"]) < 0)):
                raise ValueError(f"{name} go back in time; expected ascending times from {self._last_t} us on")
        if np.any(events["x"] >= self.width) or np.any(events["y"] >= self.height) or np.any(events["p"] > 1):
            raise ValueError(f"events outside of {self.width} x {self.height} pixels, or with a polarity over 1")
        if np.any(triggers["id"] > 15) or np.any(triggers["p"] > 1):
            raise ValueError("triggers of a channel over 15, or with a polarity over 1")


def raw_header(width: int, height: int) -> bytes:
    """Return the text that makes a RAW file of EVT3 words put behind it."""
    lines = ("evt 3.0", f"format EVT3;height={height};width={width}", f"geometry {width}x{height}", "end")
    return "".join(f"% {line}\n" for line in lines).encode()
