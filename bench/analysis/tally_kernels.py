"""Per-event work of the analysis, compiled."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivers.jit import njit

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

__all__ = ["count_answers"]


@njit(cache=True, nogil=True)
def count_answers(
    window: npt.NDArray[np.int64],
    pixel: npt.NDArray[np.int64],
    latency_bin: npt.NDArray[np.int64],
    polarity: npt.NDArray[np.int64],
    group: npt.NDArray[np.int64],
    follows: npt.NDArray[np.bool_],
    last: npt.NDArray[np.int64],
    answers: npt.NDArray[np.int64],
    events: npt.NDArray[np.int64],
    given: npt.NDArray[np.int64],
    followed: npt.NDArray[np.int64],
    histogram: npt.NDArray[np.int64],
) -> None:
    """Count the answers of each pixel to each window; state is kept in `last` from chunk to chunk.

    Parameters
    ----------
    window, pixel, latency_bin
        (n,) for each event, in order of time: the window that it falls into (of its own polarity), its pixel, and
        its bin in the histogram of latencies (-1: none).
    polarity, group, follows
        (w,) of each window: see :class:`bench.analysis.windows.TestWindows`.
    last
        (2, pixels) the last window of each polarity that the pixel answered; -1 at first.
    answers, given, followed
        (groups, pixels) windows answered; windows whose predecessor was answered; those of them answered too.
    events
        (groups,) events in windows, the first and all others.
    histogram
        (groups, bins) latencies of the first events.
    """
    windows = polarity.size
    for i in range(window.size):
        w, x = window[i], pixel[i]
        p, g = polarity[w], group[w]
        events[g] += 1
        if last[p, x] == w:
            continue
        last[p, x] = w
        answers[g, x] += 1
        if latency_bin[i] >= 0:
            histogram[g, latency_bin[i]] += 1
        if w + 1 < windows and follows[w + 1]:
            given[group[w + 1], x] += 1
        if follows[w] and last[1 - p, x] == w - 1:
            followed[g, x] += 1
