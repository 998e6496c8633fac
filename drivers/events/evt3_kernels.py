"""Kernels of EVT3: 16-bit words whose upper four bits are their type.

The rules are those that agree with recordings of real sensors:

- nothing is an event before the first TIME_HIGH, but rows and vector bases are kept;
- a TIME_HIGH that differs from the one before sets the low part of the time to 0, a repeated one leaves it;
- a TIME_HIGH smaller by half the range or more is a rollover, one smaller by less is damage;
- the last TIME_LOW holds, even if it goes back: sensors send one early and correct it;
- vectors take their polarity from VECT_BASE_X, and ADDR_X does not move the base.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from drivers.events import layout_kernels as at
from drivers.jit import njit

if TYPE_CHECKING:
    from drivers.events.layout_kernels import Int

__all__ = ["count", "decode"]

ADDR_Y: Final = 0x0
ADDR_X: Final = 0x2
VECT_BASE_X: Final = 0x3
VECT_12: Final = 0x4
VECT_8: Final = 0x5
TIME_LOW: Final = 0x6
CONTINUED_4: Final = 0x7
TIME_HIGH: Final = 0x8
EXT_TRIGGER: Final = 0xA
IMU: Final = 0xD
OTHERS: Final = 0xE
CONTINUED_12: Final = 0xF

_HALF_RANGE: Final = 1 << 11  #: of TIME_HIGH


def _events_of_words() -> Any:
    """Return how many events each of the 65536 words is, (65536,) uint8."""
    words = np.arange(1 << 16)
    events = np.where(words >> 12 == ADDR_X, 1, 0)
    events += np.where(words >> 12 == VECT_12, np.bitwise_count(words & 0xFFF), 0)
    events += np.where(words >> 12 == VECT_8, np.bitwise_count(words & 0xFF), 0)
    return events.astype(np.uint8)


_EVENTS_OF_WORD: Final = _events_of_words()

# The place of the only bit that is set in a 32-bit number, by a de Bruijn sequence: a product with 2**k brings
# other five bits to the top for each k.
_DE_BRUIJN: Final = 0x077CB531


def _places_of_bits() -> Any:
    """Return the table from the upper five bits of `_DE_BRUIJN` << k to k, (32,) int64."""
    places = np.empty(32, np.int64)
    for k in range(32):
        places[(_DE_BRUIJN << k & 0xFFFFFFFF) >> 27] = k
    return places


_PLACE_OF_BIT: Final = _places_of_bits()


@njit(cache=True, nogil=True)
def count(words: Any, word_types: Any) -> Any:
    """Count the types of words, and return the most events and triggers that they can hold.

    Parameters
    ----------
    words
        (n,) uint16
    word_types
        (16,) int64; the types found are added to it.
    """
    # Two tables in turn: words of one type often follow each other, and would wait for each other's sum.
    even = np.zeros(16, np.int64)
    odd = np.zeros(16, np.int64)
    events = np.int64(0)
    n = len(words)
    for i in range(0, n - 1, 2):
        even[words[i] >> 12] += 1
        odd[words[i + 1] >> 12] += 1
        events += np.int64(_EVENTS_OF_WORD[words[i]]) + np.int64(_EVENTS_OF_WORD[words[i + 1]])
    if n % 2:
        even[words[n - 1] >> 12] += 1
        events += np.int64(_EVENTS_OF_WORD[words[n - 1]])
    for kind in range(16):
        even[kind] += odd[kind]
        word_types[kind] += even[kind]
    return events, even[EXT_TRIGGER]


@njit(cache=True, nogil=True)
def decode(words: Any, width: Int, height: Int, state: Any, violations: Any, events: Any, triggers: Any) -> Any:
    """Decode words, and return how many events and triggers were written.

    Parameters
    ----------
    words
        (n,) uint16
    width, height
        Of the sensor; events outside are dropped and counted.
    state, violations
        int64 arrays as :mod:`drivers.events.layout_kernels` lays them out; brought up to date.
    events, triggers
        Written from the start; as long as :func:`count` says, or longer.
    """
    n_events = 0
    n_triggers = 0
    start = state[at.LOOPS] << 24 | state[at.TIME_HIGH] << 12
    t = start | state[at.TIME_LOW]
    row = state[at.ROW]
    in_row = state[at.TIME_HIGH] >= 0 and 0 <= row < height  # whether an event now has a time and a valid row
    i = 0
    while i < len(words):
        word = np.int64(words[i])
        kind = word >> 12
        if state[at.PENDING] != at.NOTHING:
            _go_on_or_break_off(kind, state, violations)
        if state[at.TIME_HIGH] < 0 and kind != TIME_HIGH:
            violations[at.BEFORE_TIME_HIGH] += 1

        if kind == ADDR_X:
            x = word & 0x7FF
            if in_row and x < width:
                _put(events, n_events, t, x, row, word >> 11 & 1)
                n_events += 1
            else:
                _count_dropped(1, in_row, state, violations)
        elif kind == ADDR_Y:
            row = word & 0x7FF
            state[at.ROW] = row
            in_row = state[at.TIME_HIGH] >= 0 and row < height
        elif kind == TIME_LOW:
            t = start | word & 0xFFF
        elif kind == TIME_HIGH:
            if word & 0xFFF != state[at.TIME_HIGH]:
                _change_time_high(word & 0xFFF, state, violations)
                start = state[at.LOOPS] << 24 | state[at.TIME_HIGH] << 12
                t = start
                in_row = 0 <= row < height
        elif kind in (VECT_12, VECT_8):
            base = state[at.BASE]
            if in_row and 0 <= base <= width - 32 and _is_whole_triple(words, i, state):
                mask = word & 0xFFF | (np.int64(words[i + 1]) & 0xFFF) << 12 | (np.int64(words[i + 2]) & 0xFF) << 24
                n_events = _put_vector(events, n_events, t, base, mask, row, state[at.BASE_POLARITY])
                state[at.BASE] = base + 32
                i += 2
            else:
                n_events = _take_vector_word(word, t, in_row, width, state, violations, events, n_events)
        elif kind == EXT_TRIGGER:
            if state[at.TIME_HIGH] >= 0:
                trigger = triggers[n_triggers]
                trigger.t = t
                trigger.p = word & 1
                trigger.id = word >> 8 & 0xF
                n_triggers += 1
        else:
            _take_rare_word(word, state, violations)
        i += 1
    state[at.TIME_LOW] = t & 0xFFF
    return n_events, n_triggers


@njit(cache=True, nogil=True)
def _put(events: Any, n: Int, t: Int, x: Int, y: Int, p: Int) -> None:
    event = events[n]
    event.t = t
    event.x = x
    event.y = y
    event.p = p


@njit(cache=True, nogil=True)
def _put_vector(events: Any, n: Int, t: Int, base: Int, mask: Int, y: Int, p: Int) -> Any:
    """Write an event for each bit of `mask`, lowest first, and return the number of events then written."""
    while mask != 0:
        lowest = mask & -mask
        _put(events, n, t, base + _PLACE_OF_BIT[(lowest * _DE_BRUIJN & 0xFFFFFFFF) >> 27], y, p)
        n += 1
        mask ^= lowest
    return n


@njit(cache=True, nogil=True)
def _change_time_high(high: Int, state: Any, violations: Any) -> None:
    """Take a TIME_HIGH that differs from the one before."""
    last = state[at.TIME_HIGH]
    if last >= 0:
        expected = last + 1
        if last - high >= _HALF_RANGE:
            state[at.LOOPS] += 1
            expected -= 2 * _HALF_RANGE
        if high > expected:
            violations[at.TIME_HIGH_GAP] += 1
        elif high < expected:
            violations[at.TIME_HIGH_BACKWARD] += 1
    state[at.TIME_HIGH] = high


@njit(cache=True, nogil=True)
def _count_dropped(n: Int, in_row: bool, state: Any, violations: Any) -> None:
    """Count `n` events that were dropped, by the reason; those before the first TIME_HIGH are counted as words."""
    if state[at.TIME_HIGH] < 0:
        return
    if in_row:
        violations[at.X_OUT_OF_RANGE] += n
    elif state[at.ROW] < 0:
        violations[at.MISSING_ADDR_Y] += n
    else:
        violations[at.Y_OUT_OF_RANGE] += n


@njit(cache=True, nogil=True)
def _is_whole_triple(words: Any, i: Int, state: Any) -> Any:
    """Return whether VECT_12, VECT_12, VECT_8 begin at `i`."""
    return (
        state[at.PENDING] == at.NOTHING
        and i + 2 < len(words)
        and words[i] >> 12 == VECT_12
        and words[i + 1] >> 12 == VECT_12
        and words[i + 2] >> 12 == VECT_8
    )


@njit(cache=True, nogil=True)
def _take_vector_word(
    word: Int, t: Int, in_row: bool, width: Int, state: Any, violations: Any, events: Any, n: Int
) -> Any:
    """Take one vector word with all checks, and return the number of events then written."""
    is_12 = word >> 12 == VECT_12
    size = 12 if is_12 else 8
    pending = state[at.PENDING]
    if is_12:
        state[at.PENDING] = at.VECTOR_1 if pending == at.NOTHING else at.VECTOR_2
    else:
        state[at.PENDING] = at.NOTHING
        if pending == at.NOTHING:
            violations[at.PARTIAL_VECTOR] += 1
    base = state[at.BASE]
    if base < 0:
        violations[at.MISSING_VECTOR_BASE] += 1
        return n
    if pending == at.NOTHING and base + (32 if is_12 else 8) > width:
        violations[at.INVALID_VECTOR_BASE] += 1
    state[at.BASE] = base + size
    mask = word & ((1 << size) - 1)
    inside = 0
    if in_row and base < width:
        inside = mask & ((1 << min(size, width - base)) - 1)
    if inside != mask:
        _count_dropped(_EVENTS_OF_WORD[word & 0xF000 | mask & ~inside], in_row, state, violations)
    return _put_vector(events, n, t, base, inside, state[at.ROW], state[at.BASE_POLARITY])


@njit(cache=True, nogil=True)
def _go_on_or_break_off(kind: Int, state: Any, violations: Any) -> None:
    """Count what had begun, if a word of type `kind` does not go on with it."""
    pending = state[at.PENDING]
    if pending in (at.VECTOR_1, at.VECTOR_2):
        if kind == (VECT_12 if pending == at.VECTOR_1 else VECT_8):
            return
        # A VECT_8 that comes too early counts itself.
        if kind != VECT_8:
            violations[at.PARTIAL_VECTOR] += 1
    elif pending == at.OTHER:
        if kind in (CONTINUED_12, CONTINUED_4):
            return
    else:
        if kind == (CONTINUED_4 if pending == at.COUNT_2 else CONTINUED_12):
            return
        violations[at.PARTIAL_CONTINUED] += 1
    state[at.PENDING] = at.NOTHING


@njit(cache=True, nogil=True)
def _take_rare_word(word: Int, state: Any, violations: Any) -> None:
    """Take a word that is neither an event nor a time nor a row."""
    kind = word >> 12
    if kind == VECT_BASE_X:
        state[at.BASE] = word & 0x7FF
        state[at.BASE_POLARITY] = word >> 11 & 1
    elif kind == OTHERS:
        subtype = word & 0xFFF
        state[at.SUBTYPE] = subtype
        state[at.PAYLOAD] = 0
        known = subtype in (at.SUBTYPE_BEFORE_ERC, at.SUBTYPE_AFTER_ERC)
        state[at.PENDING] = at.COUNT_0 if known else at.OTHER
    elif kind in (CONTINUED_12, CONTINUED_4):
        _continue_payload(word, state, violations)
    elif kind != IMU:
        violations[at.RESERVED_TYPE] += 1


@njit(cache=True, nogil=True)
def _continue_payload(word: Int, state: Any, violations: Any) -> None:
    """Take a CONTINUED word that goes on with what is pending, or with nothing."""
    pending = state[at.PENDING]
    if pending == at.COUNT_0:
        state[at.PAYLOAD] = word & 0xFFF
        state[at.PENDING] = at.COUNT_1
    elif pending == at.COUNT_1:
        state[at.PAYLOAD] |= (word & 0xFFF) << 12
        state[at.PENDING] = at.COUNT_2
    elif pending == at.COUNT_2:
        add_erc_count(state, state[at.PAYLOAD] | (word & 0xF) << 24)
    elif pending == at.NOTHING:
        violations[at.ORPHAN_CONTINUED] += 1


@njit(cache=True, nogil=True)
def add_erc_count(state: Any, value: Int) -> None:
    """Add a number of events before or after the event-rate controller; its OTHERS word is then whole."""
    if state[at.SUBTYPE] == at.SUBTYPE_BEFORE_ERC:
        state[at.N_BEFORE_ERC] += 1
        state[at.BEFORE_ERC] += value
    else:
        state[at.N_AFTER_ERC] += 1
        state[at.AFTER_ERC] += value
    state[at.PENDING] = at.NOTHING
