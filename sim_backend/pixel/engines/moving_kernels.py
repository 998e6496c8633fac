"""Compiled parts of the fast engine for light that moves: what the low-pass makes of it, at every sample.

Between two edges the log photocurrent is a settled level plus what the light still is away from it; the low-pass
turns the latter into the same at all pixels, but for their dark currents. So a table holds it for a few dark
currents, and a pixel lies between two of them. The table has columns for the samples at which the light moves, one
run of them for each segment: sample n of a segment has the column n less the segment's shift, a multiple of CELL.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from drivers.jit import lean_njit, njit

CELL: Final = 16  #: samples for which the extremes are kept together
LONGEST_MOVING: Final = 256  #: samples of a block under moving light at the most


@njit(cache=True, nogil=True, error_model="numpy")
def follow(  # type: ignore[no-untyped-def]
    runs, lux, settled_lux, dark_lux, lowest_lux, fade, rms, start, table, lows, highs
):
    """Fill the table.

    Parameters
    ----------
    runs
        (r, 3) first sample of each run of moving light, last sample, and shift.
    lux, settled_lux
        (n,) light on the chip at the samples of all runs, one after the other; (r,) where it settles.
    dark_lux
        (k,) dark currents, as light.
    lowest_lux
        The logarithm is taken of no less than this, dark current included.
    fade, rms
        Factor of the low-pass for a sample; rms of the noise, the unit of the table.
    start
        (k,) value at the sample before the first run; other runs begin at an edge, with 0.
    table
        (k, columns) written.
    lows, highs
        (k, columns / CELL) extremes of CELL columns. Written.
    """
    lows[:] = np.inf
    highs[:] = -np.inf
    for k in range(len(dark_lux)):
        value = start[k]
        n = 0
        for i in range(len(runs)):
            first, last, shift = runs[i]
            settled = max(settled_lux[i] + dark_lux[k], lowest_lux)
            for column in range(first - shift, last - shift + 1):
                away = math.log(max(lux[n] + dark_lux[k], lowest_lux) / settled) / rms
                n += 1
                value = fade * value + (1.0 - fade) * away
                table[k, column] = value
                cell = column // CELL
                lows[k, cell] = min(lows[k, cell], value)
                highs[k, cell] = max(highs[k, cell], value)
            value = 0.0


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
