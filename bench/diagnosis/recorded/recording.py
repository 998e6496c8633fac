"""The events of one point, real or simulated, in the form in which views look at them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bench.analysis.tally import active_pixels, observed_s, outside_gaps
from bench.analysis.windows import test_windows
from bench.diagnosis.recorded.ripple import locked
from bench.models.simulation import recorded_light

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    import numpy.typing as npt

    from bench.analysis.windows import TestGroup, TestWindows
    from bench.diagnosis.recorded.ripple import Lock
    from bench.diagnosis.views.base import Statistic, View
    from bench.store.data import PointData
    from sim_backend.pixel.light import LightHistory

    Floats = npt.NDArray[np.float64]
    Ints = npt.NDArray[np.int64]

__all__ = ["Answers", "Frame", "Recording"]

_US_PER_S: Final = 1e6


class Frame:
    """What was done in a point: its pixels and its response windows. The same for all recordings of it."""

    def __init__(self, point: PointData) -> None:
        self.point = point
        self.windows: TestWindows = test_windows(point)
        active = active_pixels(point)
        self.pixels = int(active.sum())  #: that were on
        self.rank: Ints = np.where(active, np.cumsum(active) - 1, -1)  #: (window,) number of each pixel; -1 if off
        self.observed_s = observed_s(point)  #: without gaps
        self._unsaid: dict[str, tuple[Statistic, ...]] = {}

    @cached_property
    def light(self) -> LightHistory:
        """The light of the point."""
        return recorded_light(self.point)

    @cached_property
    def cells(self) -> tuple[tuple[tuple[Ints, ...], tuple[Ints, ...]], Ints]:
        """The windows that ask for OFF and for ON, and how many each group has, as the kernels take them."""
        windows = self.windows
        number = np.zeros(windows.group.size, np.int64)  # of each window in its group
        for group in range(len(windows.groups)):
            mine = np.flatnonzero(windows.group == group)
            number[mine] = np.arange(mine.size)
        each = (windows.start_us, windows.stop_us, windows.edge_us, windows.group, number)
        off, on = (tuple(values[windows.polarity == polarity] for values in each) for polarity in (0, 1))
        return (off, on), np.array([test.pulses for test in windows.groups], np.int64)

    @cached_property
    def lock(self) -> Lock | None:
        """How events go with the ripple of the run, if there is one."""
        found = self.point.attributes.get("ripple_hz")
        return None if found is None else locked(self.point, float(found))

    @property
    def constant(self) -> bool:
        """Whether the light was constant: every event is background."""
        return self.point.waveform == "constant"

    def unsaid(self, view: View, sensors: int) -> list[Statistic]:
        """Return the statistics of a view that say nothing: those of recordings without events."""
        if view.id not in self._unsaid:
            self._unsaid[view.id] = tuple(view.look(Recording(self, [])))
        return [
            replace(s, top=np.tile(s.top, sensors), bottom=np.tile(s.bottom, sensors)) for s in self._unsaid[view.id]
        ]


@dataclass(frozen=True, slots=True)
class Answers:
    """The events in the k response windows of one group of test pulses, for n pixels, of all sensors."""

    test: TestGroup
    own: npt.NDArray[np.int64]  #: (n, k) events of the polarity that is expected
    other: npt.NDArray[np.int64]  #: (n, k) events of the other polarity
    latency_s: Floats  #: (n, k) from the edge to the first event that is expected; NaN without one
    gap_s: Floats  #: (n, k) from the first to the second event that is expected; NaN without one

    @property
    def answered(self) -> npt.NDArray[np.bool_]:
        """(n, k) whether there was an event that is expected."""
        return self.own > 0


class Recording:
    """One recording of a point, for the views; or one of each of several sensors, which takes hardly longer.

    Parameters
    ----------
    frame
        What was done in the point.
    sensors
        Of each sensor arrays of `EVENT_DTYPE`, in order of time. Events outside the window, of pixels that were off,
        behind the end of the recording, or in gaps are left out.
    """

    def __init__(self, frame: Frame, *sensors: Iterable[npt.NDArray[np.void]]) -> None:
        self.frame = frame
        self.sensors = len(sensors)
        self.pixels = len(sensors) * frame.pixels  #: of all sensors, those of the first before those of the next
        t, pixel, p = _gather(frame, sensors)
        if len(frame.point.gaps_s):
            keep = outside_gaps(t, frame.point.gaps_s)
            t, pixel, p = t[keep], pixel[keep], p[keep]
        self.t_us: Ints = t  #: in order of time for each sensor
        self.pixel: Ints = pixel  #: from 0; pixels that were off have no number
        self.p: npt.NDArray[np.uint8] = p  #: 1 ON, 0 OFF

    @cached_property
    def by_pixel(self) -> Ints:
        """Order of the events by pixel, then time."""
        return np.argsort(self.pixel, kind="stable")

    @cached_property
    def groups(self) -> tuple[Answers, ...]:
        """The answers to each group of test pulses."""
        from bench.diagnosis.recorded.answer_kernels import find_answers

        tests, (windows, pulses) = self.frame.windows.groups, self.frame.cells
        if not tests:
            return ()
        ends = np.cumsum(pulses) * self.pixels
        cells = int(ends[-1])
        own, other = np.zeros((2, cells), np.int64)
        first, second = np.full((2, cells), np.nan)
        find_answers(
            self.t_us, self.pixel, self.p, windows, pulses, ends - pulses * self.pixels, own, other, first, second
        )
        each = (np.split(values, ends[:-1]) for values in (own, other, first, second - first))
        return tuple(
            Answers(test, *(one.reshape(self.pixels, test.pulses) for one in mine))
            for test, *mine in zip(tests, *each, strict=True)
        )

    def by_sensor(self, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return values of all pixels, (pixels, ...), with those of each sensor by themselves, (sensors, n, ...)."""
        return values.reshape(self.sensors, self.frame.pixels, *values.shape[1:])

    def about_mean(self, values: npt.NDArray[Any]) -> Floats:
        """Return values of all pixels, (pixels, ...), less the mean of all values of the same sensor."""
        apart = self.by_sensor(values)
        mean = apart.mean(axis=tuple(range(1, apart.ndim)), keepdims=True)
        return np.asarray((apart - mean).reshape(values.shape), np.float64)

    def counts(self, polarity: int, begin: float = 0.0, end: float = 1.0) -> Floats:
        """Return the events of each pixel in a part of the recording, from 0 to 1."""
        span = self.frame.point.duration_s * _US_PER_S
        mine = (self.p == polarity) & (self.t_us >= begin * span) & (self.t_us < end * span)
        if end >= 1.0:
            mine |= (self.p == polarity) & (self.t_us >= span)
        return np.bincount(self.pixel[mine], minlength=self.pixels).astype(np.float64)


def _gather(
    frame: Frame, sensors: Sequence[Iterable[npt.NDArray[np.void]]]
) -> tuple[Ints, Ints, npt.NDArray[np.uint8]]:
    """Return time, number of the pixel, and polarity of all events of pixels that were on."""
    from bench.diagnosis.recorded.answer_kernels import take_inside

    roi = frame.point.roi
    stop_us = round(frame.point.duration_s * _US_PER_S)
    parts = [_room(0)]
    for number, chunks in enumerate(sensors):
        for events in chunks:
            room = _room(len(events))
            count = take_inside(
                events, (roi.x, roi.y), (roi.width, roi.height), frame.rank, stop_us, number * frame.pixels, *room
            )
            parts.append((room[0][:count], room[1][:count], room[2][:count]))
    t, pixel, p = (np.concatenate(column) for column in zip(*parts, strict=True))
    return t, pixel, p


def _room(events: int) -> tuple[Ints, Ints, npt.NDArray[np.uint8]]:
    return np.empty(events, np.int64), np.empty(events, np.int64), np.empty(events, np.uint8)
