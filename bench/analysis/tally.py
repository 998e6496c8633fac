"""What is counted in one point, in one pass over its events, chunk by chunk."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.analysis.windows import TestGroup, reset_windows, test_windows, window_of

if TYPE_CHECKING:
    from collections.abc import Iterable

    import numpy.typing as npt

    from bench.analysis.windows import ResetWindows, TestWindows
    from bench.store.data import PointData

__all__ = ["GroupTally", "PointTally", "tally_events", "tally_point"]

_FINE_BINS: Final = 1 << 18  # latencies are kept to 1 us up to 262 ms, and more coarsely in longer windows


@dataclass(frozen=True, slots=True)
class GroupTally:
    """The answers to the test pulses of one group. Arrays cover the whole window of pixels, masked ones as zero."""

    test: TestGroup
    answers: npt.NDArray[np.integer]  #: (pixels,) pulses answered
    events: int  #: events in the response windows
    given: npt.NDArray[np.integer]  #: (pixels,) pulses whose predecessor, of the other polarity, was answered
    followed: npt.NDArray[np.integer]  #: (pixels,) those of them that were answered too
    latencies: npt.NDArray[np.integer]  #: (bins,) first events by latency
    latency_bin_us: int  #: width of a bin
    resets: int  #: resets before these pulses
    rearmed: npt.NDArray[np.integer]  #: (pixels,) resets that were answered


@dataclass(frozen=True, slots=True)
class PointTally:
    """Everything that is counted in one point."""

    groups: tuple[GroupTally, ...]
    active: npt.NDArray[np.bool_]  #: (pixels,) False where a pixel was switched off
    pixel_events: npt.NDArray[np.int64]  #: (2, pixels) events by polarity (0 OFF, 1 ON), outside gaps
    observed_s: float  #: length of the recording without its gaps
    outside: int  #: events outside the window of pixels, which are not counted
    left_out: int  #: pulses that do not count
    overlapping: bool  #: response windows of one polarity overlap
    late: int  #: events after the end of the recording, which are not counted
    first_half: npt.NDArray[np.int64]  #: (pixels,) those of `pixel_events` in the first half of the recording


class _Counter:
    """Counts answers to windows, chunk by chunk."""

    def __init__(self, windows: TestWindows | ResetWindows, groups: int, pixels: int, *, latencies: bool) -> None:
        self.windows = windows
        self.edge_us = getattr(windows, "edge_us", windows.start_us)
        self.follows = getattr(windows, "follows", np.zeros(windows.start_us.size, np.bool_))
        longest = int(np.max(windows.stop_us - self.edge_us, initial=1)) if latencies else 1
        self.bin_us = max(1, -(-longest // _FINE_BINS))
        self.bins = -(-longest // self.bin_us) if latencies else 0
        self.last = np.full((2, pixels), -1, np.int64)
        self.answers, self.given, self.followed = (np.zeros((groups, pixels), np.int64) for _ in range(3))
        self.events = np.zeros(groups, np.int64)
        self.histogram = np.zeros((groups, self.bins), np.int64)

    def add(self, t_us: npt.NDArray[np.int64], polarity: npt.NDArray[np.uint8], pixel: npt.NDArray[np.int64]) -> None:
        """Count one chunk of events in order of time."""
        from bench.analysis.tally_kernels import count_answers

        if not self.windows.start_us.size:
            return
        window = window_of(self.windows, t_us, polarity)
        inside = np.flatnonzero(window >= 0)
        window = window[inside]
        latency_us = t_us[inside] - self.edge_us[window]
        bins = latency_us // self.bin_us
        bins[(latency_us < 0) | (bins >= self.bins)] = -1
        count_answers(
            window,
            pixel[inside],
            bins,
            self.windows.polarity,
            self.windows.group,
            self.follows,
            self.last,
            self.answers,
            self.events,
            self.given,
            self.followed,
            self.histogram,
        )


def active_pixels(point: PointData) -> npt.NDArray[np.bool_]:
    """Return (pixels,) which pixels of the point's window were on, row by row."""
    roi = point.roi
    active = np.ones((roi.height, roi.width), np.bool_)
    if point.masked.size:
        x, y = point.masked[:, 0].astype(np.int64) - roi.x, point.masked[:, 1].astype(np.int64) - roi.y
        inside = (x >= 0) & (x < roi.width) & (y >= 0) & (y < roi.height)
        active[y[inside], x[inside]] = False
    return active.ravel()


def outside_gaps(t_us: npt.NDArray[np.int64], gaps_s: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
    """Return (n,) which times, us, lie in none of the gaps, (g, 2) s."""
    keep = np.ones(t_us.size, np.bool_)
    for start_s, stop_s in gaps_s:
        keep &= (t_us < start_s * 1e6) | (t_us >= stop_s * 1e6)
    return keep


def observed_s(point: PointData) -> float:
    """Return the length of the recording in s without its gaps (which may overlap)."""
    lost, reached = 0.0, 0.0
    for start, stop in sorted((float(a), float(b)) for a, b in point.gaps_s):
        start, stop = max(start, reached), min(stop, point.duration_s)
        lost += max(stop - start, 0.0)
        reached = max(reached, stop)
    return point.duration_s - lost


def tally_point(point: PointData, chunk: int = 1_000_000) -> PointTally:
    """Count the answers, latencies, re-arming events and background of one point.

    Parameters
    ----------
    point
        The point; its events are read in chunks of at most `chunk`, and none is kept.
    """
    return tally_events(point, point.events(chunk))


def tally_events(point: PointData, chunks: Iterable[npt.NDArray[np.void]]) -> PointTally:
    """Count in `chunks`, events in order of time, what :func:`tally_point` counts in the events of the point itself.

    Parameters
    ----------
    point
        Says which pixels there were, when the light stepped, and when an answer counts.
    chunks
        Arrays of `EVENT_DTYPE`, for instance of a simulation of this point.
    """
    tests = test_windows(point)
    resets = reset_windows(point, tests)
    roi, active = point.roi, active_pixels(point)
    answered = _Counter(tests, len(tests.groups), roi.pixels, latencies=point.tells_latency)
    rearmed = _Counter(resets, len(tests.groups), roi.pixels, latencies=False)
    pixel_events = np.zeros((2, roi.pixels), np.int64)
    first_half = np.zeros(roi.pixels, np.int64)
    outside = late = 0
    # A recording may end with its last event: that one belongs to it.
    end_us = round(point.duration_s * 1e6)
    for events in chunks:
        x, y = events["x"].astype(np.int64) - roi.x, events["y"].astype(np.int64) - roi.y
        inside = (x >= 0) & (x < roi.width) & (y >= 0) & (y < roi.height)
        outside += int(inside.size - np.count_nonzero(inside))
        after = events["t"] > end_us
        late += int(np.count_nonzero(after))
        pixel = y * roi.width + x
        pixel[~inside] = 0
        keep = inside & ~after & active[pixel] & outside_gaps(events["t"], point.gaps_s)
        t_us, p, pixel = events["t"][keep], events["p"][keep], pixel[keep]
        for polarity in (0, 1):
            pixel_events[polarity] += np.bincount(pixel[p == polarity], minlength=roi.pixels)
        first_half += np.bincount(pixel[t_us < end_us // 2], minlength=roi.pixels)
        answered.add(t_us, p, pixel)
        rearmed.add(t_us, p, pixel)
    return PointTally(
        groups=tuple(_group(i, test, answered, rearmed) for i, test in enumerate(tests.groups)),
        active=active,
        pixel_events=pixel_events,
        observed_s=observed_s(point),
        outside=outside,
        left_out=tests.left_out,
        overlapping=tests.overlapping,
        late=late,
        first_half=first_half,
    )


def _group(index: int, test: TestGroup, answered: _Counter, rearmed: _Counter) -> GroupTally:
    return GroupTally(
        test=test,
        answers=answered.answers[index],
        events=int(answered.events[index]),
        given=answered.given[index],
        followed=answered.followed[index],
        latencies=answered.histogram[index],
        latency_bin_us=answered.bin_us,
        resets=int(np.count_nonzero(rearmed.windows.group == index)),
        rearmed=rearmed.answers[index],
    )
