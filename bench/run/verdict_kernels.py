"""Counting events as they pass, compiled."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivers.jit import njit

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

__all__ = ["count_events"]


@njit(cache=True, nogil=True)
def count_events(
    t: npt.NDArray[np.int64],
    x: npt.NDArray[np.uint16],
    y: npt.NDArray[np.uint16],
    p: npt.NDArray[np.uint8],
    first: int,
    bin_us: int,
    x0: int,
    y0: int,
    pixels: npt.NDArray[np.int64],
    bins: npt.NDArray[np.uint32],
) -> int:
    """Count events from number `first` on; return the number of the first whose bin does not exist, else of all.

    Parameters
    ----------
    t, x, y, p
        (n,) the events; those before time 0 count in the first bin.
    first
        Where to begin.
    bin_us
        Width of a bin, us.
    x0, y0
        First column and row of the window.
    pixels
        (height + 1, width) counts of each pixel; the last row has those outside the window in its first entry.
    bins
        (2, bins) counts of OFF and ON events in each bin of time.
    """
    height, width = pixels.shape[0] - 1, pixels.shape[1]
    n_bins = bins.shape[1]
    begin_us, number, on, off = 0, 0, 0, 0
    for i in range(first, t.size):
        if not begin_us <= t[i] < begin_us + bin_us:  # a division for each event would take most of the time
            bins[0, number] += off
            bins[1, number] += on
            on, off = 0, 0
            new = max(t[i], 0) // bin_us
            if new >= n_bins:
                return i
            number, begin_us = new, new * bin_us
        on += p[i] & 1
        off += 1 - (p[i] & 1)
        column, row = x[i] - x0, y[i] - y0
        if 0 <= column < width and 0 <= row < height:
            pixels[row, column] += 1
        else:
            pixels[height, 0] += 1
    bins[0, number] += off
    bins[1, number] += on
    return int(t.size)
