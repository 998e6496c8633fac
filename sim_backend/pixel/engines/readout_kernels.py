"""Compiled parts of the readout: what must be done one event after the other."""

from __future__ import annotations

import math

import numpy as np

from drivers.jit import njit

_TIE = 1e-6  # of an event: a queue this much above a whole number of events counts as that number


@njit(cache=True, nogil=True, error_model="numpy")
def serve(t_us, service_us, most, last_us, served):  # type: ignore[no-untyped-def]
    """Take events in order of time through one server with a queue.

    Parameters
    ----------
    t_us
        (n,) times of arrival, ascending. Replaced by the times at which they have been served.
    service_us
        Time that the server needs for one.
    most
        Most events that may wait, the one being served among them.
    last_us
        When the last event before these has been served.
    served
        (n,) bool. Written: False for an event that found the queue full.

    Returns
    -------
    When the last event has been served.
    """
    for i in range(len(t_us)):
        waiting = math.ceil((last_us - t_us[i]) / service_us - _TIE)
        served[i] = waiting < most
        if served[i]:
            last_us = max(last_us, t_us[i]) + service_us
            t_us[i] = last_us
    return last_us


@njit(cache=True, nogil=True, error_model="numpy")
def first_of_runs(t_us, pixel, polarity, window_us, last_us, last_polarity, first):  # type: ignore[no-untyped-def]
    """Mark in `first` the events that begin a run of one polarity in their pixel.

    Parameters
    ----------
    t_us, pixel, polarity
        (n,) events in order of time; `pixel` counts the pixels of the window.
    window_us
        Time without an event that ends a run.
    last_us, last_polarity
        (pixels,) last event of each pixel. Changed.
    first
        (n,) bool. Written.
    """
    for i in range(len(t_us)):
        k = pixel[i]
        first[i] = polarity[i] != last_polarity[k] or t_us[i] - last_us[k] >= window_us
        last_us[k] = t_us[i]
        last_polarity[k] = np.int8(polarity[i])


@njit(cache=True, nogil=True, error_model="numpy")
def write_events(found, column, row, to_us, events):  # type: ignore[no-untyped-def]
    """Write events as the readout takes them.

    Parameters
    ----------
    found
        (n,) int64: ``(sample * pixels + place) * 2 + polarity``.
    column, row
        (pixels,) of the pixel at each place.
    to_us
        Length of a sample, us.
    events
        (n,) TIMED_DTYPE. Written.
    """
    pixels = len(column)
    sample = 0
    for i in range(len(found)):
        place = (found[i] >> 1) - sample * pixels
        if not 0 <= place < pixels:  # else it is the sample of the event before
            sample = (found[i] >> 1) // pixels
            place = (found[i] >> 1) - sample * pixels
        events[i].t_us = sample * to_us
        events[i].x = column[place]
        events[i].y = row[place]
        events[i].p = found[i] & 1


@njit(cache=True, nogil=True, error_model="numpy")
def is_in_order(t, events):  # type: ignore[no-untyped-def]
    """Return whether events with the times t are in order of time, row, column and polarity."""
    before_address = np.int64(0)
    for i in range(len(events)):
        address = (np.int64(events[i].y) << 17) | (np.int64(events[i].x) << 1) | np.int64(events[i].p)
        if i > 0 and not (t[i - 1] < t[i] or (t[i - 1] == t[i] and before_address <= address)):
            return False
        before_address = address
    return True
