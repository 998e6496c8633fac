"""Compiled parts of the fast engine: from one event to the next of a pixel that has been quiet for long."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from drivers.jit import lean_njit
from sim_backend.pixel.engines.draws_kernels import exponential
from sim_backend.pixel.engines.hazard import B_FIRST, B_LAST, B_STEP, Z_LAST, Z_STEP

#: The further barrier must be this far away for the table of rates, and the two this far apart.
FURTHER: Final = 3.5
APART: Final = 7.99

# Columns of the table of rates, over barriers b
LOG_RATE: Final = 0  #: logarithm of the hazard of a crossing per sample, plus b^2 / 2
MOST: Final = 1  #: the hazard is no larger from this row of the table to the next
RATES: Final = 2  #: how many columns

_B_ROWS: Final = 1.0 / B_STEP  #: of the table, to 1 rms
_Z_COLUMNS: Final = 1.0 / Z_STEP


@lean_njit(forceinline=True)
def row_of(b, rows):  # type: ignore[no-untyped-def]
    """Return which row of a table is before barrier b, and what part of a row b is behind it."""
    x = (min(b, B_LAST) - B_FIRST) * _B_ROWS
    row = min(int(x), rows - 2)
    return row, x - row


@lean_njit(forceinline=True)
def from_normal(table, b, z):  # type: ignore[no-untyped-def]
    """Return the number that the table of a law has for barrier b at the normal number z."""
    row, part = row_of(b, len(table))
    x = (min(max(z, -Z_LAST), Z_LAST) + Z_LAST) * _Z_COLUMNS
    i = min(int(x), table.shape[1] - 2)
    x -= i
    low = table[row, i] + x * (table[row, i + 1] - table[row, i])
    high = table[row + 1, i] + x * (table[row + 1, i + 1] - table[row + 1, i])
    return low + part * (high - low)


@lean_njit()
def hazard(rates, b):  # type: ignore[no-untyped-def]
    """Return the hazard of a crossing, per sample, of a pixel that has long been quiet."""
    if b > B_LAST:
        return 0.0
    row, part = row_of(b, len(rates))
    low = rates[row, LOG_RATE]
    return math.exp(low + part * (rates[row + 1, LOG_RATE] - low) - 0.5 * b * b)


@lean_njit(forceinline=True)
def most_hazard(rates, b):  # type: ignore[no-untyped-def]
    """Return what :func:`hazard` does not exceed; cheaper, and up to twice as much."""
    return 0.0 if b > B_LAST else rates[row_of(b, len(rates))[0], MOST]


@lean_njit(forceinline=True)
def table_holds(upper, lower):  # type: ignore[no-untyped-def]
    """Return whether the table of rates may be used between these levels: one near at the most, both far apart."""
    return min(upper, -lower) >= B_FIRST and max(upper, -lower) >= FURTHER and upper - lower >= APART


@lean_njit(forceinline=True)
def quiet_output(upper, lower, inside, z):  # type: ignore[no-untyped-def]
    """Return the output of a pixel that has long not crossed, at the normal number z."""
    w = z
    if upper < B_LAST:
        w += from_normal(inside, upper, z) - z
    if lower > -B_LAST:
        w -= from_normal(inside, -lower, -z) + z
    return w


@lean_njit()
def jump(upper, lower, samples, rates, inside, beyond, z, used):  # type: ignore[no-untyped-def]
    """Take a quiet pixel to its next event, or `samples` on.

    Returns
    -------
    Samples gone, output there, normal numbers used, and 1 for an ON event, -1 for an OFF event, 0 for none.
    """
    wait = exponential(z, used)
    z0 = np.float64(z[used + 2])
    if wait >= (most_hazard(rates, upper) + most_hazard(rates, -lower)) * samples:
        return samples, quiet_output(upper, lower, inside, z0), used + 3, 0
    on = hazard(rates, upper)
    off = hazard(rates, -lower)
    if wait >= (on + off) * samples:
        return samples, quiet_output(upper, lower, inside, z0), used + 3, 0
    gone = min(int(wait / (on + off)) + 1, samples)
    if exponential(z, used + 3) * off < exponential(z, used + 5) * on:
        return gone, from_normal(beyond, upper, z0), used + 7, 1
    return gone, -from_normal(beyond, -lower, z0), used + 7, -1
