"""Kernels of EVT2 (32-bit words), EVT2.1 (64-bit words) and DAT (64-bit records).

Words of 64 bits come as two columns of uint32, in the order of the stream; `upper` says which column
is the upper half.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from drivers.events import layout_kernels as at
from drivers.jit import njit

if TYPE_CHECKING:
    from drivers.events.layout_kernels import Int

__all__ = ["count_evt2", "count_evt21", "decode_dat_events", "decode_dat_triggers", "decode_evt2", "decode_evt21"]

CD_OFF: Final = 0x0
CD_ON: Final = 0x1
TIME_HIGH: Final = 0x8
EXT_TRIGGER: Final = 0xA
OTHERS: Final = 0xE
CONTINUED: Final = 0xF

_HALF_RANGE: Final = 1 << 27  #: of TIME_HIGH, 28 bits in units of 64 us
_HALF_RANGE_DAT: Final = 1 << 31


@njit(cache=True, nogil=True)
def _count_bits(value: Int) -> Any:
    """Return how many bits of a 32-bit number are set."""
    value = value - (value >> 1 & 0x55555555)
    value = (value & 0x33333333) + (value >> 2 & 0x33333333)
    value = (value + (value >> 4)) & 0x0F0F0F0F
    return (value * 0x01010101 & 0xFFFFFFFF) >> 24


@njit(cache=True, nogil=True)
def count_evt2(words: Any, word_types: Any) -> Any:
    """Count the types of words (n,) uint32 into `word_types`; return the most events and triggers they can hold."""
    found = np.zeros(16, np.int64)
    for word in words:
        found[word >> 28] += 1
    for kind in range(16):
        word_types[kind] += found[kind]
    return found[CD_OFF] + found[CD_ON], found[EXT_TRIGGER]


@njit(cache=True, nogil=True)
def count_evt21(words: Any, upper: Int, word_types: Any) -> Any:
    """Count the types of words (n, 2) uint32 into `word_types`; return the most events and triggers they can hold."""
    events = np.int64(0)
    triggers = 0
    for i in range(len(words)):
        kind = words[i, upper] >> 28
        word_types[kind] += 1
        if kind in (CD_OFF, CD_ON):
            events += _count_bits(np.int64(words[i, 1 - upper]))
        elif kind == EXT_TRIGGER:
            triggers += 1
    return events, triggers


@njit(cache=True, nogil=True)
def _take_time_high(high: Int, state: Any, violations: Any) -> Any:
    """Take a TIME_HIGH, and return the time of its start in us."""
    last = state[at.TIME_HIGH]
    if last - high >= _HALF_RANGE:
        state[at.LOOPS] += 1
    elif high < last:
        violations[at.TIME_HIGH_BACKWARD] += 1
    state[at.TIME_HIGH] = high
    return state[at.LOOPS] << 34 | high << 6


@njit(cache=True, nogil=True)
def _put_trigger(triggers: Any, n: Int, t: Int, p: Int, channel: Int) -> None:
    trigger = triggers[n]
    trigger.t = t
    trigger.p = p
    trigger.id = channel


@njit(cache=True, nogil=True)
def _put(events: Any, n: Int, t: Int, x: Int, y: Int, p: Int) -> None:
    event = events[n]
    event.t = t
    event.x = x
    event.y = y
    event.p = p


@njit(cache=True, nogil=True)
def _take_other_word(kind: Int, state: Any, violations: Any) -> None:
    """Take a word that is neither an event nor a time."""
    if kind == OTHERS:
        state[at.PENDING] = at.OTHER
    elif kind != CONTINUED:
        violations[at.RESERVED_TYPE] += 1
    elif state[at.PENDING] != at.OTHER:
        violations[at.ORPHAN_CONTINUED] += 1


@njit(cache=True, nogil=True)
def decode_evt2(words: Any, width: Int, height: Int, state: Any, violations: Any, events: Any, triggers: Any) -> Any:
    """Decode words (n,) uint32, and return how many events and triggers were written.

    The other parameters are those of :func:`drivers.events.evt3_kernels.decode`.
    """
    n_events = 0
    n_triggers = 0
    start = state[at.LOOPS] << 34 | state[at.TIME_HIGH] << 6
    for i in range(len(words)):
        word = np.int64(words[i])
        kind = word >> 28
        if kind != CONTINUED:
            state[at.PENDING] = at.NOTHING
        if state[at.TIME_HIGH] < 0 and kind != TIME_HIGH:
            violations[at.BEFORE_TIME_HIGH] += 1
            if kind <= CD_ON or kind == EXT_TRIGGER:
                continue
        t = start | word >> 22 & 0x3F
        if kind in (CD_OFF, CD_ON):
            x = word >> 11 & 0x7FF
            y = word & 0x7FF
            if x < width and y < height:
                _put(events, n_events, t, x, y, kind)
                n_events += 1
            else:
                violations[at.Y_OUT_OF_RANGE if y >= height else at.X_OUT_OF_RANGE] += 1
        elif kind == TIME_HIGH:
            start = _take_time_high(word & 0xFFFFFFF, state, violations)
        elif kind == EXT_TRIGGER:
            _put_trigger(triggers, n_triggers, t, word & 1, word >> 8 & 0x1F)
            n_triggers += 1
        else:
            _take_other_word(kind, state, violations)
    return n_events, n_triggers


@njit(cache=True, nogil=True)
def _put_group(events: Any, n: Int, t: Int, head: Int, mask: Int, width: Int, height: Int, violations: Any) -> Any:
    """Write the events of one EVT2.1 word, and return the number of events then written."""
    x = head >> 11 & 0x7FF
    y = head & 0x7FF
    if x % 32 != 0:
        violations[at.INVALID_VECTOR_BASE] += 1
    if y >= height:
        violations[at.Y_OUT_OF_RANGE] += _count_bits(mask)
        return n
    while mask != 0:
        if mask & 1:
            if x < width:
                _put(events, n, t, x, y, head >> 28)
                n += 1
            else:
                violations[at.X_OUT_OF_RANGE] += 1
        mask >>= 1
        x += 1
    return n


@njit(cache=True, nogil=True)
def _take_erc_count(subtype: Int, value: Int, state: Any) -> None:
    """Take a number of events before or after the event-rate controller."""
    if subtype == at.SUBTYPE_BEFORE_ERC:
        state[at.N_BEFORE_ERC] += 1
        state[at.BEFORE_ERC] += value
    elif subtype == at.SUBTYPE_AFTER_ERC:
        state[at.N_AFTER_ERC] += 1
        state[at.AFTER_ERC] += value


@njit(cache=True, nogil=True)
def decode_evt21(
    words: Any, upper: Int, width: Int, height: Int, state: Any, violations: Any, events: Any, triggers: Any
) -> Any:
    """Decode words (n, 2) uint32, and return how many events and triggers were written.

    The other parameters are those of :func:`drivers.events.evt3_kernels.decode`.
    """
    n_events = 0
    n_triggers = 0
    start = state[at.LOOPS] << 34 | state[at.TIME_HIGH] << 6
    for i in range(len(words)):
        head = np.int64(words[i, upper])
        tail = np.int64(words[i, 1 - upper])
        kind = head >> 28
        if kind != CONTINUED:
            state[at.PENDING] = at.NOTHING
        if state[at.TIME_HIGH] < 0 and kind != TIME_HIGH:
            violations[at.BEFORE_TIME_HIGH] += 1
            if kind <= CD_ON or kind == EXT_TRIGGER:
                continue
        t = start | head >> 22 & 0x3F
        if kind in (CD_OFF, CD_ON):
            n_events = _put_group(events, n_events, t, head, tail, width, height, violations)
        elif kind == TIME_HIGH:
            start = _take_time_high(head & 0xFFFFFFF, state, violations)
        elif kind == EXT_TRIGGER:
            _put_trigger(triggers, n_triggers, t, head & 1, head >> 8 & 0x1F)
            n_triggers += 1
        else:
            if kind == OTHERS:
                _take_erc_count(head & 0xFFFF, tail, state)
            _take_other_word(kind, state, violations)
    return n_events, n_triggers


@njit(cache=True, nogil=True)
def _take_dat_time(time: Int, state: Any, violations: Any) -> Any:
    """Take the 32-bit time of a record, and return its time in us."""
    last = state[at.TIME_HIGH]
    if last - time >= _HALF_RANGE_DAT:
        state[at.LOOPS] += 1
    elif time < last:
        violations[at.TIME_BACKWARD] += 1
    state[at.TIME_HIGH] = time
    return state[at.LOOPS] << 32 | time


@njit(cache=True, nogil=True)
def decode_dat_events(records: Any, width: Int, height: Int, state: Any, violations: Any, events: Any) -> Any:
    """Decode CD records (n, 2) uint32, and return how many events were written."""
    n = 0
    for i in range(len(records)):
        t = _take_dat_time(np.int64(records[i, 0]), state, violations)
        word = np.int64(records[i, 1])
        x = word & 0x3FFF
        y = word >> 14 & 0x3FFF
        if x < width and y < height:
            _put(events, n, t, x, y, word >> 28 & 1)
            n += 1
        else:
            violations[at.Y_OUT_OF_RANGE if y >= height else at.X_OUT_OF_RANGE] += 1
    return n


@njit(cache=True, nogil=True)
def decode_dat_triggers(records: Any, state: Any, violations: Any, triggers: Any) -> None:
    """Decode trigger records (n, 2) uint32 into `triggers` (n,)."""
    for i in range(len(records)):
        t = _take_dat_time(np.int64(records[i, 0]), state, violations)
        word = np.int64(records[i, 1])
        _put_trigger(triggers, i, t, word & 1, word >> 26 & 0x3F)
