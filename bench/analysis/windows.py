"""When an answer counts: the response windows of a point, and the windows in which a reset re-arms the pixels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from bench.analysis.results import ResponsePolarity
    from bench.store.data import PointData

__all__ = [
    "ResetWindows",
    "TestGroup",
    "TestWindows",
    "kept_pulses",
    "microseconds",
    "reset_windows",
    "test_windows",
    "window_of",
]

POLARITIES: Final[tuple[ResponsePolarity, ResponsePolarity]] = ("off", "on")  #: by the value of an event's `p`
_TOLERANCE_S: Final = 1.5e-6  # the event stream counts whole microseconds
_EQUAL_LEVELS_LN: Final = 1e-6


def microseconds(t_s: npt.ArrayLike) -> npt.NDArray[np.int64]:
    """Return the first whole microsecond at or after each time in s: an event at `t` us is at or after it."""
    # Rounding to the picosecond first: 0.103 s is 103000 us, not 102999.99999999999.
    return np.ceil(np.round(np.asarray(t_s, np.float64) * 1e6, 6)).astype(np.int64)


@dataclass(frozen=True, slots=True)
class TestGroup:
    """Test pulses of one point that ask the same: one polarity, one contrast."""

    polarity: ResponsePolarity
    log_contrast: float
    pulses: int
    width_s: float  #: length of the test pulse (median), s
    window_s: float  #: length of the response window (median), s
    reset_log_contrast: float  #: ln(reset level / baseline), signed; NaN without resets


@dataclass(frozen=True, slots=True)
class TestWindows:
    """Response windows in order of time; each belongs to one group."""

    start_us: npt.NDArray[np.int64]  #: (w,)
    stop_us: npt.NDArray[np.int64]  #: (w,) the window is [start, stop)
    edge_us: npt.NDArray[np.int64]  #: (w,) leading edge of the test pulse, from which latency counts
    polarity: npt.NDArray[np.int64]  #: (w,) 1 = ON expected, 0 = OFF expected
    group: npt.NDArray[np.int64]  #: (w,) index into `groups`
    follows: npt.NDArray[np.bool_]  #: (w,) the window before is of the other polarity and ends where this begins
    groups: tuple[TestGroup, ...]
    left_out: int  #: pulses marked as not valid, in a gap of the data, or cut off by the end of the recording
    overlapping: bool  #: two windows of one polarity overlap


@dataclass(frozen=True, slots=True)
class ResetWindows:
    """From the return edge of each reset pulse to its test pulse: here the re-arming event is due."""

    start_us: npt.NDArray[np.int64]  #: (w,)
    stop_us: npt.NDArray[np.int64]  #: (w,)
    polarity: npt.NDArray[np.int64]  #: (w,) polarity of the re-arming event: the direction of the return edge
    group: npt.NDArray[np.int64]  #: (w,) the group of the test pulse that follows


def kept_pulses(point: PointData) -> npt.NDArray[np.int64]:
    """Return the indices of the pulses that count, in order of time: valid, whole, and not in a gap of the data."""
    start, stop = point.pulse_start_s, point.pulse_stop_s
    good = point.pulse_valid & (start >= -_TOLERANCE_S) & (stop <= point.duration_s + _TOLERANCE_S) & (stop > start)
    for gap_start, gap_stop in point.gaps_s:
        good &= (stop <= gap_start) | (start >= gap_stop)
    kept = np.flatnonzero(good)
    return kept[np.argsort(start[kept], kind="stable")]


def _test_edges(point: PointData, pulses: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Return for each pulse the index of its leading edge in the stimulus, or -1 where there is none.

    A window starts at the edge; one that was laid around the pulse starts before it.
    """
    t, lux = point.stimulus_t_s, point.stimulus_lux
    rises = np.concatenate(([0], np.sign(np.diff(lux)))) if lux.size else np.zeros(0)
    found = np.full(pulses.size, -1, np.int64)
    at_start = np.searchsorted(t, point.pulse_start_s[pulses] + _TOLERANCE_S, side="right") - 1
    wanted = np.where(point.pulse_kind[pulses] == 0, 1, -1)
    for candidate in (at_start + 1, at_start):
        inside = np.clip(candidate, 0, max(t.size - 1, 0))
        if t.size:
            fits = (candidate >= 1) & (candidate < t.size) & (rises[inside] == wanted)
            fits &= t[inside] < point.pulse_stop_s[pulses]
            found = np.where(fits, candidate, found)
    return found


def _widths_s(
    point: PointData, pulses: npt.NDArray[np.int64], edges: npt.NDArray[np.int64]
) -> npt.NDArray[np.float64]:
    """Return the length of each test pulse: from its edge to the next one; of its window where no edge is known."""
    ends = np.append(point.stimulus_t_s, point.duration_s)
    width = point.pulse_stop_s[pulses] - point.pulse_start_s[pulses]
    known = edges >= 0
    width[known] = ends[edges[known] + 1] - ends[edges[known]]
    return width


def _reset_log_contrast(point: PointData, edges: npt.NDArray[np.int64]) -> npt.NDArray[np.float64]:
    """Return ln(reset level / level before the test) for each test edge; NaN where no reset goes before it."""
    lux = point.stimulus_lux
    result = np.full(edges.size, np.nan)
    if point.waveform != "reset_test":
        return result
    known = np.flatnonzero(edges >= 2)
    reset, base = lux[edges[known] - 2], lux[edges[known] - 1]
    lit = (reset > 0) & (base > 0)
    result[known[lit]] = np.log(reset[lit] / base[lit])
    result[np.abs(result) < _EQUAL_LEVELS_LN] = np.nan
    return result


def _median(values: npt.NDArray[np.float64]) -> float:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if finite.size else float("nan")


def test_windows(point: PointData) -> TestWindows:
    """Return the response windows of `point`: kind 0 asks for ON, kind 1 for OFF."""
    pulses = kept_pulses(point)
    edges = _test_edges(point, pulses)
    polarity = np.where(point.pulse_kind[pulses] == 0, 1, 0).astype(np.int64)
    contrast = np.round(point.pulse_log_contrast[pulses], 9)
    width_s, reset = _widths_s(point, pulses, edges), _reset_log_contrast(point, edges)
    window_s = point.pulse_stop_s[pulses] - point.pulse_start_s[pulses]
    group = np.zeros(pulses.size, np.int64)
    groups: list[TestGroup] = []
    for pol, value in sorted({(int(p), float(c)) for p, c in zip(polarity, contrast, strict=True)}, reverse=True):
        mine = (polarity == pol) & (contrast == value)
        group[mine] = len(groups)
        groups.append(
            TestGroup(
                polarity=POLARITIES[pol],
                log_contrast=value,
                pulses=int(mine.sum()),
                width_s=_median(width_s[mine]),
                window_s=_median(window_s[mine]),
                reset_log_contrast=_median(reset[mine]),
            )
        )
    start, stop = microseconds(point.pulse_start_s[pulses]), microseconds(point.pulse_stop_s[pulses])
    edge_s = np.where(edges >= 0, point.stimulus_t_s[edges] if point.stimulus_t_s.size else 0.0, np.nan)
    return TestWindows(
        start_us=start,
        stop_us=stop,
        edge_us=np.where(edges >= 0, microseconds(np.nan_to_num(edge_s)), start),
        polarity=polarity,
        group=group,
        follows=_follows(start, stop, polarity),
        groups=tuple(groups),
        left_out=point.pulse_start_s.size - pulses.size,
        overlapping=any(bool(np.any(start[polarity == p][1:] < stop[polarity == p][:-1])) for p in (0, 1)),
    )


def _follows(
    start: npt.NDArray[np.int64], stop: npt.NDArray[np.int64], polarity: npt.NDArray[np.int64]
) -> npt.NDArray[np.bool_]:
    follows = np.zeros(start.size, np.bool_)
    follows[1:] = (polarity[1:] != polarity[:-1]) & (np.abs(start[1:] - stop[:-1]) <= 1)
    return follows


def reset_windows(point: PointData, tests: TestWindows) -> ResetWindows:
    """Return where the re-arming events of a reset/test point are due, from the edges in its stimulus.

    A period is baseline, reset, baseline, test: the edge before the test edge is the return of the reset.
    """
    pulses = kept_pulses(point)
    edges = _test_edges(point, pulses)
    reset = _reset_log_contrast(point, edges)
    found = np.isfinite(reset)
    return ResetWindows(
        start_us=microseconds(point.stimulus_t_s[edges[found] - 1]),
        stop_us=microseconds(point.stimulus_t_s[edges[found]]),
        polarity=np.where(reset[found] > 0, 0, 1).astype(np.int64),
        group=tests.group[found],
    )


def window_of(
    windows: TestWindows | ResetWindows, t_us: npt.NDArray[np.int64], polarity: npt.NDArray[np.uint8]
) -> npt.NDArray[np.int64]:
    """Return the window of its own polarity into which each event falls; -1 for none."""
    window = np.full(t_us.size, -1, np.int64)
    for p in (0, 1):
        mine = np.flatnonzero(windows.polarity == p)
        events = np.flatnonzero(polarity == p)
        if not (mine.size and events.size):
            continue
        found = np.searchsorted(windows.start_us[mine], t_us[events], side="right") - 1
        candidate = mine[np.maximum(found, 0)]
        inside = (found >= 0) & (t_us[events] < windows.stop_us[candidate])
        window[events[inside]] = candidate[inside]
    return window
