"""Compiled parts of the fast engine for light that moves: what the low-pass makes of it, at every sample.

Between two edges the log photocurrent is a settled level plus what the light still is away from it; the low-pass
turns the latter into the same at all pixels, but for their dark currents. So a table holds it for a few dark
currents, and a pixel lies between two of them. The table has columns for the samples at which the light moves, one
run of them for each segment: sample n of a segment has the column n less the segment's shift, a multiple of CELL.

A high-pass takes off what it remembers of the output without its noise. What it took off until an edge is, behind it,
part of the output that the low-pass forgets; the table has the rest.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from drivers.jit import lean_njit, njit

CELL: Final = 16  #: samples for which the extremes are kept together
LONGEST_MOVING: Final = 256  #: samples of a block under moving light at the most


# Columns of the state of a dark current, all in units of the rms
VALUE: Final = 0  #: what the low-pass makes of the light since the edge
OUTPUT: Final = 1  #: what it makes of all light, less what it made of that at t = 0
MEMORY: Final = 2  #: what the high-pass remembers of this
BEFORE: Final = 3  #: what is left of its memory at the last edge
KEPT: Final = 4  #: how many columns


@njit(cache=True, nogil=True, error_model="numpy")
def follow(  # type: ignore[no-untyped-def]
    runs,
    goes_on,
    keep,
    lux,
    settled_lux,
    start_lux,
    dark_lux,
    lowest_lux,
    fade,
    high_share,
    rms,
    state,
    table,
    lows,
    highs,
):
    """Fill the table.

    Parameters
    ----------
    runs
        (r, 3) first sample of each run of moving light, last sample, and shift.
    goes_on
        Whether the first run goes on where the state is; the others begin at an edge.
    keep
        Sample behind which the state is kept.
    lux, settled_lux
        (n,) light on the chip at the samples of all runs, one after the other; (r,) where it settles.
    start_lux
        Light at t = 0, at which everything has settled.
    dark_lux
        (k,) dark currents, as light.
    lowest_lux
        The logarithm is taken of no less than this, dark current included.
    fade, rms
        Factor of the low-pass for a sample; rms of the noise, the unit of the table.
    high_share
        What the high-pass learns in a sample; 0 without one. With one, the light counts as moving at all samples.
    state
        (k, KEPT) before the first run. Changed: behind the sample `keep`.
    table
        (k, columns) written.
    lows, highs
        (k, columns / CELL) extremes of CELL columns. Written.
    """
    lows[:] = np.inf
    highs[:] = -np.inf
    for k in range(len(dark_lux)):
        value, output, memory, before = state[k]
        start = max(start_lux + dark_lux[k], lowest_lux)
        n = 0
        for i in range(len(runs)):
            first, last, shift = runs[i]
            if i > 0 or not goes_on:
                value = 0.0
                before = memory
            settled = max(settled_lux[i] + dark_lux[k], lowest_lux)
            level = math.log(settled / start) / rms
            known_lux = -1.0
            away = 0.0
            for column in range(first - shift, last - shift + 1):
                if lux[n] != known_lux:
                    known_lux = lux[n]
                    away = math.log(max(known_lux + dark_lux[k], lowest_lux) / settled) / rms
                n += 1
                value = fade * value + (1.0 - fade) * away
                shown = value
                if high_share > 0.0:
                    output = fade * output + (1.0 - fade) * (level + away)
                    memory += high_share * (output - memory)
                    before *= fade
                    shown += before - memory
                table[k, column] = shown
                cell = column // CELL
                lows[k, cell] = min(lows[k, cell], shown)
                highs[k, cell] = max(highs[k, cell], shown)
                if column + shift == keep:
                    state[k, VALUE] = value
                    state[k, OUTPUT] = output
                    state[k, MEMORY] = memory
                    state[k, BEFORE] = before


@lean_njit(forceinline=True)
def between_nodes(table, place, column):  # type: ignore[no-untyped-def]
    """Return a column of the table for a pixel at this place between its rows."""
    row = int(place)
    low = table[row, column]
    part = place - row
    if part == 0.0:
        return low
    return low + part * (table[row + 1, column] - low)


@lean_njit(forceinline=True)
def extremes(lows, highs, place, after, until):  # type: ignore[no-untyped-def]
    """Return the lowest and highest value that a pixel may have in the columns from `after` + 1 to `until`."""
    low = np.inf
    high = -np.inf
    for cell in range((after + 1) // CELL, until // CELL + 1):
        low = min(low, between_nodes(lows, place, cell))
        high = max(high, between_nodes(highs, place, cell))
    return low, high
