"""Compiled parts of the fast engine: from one event to the next of a pixel that has been quiet for long."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from drivers.jit import njit
from sim_backend.pixel.engines.draws_kernels import exponential
from sim_backend.pixel.engines.hazard import B_FIRST, B_LAST, B_STEP, Z_LAST, Z_STEP

#: The further barrier must be this far away for the table of rates, and the two this far apart.
FURTHER: Final = 3.5
APART: Final = 7.99


@njit(cache=True, nogil=True, error_model="numpy")
def between(table, row, x):  # type: ignore[no-untyped-def]
    """Return the number at x, in steps of the table, between two entries of a row."""
    i = min(max(int(x), 0), table.shape[1] - 2)
    return table[row, i] + (x - i) * (table[row, i + 1] - table[row, i])


@njit(cache=True, nogil=True, error_model="numpy")
def from_normal(table, b, z):  # type: ignore[no-untyped-def]
    """Return the number that the table of a law has for barrier b at the normal number z."""
    x = (min(b, B_LAST) - B_FIRST) / B_STEP
    row = min(int(x), len(table) - 2)
    at = (min(max(z, -Z_LAST), Z_LAST) + Z_LAST) / Z_STEP
    low = between(table, row, at)
    return low + (x - row) * (between(table, row + 1, at) - low)


@njit(cache=True, nogil=True, error_model="numpy")
def hazard(log_rate, b):  # type: ignore[no-untyped-def]
    """Return the hazard of a crossing, per sample, of a pixel that has long been quiet."""
    if b > B_LAST:
        return 0.0
    return math.exp(between(log_rate, 0, (b - B_FIRST) / B_STEP) - 0.5 * b * b)


@njit(cache=True, nogil=True, error_model="numpy")
def table_holds(upper, lower):  # type: ignore[no-untyped-def]
    """Return whether the table of rates may be used between these levels: one near at the most, both far apart."""
    return min(upper, -lower) >= B_FIRST and max(upper, -lower) >= FURTHER and upper - lower >= APART


@njit(cache=True, nogil=True, error_model="numpy")
def jump(upper, lower, samples, log_rate, inside, beyond, z, used):  # type: ignore[no-untyped-def]
    """Take a quiet pixel to its next event, or `samples` on.

    Returns
    -------
    What :func:`block` returns, and 1 for an ON event, -1 for an OFF event, 0 for none.
    """
    on = hazard(log_rate, upper)
    off = hazard(log_rate, -lower)
    wait = exponential(z, used)
    z0 = np.float64(z[used + 2])
    if wait >= (on + off) * samples:
        w = z0
        if upper < B_LAST:
            w += from_normal(inside, upper, z0) - z0
        if lower > -B_LAST:
            w -= from_normal(inside, -lower, -z0) + z0
        return samples, w, used + 3, 0
    gone = min(int(wait / (on + off)) + 1, samples)
    if exponential(z, used + 3) * off < exponential(z, used + 5) * on:
        return gone, from_normal(beyond, upper, z0), used + 7, 1
    return gone, -from_normal(beyond, -lower, z0), used + 7, -1
