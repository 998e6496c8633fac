"""Compiled parts of looking at a recording: which events are of its pixels, answer a pulse, or come together.

Loops over events, as many NumPy calls for each of thousands of small recordings take longer than their simulation.
"""

from __future__ import annotations

import numpy as np

from drivers.jit import lean_njit

_US_PER_S = 1e6


@lean_njit()
def take_inside(events, corner, size, rank, stop_us, shift, t_us, pixel, p):  # type: ignore[no-untyped-def]
    """Take the events of pixels that were on, up to the end of the recording, and return how many there are.

    Parameters
    ----------
    events
        (n,) EVENT_DTYPE.
    corner, size
        Of the window: x and y of its first pixel, width and height.
    rank
        (width * height,) number of each pixel; -1 if off.
    stop_us
        Last time that is in the recording.
    shift
        Added to the numbers of pixels.
    t_us, pixel, p
        (n,) int64, int64 and uint8. Written.
    """
    count = 0
    for i in range(len(events)):
        x = np.int64(events[i].x) - corner[0]
        y = np.int64(events[i].y) - corner[1]
        t = np.int64(events[i].t)
        if not (0 <= x < size[0] and 0 <= y < size[1] and t <= stop_us):
            continue
        number = rank[y * size[0] + x]
        if number >= 0:
            t_us[count] = t
            pixel[count] = number + shift
            p[count] = events[i].p
            count += 1
    return count


@lean_njit()
def find_answers(t_us, pixel, p, windows, pulses, begin, own, other, first_s, second_s):  # type: ignore[no-untyped-def]
    """Count the events in all response windows, and note the first two that are expected.

    An event is in the last window of a polarity that begins before it, unless that is over.

    Parameters
    ----------
    t_us, pixel, p
        (n,) of the events, in order of time for each sensor.
    windows
        For OFF and for ON each: (w,) start, stop and edge, us; group; number in the group.
    pulses, begin
        (g,) windows of each group; its first cell. The cell of a window and a pixel is that, and the pixel times the
        windows of the group, and the number of the window in it.
    own, other
        (cells,) int64 zeros: events of the polarity that is expected, and of the other one. Changed.
    first_s, second_s
        (cells,) NaN: time from the edge to the first expected event and to the next later one. Changed.
    """
    at = np.int64(-1), np.int64(-1)
    before = t_us[0] if len(t_us) > 0 else np.int64(0)
    for i in range(len(t_us)):
        t = t_us[i]
        if t < before:  # time goes back where those of the next sensor begin
            at = np.int64(-1), np.int64(-1)
        before = t
        at = _last_before(t, windows[0][0], at[0]), _last_before(t, windows[1][0], at[1])
        for polarity in range(2):
            _, stop, edge, group, number = windows[polarity]
            window = at[polarity]
            if window < 0 or t >= stop[window]:
                continue
            cell = begin[group[window]] + pixel[i] * pulses[group[window]] + number[window]
            if p[i] != polarity:
                other[cell] += 1
                continue
            own[cell] += 1
            latency_s = (t - edge[window]) / _US_PER_S
            if np.isnan(first_s[cell]):
                first_s[cell] = latency_s
            elif np.isnan(second_s[cell]) and latency_s > first_s[cell]:
                second_s[cell] = latency_s


@lean_njit(forceinline=True)
def _last_before(t, start, at):  # type: ignore[no-untyped-def]
    """Return the last window that begins at or before a time, from one of which that is known."""
    while at + 1 < len(start) and start[at + 1] <= t:
        at += 1
    return at


@lean_njit()
def count_together(t_us, pixel, p, order, column, row, within_us, looked_back, chance, top):  # type: ignore[no-untyped-def]
    """Count for each pixel the events that come with one of a direct neighbour, less those that chance brings.

    Parameters
    ----------
    t_us, pixel, p
        (n,) of the events.
    order
        (n,) in which they are gone through.
    column, row
        (pixels,) of each pixel in the window.
    within_us, looked_back
        An event comes with one of those before it, so many at the most, if no more than this time is between them,
        and both are of one polarity.
    chance
        What an event that comes with one of a pixel which is no neighbour counts, to be taken off.
    top
        (pixels,) zeros. Changed.
    """
    for j in range(len(order)):
        i = order[j]
        beyond = 0.0
        for k in range(1, min(looked_back, j) + 1):
            other = order[j - k]
            if t_us[i] - t_us[other] > within_us or p[i] != p[other]:
                continue
            apart = abs(column[pixel[i]] - column[pixel[other]]) + abs(row[pixel[i]] - row[pixel[other]])
            if apart == 1:
                beyond += 1.0
            elif apart > 1:
                beyond -= chance
        top[pixel[i]] += beyond
