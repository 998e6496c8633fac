"""Places in the arrays that the kernels share with the decoders: state, violations.

Nothing is compiled here. The file is named like those with kernels so that it counts in the hash of the cache
(:mod:`drivers.jit`): compiled code holds these numbers as constants.
"""

from __future__ import annotations

from typing import Final, TypeAlias

import numpy as np

__all__ = ["STATE_SIZE", "VIOLATION_NAMES", "Int"]

#: A whole number in a kernel: int64 when compiled, whatever Python says of it.
Int: TypeAlias = int | np.int64

# What went wrong, by the place of its count. An event that is dropped is counted once for each event.
BEFORE_TIME_HIGH: Final = 0  #: word before the first TIME_HIGH: it has no time, and what it says is not an event yet
TIME_HIGH_BACKWARD: Final = 1  #: TIME_HIGH smaller than the one before, and not by the half range of a rollover
TIME_HIGH_GAP: Final = 2  #: TIME_HIGH that skips at least one value
MISSING_ADDR_Y: Final = 3  #: event dropped: no row was ever given
MISSING_VECTOR_BASE: Final = 4  #: vector word without any VECT_BASE_X before it: dropped
INVALID_VECTOR_BASE: Final = 5  #: vector that does not fit in the sensor, or is not aligned where it must be
PARTIAL_VECTOR: Final = 6  #: VECT_12, VECT_12, VECT_8 that is not whole
PARTIAL_CONTINUED: Final = 7  #: payload of an OTHERS word of known length that is not whole
ORPHAN_CONTINUED: Final = 8  #: CONTINUED word that belongs to nothing
X_OUT_OF_RANGE: Final = 9  #: event dropped: column outside the sensor
Y_OUT_OF_RANGE: Final = 10  #: event dropped: row outside the sensor
RESERVED_TYPE: Final = 11  #: word of a type that the format does not know: skipped
TIME_BACKWARD: Final = 12  #: DAT: record older than the one before, and not by the half range of a rollover
TORN_WORD: Final = 13  #: the stream ended inside a word

VIOLATION_NAMES: Final = (
    "before_time_high",
    "time_high_backward",
    "time_high_gap",
    "missing_addr_y",
    "missing_vector_base",
    "invalid_vector_base",
    "partial_vector",
    "partial_continued",
    "orphan_continued",
    "x_out_of_range",
    "y_out_of_range",
    "reserved_type",
    "time_backward",
    "torn_word",
)

# State that lives from one chunk to the next, int64.
TIME_HIGH: Final = 0  #: last TIME_HIGH, -1 before the first (DAT: last time)
LOOPS: Final = 1  #: rollovers so far
TIME_LOW: Final = 2
ROW: Final = 3  #: -1 before the first ADDR_Y
BASE: Final = 4  #: next column of a vector, -1 before the first VECT_BASE_X
BASE_POLARITY: Final = 5
PENDING: Final = 6  #: what has begun and is not whole yet, one of the values below
SUBTYPE: Final = 7  #: of the OTHERS word whose payload is being read
PAYLOAD: Final = 8  #: bits of it so far
N_BEFORE_ERC: Final = 9  #: reports of the number of events before the event-rate controller
BEFORE_ERC: Final = 10  #: sum of these
N_AFTER_ERC: Final = 11
AFTER_ERC: Final = 12
STATE_SIZE: Final = 13

# Values of PENDING.
NOTHING: Final = 0
VECTOR_1: Final = 1  #: one VECT_12 seen
VECTOR_2: Final = 2  #: two VECT_12 seen
COUNT_0: Final = 3  #: OTHERS with a count seen, its 28 bits to come as 12 + 12 + 4
COUNT_1: Final = 4
COUNT_2: Final = 5
OTHER: Final = 6  #: OTHERS of another kind seen; it may have any number of CONTINUED words

# Subtypes of OTHERS words: number of events before and after the event-rate controller.
SUBTYPE_BEFORE_ERC: Final = 0x014
SUBTYPE_AFTER_ERC: Final = 0x016
