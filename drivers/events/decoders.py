"""Decoders of the event streams that sensors send: bytes in, chunks of events out.

A decoder keeps its state from one call of :meth:`Decoder.feed` to the next, so the bytes may be cut anywhere. What
breaks the rules of a format is counted (:attr:`Decoder.violations`) and decoding goes on.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Final

import numpy as np

from drivers.events import layout_kernels as at
from drivers.events.types import EVENT_DTYPE, TRIGGER_DTYPE, EventChunk, empty_events, empty_triggers

if TYPE_CHECKING:
    from types import ModuleType

    import numpy.typing as npt

__all__ = ["DatDecoder", "Decoder", "ErcCounts", "Evt2Decoder", "Evt3Decoder", "Evt21Decoder"]

_NOTHING: Final = EventChunk(empty_events(), empty_triggers())


@dataclass(frozen=True, slots=True)
class ErcCounts:
    """What the sensor says of its event-rate controller: sums of the numbers it reported so far."""

    n_before: int  #: number of reports of events before the controller
    before: int  #: events before the controller
    n_after: int
    after: int  #: events after the controller


class Decoder(ABC):
    """What all decoders have in common.

    Parameters
    ----------
    width, height
        Size of the sensor; events outside are dropped and counted. None if unknown: then everything that the fields
        of the format can hold is allowed.
    """

    word_bytes: ClassVar[int]  #: bytes of one word
    largest_size: ClassVar[int] = 1 << 11  #: columns or rows that the fields of the format can hold
    _columns: ClassVar[int] = 0  #: columns into which words are cut, 0 for none
    _dtype: ClassVar[np.dtype[Any]]

    def __init__(self, width: int | None = None, height: int | None = None) -> None:
        self.width = self.largest_size if width is None else width
        self.height = self.largest_size if height is None else height
        for name, size in (("width", self.width), ("height", self.height)):
            if not 1 <= size <= self.largest_size:
                raise ValueError(f"{name} of the sensor is {size}; expected 1 to {self.largest_size}")
        self._kernels = self._import_kernels()
        self._rest = b""
        self._word_types = np.zeros(16, np.int64)
        self._violations = np.zeros(len(at.VIOLATION_NAMES), np.int64)
        self._state = np.zeros(at.STATE_SIZE, np.int64)
        self._state[[at.TIME_HIGH, at.ROW, at.BASE]] = -1

    def feed(self, data: bytes | bytearray | memoryview | npt.NDArray[Any]) -> EventChunk:
        """Decode more of the stream, and return all events that are complete by now.

        Parameters
        ----------
        data
            The next bytes, any number of them. They are not kept.
        """
        raw = _bytes_of(data)
        if self._rest:
            raw = self._rest + raw
        size = len(raw) // self.word_bytes * self.word_bytes
        self._rest = bytes(raw[size:]) if size < len(raw) else b""
        if size == 0:
            return _NOTHING
        words = np.frombuffer(raw, self._dtype, size // self._dtype.itemsize)
        return self._decode(words.reshape(-1, self._columns) if self._columns else words)

    def finish(self) -> None:
        """Tell the decoder that the stream is over: what has begun and is not whole is counted.

        No event is ever held back, so nothing comes out. What is fed after this is a new part of the same stream.
        """
        self._violations[at.TORN_WORD] += bool(self._rest)
        self._rest = b""
        pending = self._state[at.PENDING]
        self._violations[at.PARTIAL_VECTOR] += pending in (at.VECTOR_1, at.VECTOR_2)
        self._violations[at.PARTIAL_CONTINUED] += pending in (at.COUNT_0, at.COUNT_1, at.COUNT_2)
        self._state[at.PENDING] = at.NOTHING

    @property
    def violations(self) -> dict[str, int]:
        """How often each rule was broken so far, zeros included; events that were dropped count one by one."""
        return dict(zip(at.VIOLATION_NAMES, self._violations.tolist(), strict=True))

    @property
    def word_types(self) -> dict[int, int]:
        """Number of words of each type that was seen."""
        return {kind: n for kind, n in enumerate(self._word_types.tolist()) if n}

    @property
    def erc_counts(self) -> ErcCounts:
        """What the sensor said so far of its event-rate controller; all 0 if it did not, or the format cannot."""
        state = self._state
        return ErcCounts(*(int(state[i]) for i in (at.N_BEFORE_ERC, at.BEFORE_ERC, at.N_AFTER_ERC, at.AFTER_ERC)))

    @staticmethod
    def _import_kernels() -> ModuleType:
        """Return the module with the kernels; it is imported here, because it brings numba."""
        from drivers.events import evt2_kernels

        return evt2_kernels

    @abstractmethod
    def _decode(self, words: npt.NDArray[Any]) -> EventChunk:
        """Decode whole words."""


def _bytes_of(data: bytes | bytearray | memoryview | npt.NDArray[Any]) -> bytes:
    """Return the bytes of a buffer as an object that is aligned and read only: the kernels are compiled for that."""
    if isinstance(data, bytes):
        return data
    together: Any = np.ascontiguousarray(data)
    return bytes(memoryview(together).cast("B"))


def _outputs(n_events: int, n_triggers: int) -> tuple[npt.NDArray[np.void], npt.NDArray[np.void]]:
    """Return arrays to decode into; empty ones are shared, so that small chunks cost little."""
    events = np.empty(n_events, EVENT_DTYPE) if n_events else _NOTHING.events
    triggers = np.empty(n_triggers, TRIGGER_DTYPE) if n_triggers else _NOTHING.triggers
    return events, triggers


def _chunk(
    events: npt.NDArray[np.void], n_events: int, triggers: npt.NDArray[np.void], n_triggers: int
) -> EventChunk:
    """Return as much of the arrays as was written."""
    if n_events == 0 and n_triggers == 0:
        return _NOTHING
    return EventChunk(events[:n_events], triggers[:n_triggers])


class Evt3Decoder(Decoder):
    """Decoder of EVT3, 16-bit words.

    Parameters
    ----------
    width, height
        Size of the sensor, or None.
    """

    word_bytes = 2
    _dtype = np.dtype("<u2")

    @staticmethod
    def _import_kernels() -> ModuleType:
        from drivers.events import evt3_kernels

        return evt3_kernels

    def _decode(self, words: npt.NDArray[Any]) -> EventChunk:
        events, triggers = _outputs(*self._kernels.count(words, self._word_types))
        n_events, n_triggers = self._kernels.decode(
            words, self.width, self.height, self._state, self._violations, events, triggers
        )
        return _chunk(events, n_events, triggers, n_triggers)


class Evt2Decoder(Decoder):
    """Decoder of EVT2, 32-bit words.

    Parameters
    ----------
    width, height
        Size of the sensor, or None.
    """

    word_bytes = 4
    _dtype = np.dtype("<u4")

    def _decode(self, words: npt.NDArray[Any]) -> EventChunk:
        events, triggers = _outputs(*self._kernels.count_evt2(words, self._word_types))
        n_events, n_triggers = self._kernels.decode_evt2(
            words, self.width, self.height, self._state, self._violations, events, triggers
        )
        return _chunk(events, n_events, triggers, n_triggers)


class Evt21Decoder(Decoder):
    """Decoder of EVT2.1, 64-bit words.

    Parameters
    ----------
    width, height
        Size of the sensor, or None.
    legacy
        Whether the upper half of each word comes first, as the IMX636 sends it, instead of the lower one.
    """

    word_bytes = 8
    _dtype = np.dtype("<u4")
    _columns = 2

    def __init__(self, width: int | None = None, height: int | None = None, *, legacy: bool = False) -> None:
        super().__init__(width, height)
        self.legacy = legacy

    def _decode(self, words: npt.NDArray[Any]) -> EventChunk:
        upper = 0 if self.legacy else 1
        events, triggers = _outputs(*self._kernels.count_evt21(words, upper, self._word_types))
        n_events, n_triggers = self._kernels.decode_evt21(
            words, upper, self.width, self.height, self._state, self._violations, events, triggers
        )
        return _chunk(events, n_events, triggers, n_triggers)


class DatDecoder(Decoder):
    """Decoder of the records of a DAT file, 64 bits each.

    Parameters
    ----------
    width, height
        Size of the sensor, or None.
    triggers
        Whether the records are external triggers instead of events; the file says so ahead of them.
    """

    word_bytes = 8
    largest_size = 1 << 14
    _dtype = np.dtype("<u4")
    _columns = 2

    def __init__(self, width: int | None = None, height: int | None = None, *, triggers: bool = False) -> None:
        super().__init__(width, height)
        self.triggers = triggers

    def _decode(self, words: npt.NDArray[Any]) -> EventChunk:
        events, triggers = _outputs(0, len(words)) if self.triggers else _outputs(len(words), 0)
        if self.triggers:
            self._kernels.decode_dat_triggers(words, self._state, self._violations, triggers)
            return _chunk(events, 0, triggers, len(words))
        n = self._kernels.decode_dat_events(words, self.width, self.height, self._state, self._violations, events)
        return _chunk(events, n, triggers, 0)
