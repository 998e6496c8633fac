"""The events of one point, real or simulated, in the form in which views look at them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bench.analysis.tally import active_pixels, observed_s, outside_gaps
from bench.analysis.windows import test_windows, window_of
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
        self.local = np.zeros(self.windows.group.size, np.int64)  #: (w,) number of each window in its group
        for group in range(len(self.windows.groups)):
            mine = np.flatnonzero(self.windows.group == group)
            self.local[mine] = np.arange(mine.size)
        self._unsaid: dict[str, tuple[Statistic, ...]] = {}

    @cached_property
    def light(self) -> LightHistory:
        """The light of the point."""
        return recorded_light(self.point)

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
        point = frame.point
        t, pixel, p, sensor = _gather(sensors, point)
        rank = frame.rank[pixel]
        keep = (rank >= 0) & (t <= round(point.duration_s * _US_PER_S))
        keep &= outside_gaps(t, point.gaps_s)
        self.t_us: Ints = t[keep]  #: in order of time for each sensor
        self.pixel: Ints = (rank + sensor * frame.pixels)[keep]  #: from 0; pixels that were off have no number
        self.p: npt.NDArray[np.uint8] = p[keep]  #: 1 ON, 0 OFF

    @cached_property
    def by_pixel(self) -> Ints:
        """Order of the events by pixel, then time."""
        return np.argsort(self.pixel, kind="stable")

    @cached_property
    def groups(self) -> tuple[Answers, ...]:
        """The answers to each group of test pulses."""
        own = window_of(self.frame.windows, self.t_us, self.p)
        other = window_of(self.frame.windows, self.t_us, 1 - self.p)
        return tuple(self._answers(g, own, other) for g in range(len(self.frame.windows.groups)))

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

    def _answers(self, group: int, own: Ints, other: Ints) -> Answers:
        frame, windows = self.frame, self.frame.windows
        test = windows.groups[group]
        shape = (self.pixels, test.pulses)

        def cells(window: Ints) -> tuple[Ints, Ints]:
            events = np.flatnonzero((window >= 0) & (windows.group[window] == group))
            return events, self.pixel[events] * test.pulses + frame.local[window[events]]

        events, cell = cells(own)
        latency = (self.t_us[events] - windows.edge_us[own[events]]) / _US_PER_S
        first = np.full(shape[0] * shape[1], np.nan)
        first[cell[::-1]] = latency[::-1]  # the last one written is the first one in time
        later = latency > first[cell]
        second = np.full(first.size, np.nan)
        second[cell[later][::-1]] = latency[later][::-1]
        wrong = cells(other)[1]
        return Answers(
            test=test,
            own=np.bincount(cell, minlength=first.size).reshape(shape),
            other=np.bincount(wrong, minlength=first.size).reshape(shape),
            latency_s=first.reshape(shape),
            gap_s=(second - first).reshape(shape),
        )


def _gather(
    sensors: Sequence[Iterable[npt.NDArray[np.void]]], point: PointData
) -> tuple[Ints, Ints, npt.NDArray[np.uint8], Ints]:
    """Return time, pixel of the window, polarity and number of the sensor of all events inside the window."""
    roi = point.roi
    parts = [(np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0, np.uint8), np.empty(0, np.int64))]
    for number, chunks in enumerate(sensors):
        for events in chunks:
            x, y = events["x"].astype(np.int64) - roi.x, events["y"].astype(np.int64) - roi.y
            inside = (x >= 0) & (x < roi.width) & (y >= 0) & (y < roi.height)
            t, pixel, p = events["t"][inside].astype(np.int64), (y * roi.width + x)[inside], events["p"][inside]
            parts.append((t, pixel, p, np.full(t.size, number)))
    t, pixel, p, sensor = (np.concatenate(column) for column in zip(*parts, strict=True))
    return t, pixel, p, sensor
