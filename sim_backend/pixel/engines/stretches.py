"""Pixels that go through time on their own, side by side in threads, and their events in stretches of time."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from functools import partial
from typing import TYPE_CHECKING, Any, Final, Protocol

import numpy as np

from sim_backend.pixel.engines.readout import TIMED_DTYPE
from sim_backend.pixel.engines.reference import processors

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    from sim_backend.pixel.chain import Chain
    from sim_backend.pixel.engines.readout import Crossings

__all__ = ["UNIT", "Walk", "crossings", "places", "room_for"]

_US_PER_S: Final = 1e6
#: Pixels that one thread takes at a time, and room for their events until they are handed over.
_PIXELS: Final = 256
_ROOM: Final = 16384
#: Stretches last a multiple of so many samples.
UNIT: Final = 16384


class Walk(Protocol):
    """The pixels of one recording on their way through time."""

    chain: Chain
    dt_s: float
    stretch_samples: int  #: events are gathered for so many samples before they are handed over
    order: npt.NDArray[np.int64]  #: the pixels in the order in which events of one time are given

    def prepare(self, first: int, stop: int) -> None:
        """Get ready for a stretch of samples."""

    def advance(self, pixels: slice, stop: int) -> npt.NDArray[np.int64]:
        """Take some pixels to sample `stop` - 1 or beyond.

        Returns
        -------
        Their events, ``(sample * number of all pixels + place in the order) * 2 + polarity``.
        """


def places(chain: Chain) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return the pixels in the order in which events of one time are given, and the place of each in it."""
    order = np.lexsort((chain.x, chain.y))
    place = np.empty(chain.pixels, np.int64)
    place[order] = np.arange(chain.pixels)
    return order, place


def room_for(pixels: int, run: Callable[[int, npt.NDArray[np.int64]], tuple[int, int]]) -> npt.NDArray[np.int64]:
    """Call `run` with the pixel to go on with and room for events, until all pixels are through; return all events.

    `run` returns the pixel to go on with and the number of events.
    """
    room = np.empty(_ROOM, np.int64)
    parts = []
    i = 0
    while i < pixels:
        i, count = run(i, room)
        parts.append(room[:count].copy())
    return np.concatenate(parts)


def crossings(walk: Walk, samples: int, threads: int | None) -> Crossings:
    """Yield the events of each stretch, and the time that nothing later is before, us."""
    pixels = walk.chain.pixels
    length = walk.stretch_samples
    column, row = walk.chain.x[walk.order], walk.chain.y[walk.order]
    parts = [slice(i, min(i + _PIXELS, pixels)) for i in range(0, pixels, _PIXELS)]
    early = np.empty(0, np.int64)  # events beyond the end of a stretch wait for theirs
    workers = max(1, min(threads or processors(), len(parts)))
    # A single worker is this thread: to start another costs more than a short recording.
    with ThreadPoolExecutor(workers) if workers > 1 else nullcontext() as pool:
        for first in range(1, samples, length):
            stop = min(first + length, samples)
            walk.prepare(first, stop)
            advance = partial(walk.advance, stop=stop)
            found = np.concatenate([early, *(pool.map(advance, parts) if pool else map(advance, parts))])
            found.sort()
            due = int(np.searchsorted(found, stop * pixels * 2))
            early = found[due:]
            yield _as_events(found[:due], column, row, walk.dt_s), stop * walk.dt_s * _US_PER_S
    yield np.empty(0, TIMED_DTYPE), math.inf


def _as_events(
    found: npt.NDArray[np.int64], column: npt.NDArray[Any], row: npt.NDArray[Any], dt_s: float
) -> npt.NDArray[np.void]:
    """Return events as the readout takes them.

    Parameters
    ----------
    found
        As :meth:`Walk.advance` returns them, in order.
    column, row
        Of each pixel, in the order in which events of one time are given.
    dt_s
        Length of a sample, s.
    """
    from sim_backend.pixel.engines.readout_kernels import write_events

    events = np.empty(len(found), TIMED_DTYPE)
    write_events(found, column, row, dt_s * _US_PER_S, events)
    return events
