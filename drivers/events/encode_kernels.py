"""Kernel of the EVT3 encoder."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from drivers.jit import njit

if TYPE_CHECKING:
    from drivers.events.layout_kernels import Int

__all__ = ["LAST_HIGH", "LAST_LOW", "LAST_ROW", "NEXT_BASE", "STATE_SIZE", "encode"]

# State that lives from one call to the next, int64; -1 where nothing was sent yet.
LAST_HIGH: Final = 0  #: TIME_HIGH, without the limit of 12 bits
LAST_LOW: Final = 1
LAST_ROW: Final = 2
NEXT_BASE: Final = 3  #: column and polarity of the next vector, as in VECT_BASE_X
STATE_SIZE: Final = 4

#: So many events or more of 32 columns are shorter as a base and three vector words than one by one.
_LEAST_IN_VECTOR: Final = 5


@njit(cache=True, nogil=True)
def encode(events: Any, triggers: Any, width: Int, state: Any, words: Any) -> Any:
    """Encode events and triggers in the order of their time, and return how many words were written.

    Parameters
    ----------
    events, triggers
        Each ascending in time; a trigger goes ahead of the events of the same microsecond.
    width
        Of the sensor: a vector must not reach over its edge.
    state
        (STATE_SIZE,) int64, brought up to date.
    words
        uint16, long enough.
    """
    n = 0
    i = 0
    k = 0
    while i < len(events) or k < len(triggers):
        if k < len(triggers) and (i == len(events) or triggers[k].t <= events[i].t):
            n = _put_time(triggers[k].t, state, words, n)
            words[n] = 0xA000 | np.int64(triggers[k].id) << 8 | np.int64(triggers[k].p)
            n += 1
            k += 1
            continue
        n = _put_time(events[i].t, state, words, n)
        row = np.int64(events[i].y)
        if row != state[LAST_ROW]:
            state[LAST_ROW] = row
            words[n] = row
            n += 1
        together, mask = _group(events, i)
        if together >= _LEAST_IN_VECTOR and (events[i].x | 31) < width:
            n = _put_vector(events[i], mask, state, words, n)
            i += together
        else:
            words[n] = 0x2000 | np.int64(events[i].p) << 11 | np.int64(events[i].x)
            n += 1
            i += 1
    return n


@njit(cache=True, nogil=True)
def _put_time(t: Int, state: Any, words: Any, n: Int) -> Any:
    """Write the time words that lead to `t`: each TIME_HIGH in between, and TIME_LOW if it changes."""
    while state[LAST_HIGH] < t >> 12:
        state[LAST_HIGH] += 1
        state[LAST_LOW] = -1
        words[n] = 0x8000 | state[LAST_HIGH] & 0xFFF
        n += 1
    if t & 0xFFF != state[LAST_LOW]:
        state[LAST_LOW] = t & 0xFFF
        words[n] = 0x6000 | t & 0xFFF
        n += 1
    return n


@njit(cache=True, nogil=True)
def _group(events: Any, i: Int) -> Any:
    """Return how many events from `i` on can go into one vector of 32 aligned columns, and their mask."""
    first = events[i]
    mask = np.int64(0)
    k = i
    while (
        k < len(events)
        and events[k].t == first.t
        and events[k].y == first.y
        and events[k].p == first.p
        and events[k].x >> 5 == first.x >> 5
        and mask >> (events[k].x & 31) == 0
    ):
        mask |= np.int64(1) << (events[k].x & 31)
        k += 1
    return k - i, mask


@njit(cache=True, nogil=True)
def _put_vector(event: Any, mask: Int, state: Any, words: Any, n: Int) -> Any:
    """Write 32 columns as VECT_12, VECT_12, VECT_8, after their base if it is not where the last vector ended."""
    base = np.int64(event.p) << 11 | np.int64(event.x) & ~31
    if base != state[NEXT_BASE]:
        words[n] = 0x3000 | base
        n += 1
    state[NEXT_BASE] = base + 32
    words[n] = 0x4000 | mask & 0xFFF
    words[n + 1] = 0x4000 | mask >> 12 & 0xFFF
    words[n + 2] = 0x5000 | mask >> 24
    return n + 3
