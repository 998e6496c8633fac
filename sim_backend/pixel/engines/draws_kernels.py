"""Compiled parts of the fast engine: the random numbers of a pixel.

The normal numbers of a pixel are taken in turn from its own sequence (Philox, with the number of four of them, the
pixel and a purpose as counter), so they do not depend on other pixels, on threads, or on where a stretch ends.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from drivers.jit import lean_njit
from sim_backend.pixel.engines.reference_kernels import normal_pair, philox4x32

PURPOSE_FAST: Final = 2  #: third word of the counter

DRAW_LANES: Final = 32  #: counters that are turned into normal numbers together
DRAWS: Final = 4 * DRAW_LANES  #: normal numbers in store for a pixel

_U32 = np.uint32


@lean_njit()
def fill_draws(pixel, counter, key0, key1, words, z):  # type: ignore[no-untyped-def]
    """Write the normal numbers of the next DRAW_LANES counters of a pixel."""
    for lane in range(DRAW_LANES):
        index = counter + lane
        w0, w1, w2, w3 = philox4x32(_U32(index), pixel, _U32(PURPOSE_FAST), _U32(index >> 32), key0, key1)
        words[lane] = w0
        words[DRAW_LANES + lane] = w1
        words[2 * DRAW_LANES + lane] = w2
        words[3 * DRAW_LANES + lane] = w3
    for lane in range(DRAW_LANES):
        z0, z1 = normal_pair(words[lane], words[DRAW_LANES + lane])
        z2, z3 = normal_pair(words[2 * DRAW_LANES + lane], words[3 * DRAW_LANES + lane])
        z[lane] = z0
        z[DRAW_LANES + lane] = z1
        z[2 * DRAW_LANES + lane] = z2
        z[3 * DRAW_LANES + lane] = z3


@lean_njit()
def exponential(z, used):  # type: ignore[no-untyped-def]
    """Return an exponential number of mean 1, half the squared radius of the two normal ones at `used`."""
    a = np.float64(z[used])
    b = np.float64(z[used + 1])
    return 0.5 * (a * a + b * b)
