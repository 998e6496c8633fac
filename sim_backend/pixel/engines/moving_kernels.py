"""Compiled parts of the fast engine for light that moves: what the low-pass makes of it, at every sample.

Between two edges the log photocurrent is a settled level plus what the light still is away from it; the low-pass
turns the latter into the same at all pixels, but for their dark currents. So a table holds it for a few dark
currents, and a pixel lies between two of them.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from drivers.jit import njit

CELL: Final = 16  #: samples for which the extremes are kept together
LONGEST_MOVING: Final = 256  #: samples of a block under moving light at the most


@njit(cache=True, nogil=True, error_model="numpy")
def follow(  # type: ignore[no-untyped-def]
    begin, moving, first_of_segment, lux, settled_lux, dark_lux, lowest_lux, fade, rms, carried, out, lows, highs
):
    """Fill the table for the samples of a stretch.

    Parameters
    ----------
    begin
        Number of the first sample.
    moving
        (m,) bool: whether the light moves at each sample.
    first_of_segment
        (m,) bool: whether an edge comes right before the sample.
    lux, settled_lux
        (m,) light on the chip, and where it will be.
    dark_lux
        (k,) dark currents, as light.
    lowest_lux
        The logarithm is taken of no less than this, dark current included.
    fade, rms
        Factor of the low-pass for a sample; rms of the noise, the unit of the table.
    carried
        (k,) value at the sample before. Changed: value at the last sample.
    out
        (k, m) written.
    lows, highs
        (k, cells) extremes of the samples whose numbers have the same quotient by CELL. Written.
    """
    lows[:] = np.inf
    highs[:] = -np.inf
    for k in range(len(dark_lux)):
        value = carried[k]
        for n in range(len(lux)):
            if first_of_segment[n]:
                value = 0.0
            if moving[n]:
                now, then = max(lux[n] + dark_lux[k], lowest_lux), max(settled_lux[n] + dark_lux[k], lowest_lux)
                away = math.log(now / then) / rms
                value = fade * value + (1.0 - fade) * away
            else:
                value = 0.0
            out[k, n] = value
            cell = (begin + n) // CELL - begin // CELL
            lows[k, cell] = min(lows[k, cell], value)
            highs[k, cell] = max(highs[k, cell], value)
        carried[k] = value


@njit(cache=True, nogil=True, error_model="numpy")
def between_nodes(table, place, n):  # type: ignore[no-untyped-def]
    """Return column n of the table for a pixel at this place between its rows."""
    row = int(place)
    low = table[row, n]
    part = place - row
    if part == 0.0:
        return low
    return low + part * (table[row + 1, n] - low)


@njit(cache=True, nogil=True, error_model="numpy")
def extremes(lows, highs, place, begin, after, until):  # type: ignore[no-untyped-def]
    """Return the lowest and highest value that a pixel may have at the samples from `after` + 1 to `until`."""
    low = np.inf
    high = -np.inf
    for cell in range((after + 1) // CELL - begin // CELL, until // CELL - begin // CELL + 1):
        low = min(low, between_nodes(lows, place, cell))
        high = max(high, between_nodes(highs, place, cell))
    return low, high
