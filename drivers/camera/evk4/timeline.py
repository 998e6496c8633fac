"""From the bytes of a recording to events on its own time axis, and what is known to be missing from it.

The camera counts time in steps of 4096 us (TIME_HIGH) and us within them, and says each step at least once, whether
there are events or not. So a step that is left out is a stretch of the stream that was lost: the sensor or its
controller had no room. What comes after such a place, or after transfers that the computer dropped, is decoded
afresh: rows and columns from before it would put events where they never were.

Time 0 is the first step that is seen. Whether the camera's own count begins at 0 with each recording does not matter;
where it goes on from the recording before, time 0 is up to 4.1 ms before the start.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from drivers.camera.evk4.spool import Lost
from drivers.events.decoders import Evt3Decoder

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

    from drivers.events.types import EventChunk

__all__ = ["STEP_US", "Timeline"]

STEP_US: Final = 4096  #: microseconds of a TIME_HIGH

_TIME_HIGH: Final = 0x8
_STEPS: Final = 4096  # until TIME_HIGH begins anew
_MOST_BACK: Final = _STEPS // 2 - 1  # steps; what looks like more is a rollover


class Timeline:
    """Decodes one recording.

    Parameters
    ----------
    width, height
        Size of the sensor, pixels.
    trigger_inverted
        Whether the camera's trigger input turns edges round.

    Attributes
    ----------
    overflows
        How often the camera left out steps of time.
    gaps_us
        Start and stop of each stretch from which events are missing, us.
    """

    def __init__(self, width: int, height: int, *, trigger_inverted: bool = False) -> None:
        self.overflows = 0
        self.gaps_us: list[tuple[int, int]] = []
        self._size = (width, height)
        self._inverted = trigger_inverted
        self._counted = 0  # violations, without those that the decoder still has
        self._decoder: Evt3Decoder | None = None  # None until a TIME_HIGH says when it is
        self._offset_us = 0  # from the decoder's time to that of the recording
        self._rest = b""
        self._skip = 0  # bytes of a word whose other byte was lost
        self._origin: int | None = None  # the first step
        self._step = 0  # the last one, counted on beyond its 12 bits
        self._lost: Lost | None = None

    @property
    def violations(self) -> int:
        """What broke the rules of the format so far; each event that was dropped for it counts."""
        return self._counted + (sum(self._decoder.violations.values()) if self._decoder else 0)

    def feed(self, data: bytes) -> Iterator[EventChunk]:
        """Yield the events and triggers in the next bytes of the stream, which may be cut anywhere."""
        raw = self._rest + data[self._skip :] if self._rest or self._skip else data
        self._skip = 0
        n = len(raw) // 2
        self._rest = raw[2 * n :]
        words = np.frombuffer(raw, "<u2", n)
        places = np.flatnonzero(words >> 12 == _TIME_HIGH)
        steps = (words[places] & 0xFFF).astype(np.int64)
        changes = _changes(self._step, steps)
        begin, done = 0, 0
        for k in self._breaks(changes):
            yield from self._decode(raw, begin, int(places[k]))
            self._step += int(changes[done:k].sum())
            self._begin_anew(int(steps[k]), int(changes[k]))
            begin, done = int(places[k]), k + 1
        yield from self._decode(raw, begin, n)
        self._step += int(changes[done:].sum())

    def lose(self, lost: Lost) -> None:
        """Take note that bytes are missing before those that are fed next."""
        seconds = lost.seconds + (self._lost.seconds if self._lost else 0.0)
        self._lost = Lost(lost.transfers, lost.size, seconds)
        self._skip = (len(self._rest) + lost.size) % 2
        self._rest = b""
        self._end_decoder()

    def finish(self, duration_s: float, tolerance_s: float) -> None:
        """Take note that the stream is over.

        Parameters
        ----------
        duration_s
            How long the recording was, s. A stream that says less is missing its end.
        tolerance_s
            How far the two may be apart, s.
        """
        self._counted += bool(self._rest)
        self._rest = b""
        self._end_decoder()
        begin_us, end_us = self._us(self._step), round(duration_s * 1e6)
        if self._lost is not None or begin_us + STEP_US < end_us - tolerance_s * 1e6:
            self.gaps_us.append((begin_us, max(end_us, begin_us + STEP_US)))
            self._lost = None

    def _breaks(self, changes: npt.NDArray[np.int64]) -> list[int]:
        """Return at which steps time does not simply go on."""
        breaks = np.flatnonzero((changes < 0) | (changes > 1)).tolist()
        if self._decoder is None and len(changes) and breaks[:1] != [0]:
            breaks.insert(0, 0)
        return [int(k) for k in breaks]

    def _begin_anew(self, step: int, change: int) -> None:
        """Go on with a step that does not follow the one before."""
        before = self._step
        if self._origin is None:
            self._origin = before = self._step = step
        elif self._lost is not None:
            self._step += self._steps_until(step, self._lost)
        else:
            self._step += change
            if change > 1:
                self.overflows += 1
                self.gaps_us.append((self._us(before), self._us(self._step)))
            else:
                self._counted += 1
        if self._lost is not None:  # in which part of its step the stream goes on is not known
            self.gaps_us.append((self._us(before), self._us(self._step + 1)))
            self._lost = None
        self._end_decoder()
        self._decoder = Evt3Decoder(*self._size)
        self._offset_us = self._us(self._step) - step * STEP_US

    def _steps_until(self, step: int, lost: Lost) -> int:
        """Return how many steps passed until `step`, which is known but for rollovers, by the computer's clock."""
        least = (step - self._step) % _STEPS
        return least + _STEPS * max(round((lost.seconds * 1e6 / STEP_US - least) / _STEPS), 0)

    def _decode(self, raw: bytes, begin: int, end: int) -> Iterator[EventChunk]:
        """Yield what the words from `begin` to before `end` hold."""
        if begin == end:
            return
        if self._decoder is None:
            self._counted += end - begin if self._origin is None else 0  # else they are in a gap
            return
        chunk = self._decoder.feed(raw[2 * begin : 2 * end])
        if len(chunk.events) == 0 and len(chunk.triggers) == 0:
            return
        if self._offset_us:
            chunk.events["t"] += self._offset_us
            chunk.triggers["t"] += self._offset_us
        if self._inverted:
            chunk.triggers["p"] ^= 1
        yield chunk

    def _end_decoder(self) -> None:
        """Count what the decoder found, and let go of it."""
        if self._decoder is not None:
            self._decoder.finish()
            self._counted += sum(self._decoder.violations.values())
            self._decoder = None

    def _us(self, step: int) -> int:
        """Return when a step begins on the time axis of the recording."""
        return 0 if self._origin is None else (step - self._origin) * STEP_US


def _changes(last: int, steps: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Return by how much each step differs from the one before it, a rollover taken into account."""
    return (np.diff(steps, prepend=last) + _MOST_BACK) % _STEPS - _MOST_BACK
