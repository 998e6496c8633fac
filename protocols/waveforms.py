"""The light of a point over time.

Edges are computed as multiples of the period, never by adding up, so that the last edge of a long recording is as
exact as the first. Windows of the response are half open, [start, stop).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from protocols.points import ResetTestTiming, SquareTiming
from protocols.preamble import with_preamble
from protocols.stimulus import Stimulus

if TYPE_CHECKING:
    import numpy.typing as npt

    from protocols.points import Point

__all__ = [
    "STEP_DOWN",
    "STEP_UP",
    "constant_light",
    "reset_test_edges",
    "reset_test_levels",
    "square_edges",
    "stimulus_of",
]

STEP_UP = 0  #: kind of a pulse that steps up: an ON event is expected
STEP_DOWN = 1  #: kind of a pulse that steps down: an OFF event is expected


def stimulus_of(point: Point) -> Stimulus:
    """Return the light of `point` over time, and the windows in which a response counts.

    Parameters
    ----------
    point
        A measurement point.

    Returns
    -------
    Stimulus
        Square wave: a dark part, then `point.pulses` times a bright and a dark part; both are windows. Reset/test:
        `point.pulses` times gap, reset, gap, test, and a last gap; only the test pulses have windows. Constant: one
        level and no window. A preamble comes before all that.
    """
    if point.preamble is None:
        return _bare(point)
    return with_preamble(_bare(point), point.preamble)


def _bare(point: Point) -> Stimulus:
    timing = point.timing
    if isinstance(timing, SquareTiming):
        return _square(point, timing)
    if isinstance(timing, ResetTestTiming):
        return _reset_test(point, timing)
    return constant_light(point.baseline_lux, timing.duration_s)


def constant_light(lux: float, duration_s: float) -> Stimulus:
    """Return one level of `lux` on chip for `duration_s` seconds, without pulses."""
    return _stimulus(lux, [], [], duration_s, _windows([], [], []))


def square_edges(
    *, period_s: float, duty: float, low_lux: float, high_lux: float, cycles: int, first_edge_s: float
) -> Stimulus:
    """Return a square wave whose first rising edge is at `first_edge_s`.

    Parameters
    ----------
    period_s
        Length of a period, s.
    duty
        Bright part of a period, between 0 and 1.
    low_lux, high_lux
        The two levels on chip, lux.
    cycles
        Number of periods, each a bright part and the dark part that follows it.
    first_edge_s
        Time of the first rising edge, s; above 0. Until then the light is at `low_lux`.

    Returns
    -------
    Stimulus
        ``2 * cycles`` windows: each bright part (kind 0) and each dark part (kind 1).
    """
    rise = first_edge_s + period_s * np.arange(cycles + 1)
    fall = first_edge_s + period_s * (np.arange(cycles) + duty)
    start = np.column_stack([rise[:-1], fall]).ravel()
    stop = np.column_stack([fall, rise[1:]]).ravel()
    windows = _windows(start, stop, [STEP_UP, STEP_DOWN] * cycles)
    return _stimulus(low_lux, start, [high_lux, low_lux] * cycles, float(rise[-1]), windows)


def reset_test_edges(
    *,
    baseline_lux: float,
    reset_lux: float,
    test_lux: float,
    gap_s: float,
    reset_s: float,
    test_s: float,
    cycles: int,
    window_s: float | None = None,
    first_edge_s: float | None = None,
) -> Stimulus:
    """Return a train of reset and test pulses.

    Parameters
    ----------
    baseline_lux, reset_lux, test_lux
        Levels on chip between the pulses, in the reset pulse and in the test pulse, lux.
    gap_s, reset_s, test_s
        Length of the baseline before each pulse, of the reset pulse and of the test pulse, s.
    cycles
        Number of periods; a period is gap, reset, gap, test.
    window_s
        Response window from the leading edge of the test pulse, s; `test_s` if None.
    first_edge_s
        Time of the leading edge of the first reset pulse, s; `gap_s` if None.

    Returns
    -------
    Stimulus
        `cycles` windows, one for each test pulse; kind 0 where the test pulse is brighter than the baseline. The
        last test pulse is followed by one more gap.
    """
    period_s = 2 * gap_s + reset_s + test_s
    first = gap_s if first_edge_s is None else first_edge_s
    reset = first + period_s * np.arange(cycles)
    test = reset + (reset_s + gap_s)
    edges = np.column_stack([reset, reset + reset_s, test, test + test_s]).ravel()
    lux = [reset_lux, baseline_lux, test_lux, baseline_lux] * cycles
    kind = STEP_UP if test_lux > baseline_lux else STEP_DOWN
    windows = _windows(test, test + (test_s if window_s is None else window_s), [kind] * cycles)
    return _stimulus(baseline_lux, edges, lux, first + period_s * cycles, windows)


def reset_test_levels(point: Point, timing: ResetTestTiming) -> tuple[float, float]:
    """Return the light in the reset pulse and in the test pulse, lux on chip.

    The test pulse of an ON point is brighter than the baseline by `log_contrast`, that of an OFF point darker.
    """
    test_sign = -1.0 if point.polarity == "off" else 1.0
    reset_sign = 1.0 if timing.reset_direction == "up" else -1.0
    reset_lux = point.baseline_lux * math.exp(reset_sign * timing.reset_log_contrast)
    return reset_lux, point.baseline_lux * math.exp(test_sign * point.log_contrast)


def _square(point: Point, timing: SquareTiming) -> Stimulus:
    period_s = 1.0 / timing.frequency_hz
    return square_edges(
        period_s=period_s,
        duty=timing.duty,
        low_lux=point.baseline_lux,
        high_lux=point.baseline_lux * math.exp(point.log_contrast),
        cycles=point.pulses,
        first_edge_s=(1.0 - timing.duty) * period_s,
    )


def _reset_test(point: Point, timing: ResetTestTiming) -> Stimulus:
    reset_lux, test_lux = reset_test_levels(point, timing)
    return reset_test_edges(
        baseline_lux=point.baseline_lux,
        reset_lux=reset_lux,
        test_lux=test_lux,
        gap_s=timing.gap_s,
        reset_s=timing.reset_s,
        test_s=timing.test_s,
        cycles=point.pulses,
        window_s=timing.window_s,
    )


_Windows = tuple["npt.NDArray[np.float64]", "npt.NDArray[np.float64]", "npt.NDArray[np.uint8]"]


def _windows(start: npt.ArrayLike, stop: npt.ArrayLike, kind: npt.ArrayLike) -> _Windows:
    return (
        np.asarray(start, dtype=np.float64),
        np.asarray(stop, dtype=np.float64),
        np.asarray(kind, dtype=np.uint8),
    )


def _stimulus(
    first_lux: float, edges_s: npt.ArrayLike, lux: npt.ArrayLike, duration_s: float, windows: _Windows
) -> Stimulus:
    """Return the light that begins at `first_lux` and is at `lux` from `edges_s` on."""
    after = np.asarray(edges_s, dtype=np.float64), np.asarray(lux, dtype=np.float64)
    return Stimulus(np.append(0.0, after[0]), np.append(first_lux, after[1]), duration_s, *windows)
