"""The model on the bench: every point of the run is simulated and summarised, as often as wanted."""

from __future__ import annotations

import math
import uuid
from collections import Counter
from copy import copy
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.expected.catalogue import before_readout
from bench.diagnosis.expected.remembered import Remembered
from bench.diagnosis.expected.same_law import once_each, representatives
from bench.diagnosis.recorded.recording import Frame, Recording
from bench.diagnosis.recorded.summary import summarise_each
from bench.diagnosis.views.registry import all_views, views
from bench.models.simulation import point_chain, recording_seed
from protocols.points import Roi
from sim_backend.pixel.effects.light_flicker import LightFlicker
from sim_backend.pixel.engines.fast import FastEngine
from sim_backend.pixel.engines.readout import read_out

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence

    import numpy.typing as npt

    from bench.compute import Executor
    from bench.diagnosis.recorded.summary import Summary
    from bench.store.data import PointData
    from sim_backend.pixel.chain import Chain
    from sim_backend.pixel.engines.readout import Batch, Crossings
    from sim_backend.pixel.model import PixelModel

__all__ = ["Forward", "Sensor", "Task", "engine_of"]

#: Sensors that are simulated side by side: of few pixels most of the time goes into calls, not into events; of the
#: same pixels it goes into these, not into what happens behind them.
_TOGETHER: Final = 4

_US_PER_S: Final = 1e6
#: A window is not made smaller than this many pixels on a side.
_FEWEST: Final = 4
#: Noise in the memory of a high-pass is left out up to this corner, beside that of the source follower: to follow it
#: sample by sample would take minutes for each look.
_QUIET_HIGH_PASS: Final = 1.0


@dataclass(frozen=True)
class Sensor:
    """What one simulated sensor showed in all points."""

    summaries: tuple[Summary, ...]  #: of each point
    share: float  #: of the pixels of the run that it has


@dataclass(frozen=True, slots=True)
class Task:
    """Some sensors that take all points of the run, side by side."""

    points: tuple[PointData, ...]
    models: tuple[tuple[PixelModel, ...], ...]  #: of each sensor, of each point
    sensors: tuple[int, ...]  #: their numbers
    dt_s: float
    seed: int
    share: float = 1.0  #: of the pixels
    late_us: int = 0  #: by which events come later than the pixels send them
    run: str = ""  #: tells the points of one run from those of another; empty: nothing is remembered
    shown: bool = False  #: looked at with the views by which no fit goes, too


def engine_of(dt_s: float) -> FastEngine:
    """Return the engine with which models are laid beside a run; the comparators look every `dt_s`."""
    return FastEngine(dt_s, threads=1, quiet_high_pass=_QUIET_HIGH_PASS, steady_leak=True, stepped_light=True)


def sensors_of(task: Task) -> list[Sensor]:
    """Simulate a task; points with the same law are taken once for each sensor."""
    taken = [_Taken(task, models, number) for models, number in zip(task.models, task.sensors, strict=True)]
    found: list[list[Summary]] = [[] for _ in taken]
    whole = task.share >= 1.0  # what pixels do to each other is looked at in one sensor at a time
    with_views = all_views() if task.shown else views()
    for index in range(len(task.points)):
        fresh = [i for i, one in enumerate(taken) if one.is_looked_at(index)]
        if fresh:
            frame = _frame(task, index)
            pixels = _Pixels(taken[i].pixels(index) for i in fresh)
            for some in [[i] for i in fresh] if whole else [fresh]:
                recording = Recording(frame, *(taken[i].events(frame, index, pixels) for i in some))
                for i, summary in zip(some, summarise_each(recording, with_views, whole=whole), strict=True):
                    found[i].append(summary)
        for i, one in enumerate(taken):
            if i not in fresh:
                found[i].append(found[i][one.same[index]])
    pixels_of_all = sum(p.roi.pixels for p in task.points)
    share = sum(_part(p, task.share).roi.pixels for p in task.points) / pixels_of_all
    return [Sensor(tuple(summaries), share) for summaries in found]


class _Taken:
    """One sensor of a task."""

    def __init__(self, task: Task, models: Sequence[PixelModel], number: int) -> None:
        self._task, self._models, self._number = task, models, number
        self.same = representatives(task.points, models)  #: for each point the first one with the same law
        self._engine = engine_of(task.dt_s)
        self._seed = recording_seed(task.seed, number, 0)
        self._chains: dict[Hashable, Chain] = {}  # points at one setting have the same pixels
        self._before = once_each(before_readout, models)
        self._events: dict[int, list[npt.NDArray[np.void]]] = {}  # of laws whose points are looked at one by one

    def is_looked_at(self, index: int) -> bool:
        """Return whether a point is looked at by itself: its law is new, or it is looked at beside its own ripple."""
        return self.same[index] == index or self._ripples(index)

    def pixels(self, index: int) -> Hashable:
        """Return what the comparators' events depend on: sensors that differ behind these alone have the same."""
        return self._number, self._before[index]

    def events(self, frame: Frame, index: int, pixels: _Pixels) -> Iterable[npt.NDArray[np.void]]:
        """Return the events of a point, or those of the first one with the same law."""
        if not self._ripples(index):
            return self._simulated(frame, index, pixels)
        first = self.same[index]
        if first not in self._events:
            self._events[first] = list(self._simulated(frame, index, pixels))
        return self._events[first]

    def _ripples(self, index: int) -> bool:
        """Return whether events go with a ripple, each point's at a phase of its own to the one seen in the run."""
        seen = "ripple_hz" in self._task.points[index].attributes
        return seen and self._models[index].effect(LightFlicker.id) is not None

    def _simulated(self, frame: Frame, index: int, pixels: _Pixels) -> Iterator[npt.NDArray[np.void]]:
        point = frame.point
        chain = self._chain(frame, index)
        seed = recording_seed(self._task.seed, self._number, 1 + point.index)
        crossings = pixels.crossings(
            self.pixels(index), lambda: self._engine.crossings(chain, frame.light, point.duration_s, seed)
        )
        read = read_out(chain, seed, point.duration_s, crossings)
        return _later(read, self._task.late_us, point.duration_s) if self._task.late_us else read

    def _chain(self, frame: Frame, index: int) -> Chain:
        point, model = frame.point, self._models[index]
        key = (id(model), point.roi, point.attributes.get("ambient"))
        if key not in self._chains:
            # A share of the pixels is expected, not drawn: of few hardly any may be hot, or twice as many.
            self._chains[key] = point_chain(point, model, self._seed, even=True)
        return self._chains[key]


def _later(
    batches: Iterable[npt.NDArray[np.void]], late_us: int, duration_s: float
) -> Iterator[npt.NDArray[np.void]]:  # fmt: skip
    """Yield events that come later, or earlier, as far as the recording goes."""
    for events in batches:
        moved = events.copy()
        moved["t"] += late_us
        inside = (moved["t"] >= 0) & (moved["t"] < round(_US_PER_S * duration_s))
        if inside.any():
            yield moved[inside]


class _Pixels:
    """What the comparators of a point send, for sensors that may differ behind these alone: found once for all."""

    def __init__(self, wanted: Iterable[Hashable]) -> None:
        self._wanted = Counter(wanted)
        self._known: dict[Hashable, list[Batch]] = {}

    def crossings(self, pixels: Hashable, found: Callable[[], Crossings]) -> Crossings:
        """Return the comparators' events; only those that are wanted again are kept."""
        if self._wanted[pixels] == 1:
            return found()
        if pixels not in self._known:
            self._known[pixels] = list(found())
        return iter(self._known[pixels])


#: The windows of points that were simulated before in this process.
_FRAMES: dict[tuple[str, int, float], Frame] = {}
_MOST_FRAMES: Final = 4096


def _frame(task: Task, index: int) -> Frame:
    """Return the windows of a point; in each process they are looked for once."""
    if not task.run:
        return Frame(_part(task.points[index], task.share))
    key = (task.run, index, task.share)
    if key not in _FRAMES:
        if len(_FRAMES) >= _MOST_FRAMES:
            _FRAMES.clear()
        _FRAMES[key] = Frame(_part(task.points[index], task.share))
    return _FRAMES[key]


def _part(point: PointData, share: float) -> PointData:
    """Return the point with a smaller window, all of whose pixels are on."""
    if share >= 1.0:
        return point
    roi = point.roi
    width, height = (min(n, max(_FEWEST, math.ceil(n * math.sqrt(share) - 1e-9))) for n in (roi.width, roi.height))
    return replace(point, roi=Roi(roi.x, roi.y, width, height), masked=np.zeros((0, 2), np.uint16))


class Forward:
    """Simulates the points of a run.

    Parameters
    ----------
    points
        Those of the run; their events are not used.
    executor
        Does the simulations.
    dt_s
        The comparators look this often.
    done
        Called after each simulated sensor.
    """

    def __init__(
        self, points: Sequence[PointData], executor: Executor, dt_s: float, done: Callable[[], None] | None = None
    ) -> None:
        self._points = tuple(points)
        self._executor = executor
        self.dt_s = dt_s
        self._done = done
        self._run = uuid.uuid4().hex
        self.late_us = 0  #: by which the events of the run come later than the stimulus says, as far as it is known
        self.shown = False  #: sensors are looked at with the views by which no fit goes, too
        self._remembered: Remembered[Sensor] = Remembered(len(self._points))

    @property
    def engine(self) -> FastEngine:
        """What makes the events of one point."""
        return engine_of(self.dt_s)

    def beside(self, points: Sequence[PointData]) -> Forward:
        """Return the same for other points, simulated by the same workers."""
        other = Forward(points, self._executor, self.dt_s, self._done)
        other.late_us = self.late_us
        return other

    def later(self, late_us: int) -> Forward:
        """Return the same for a run whose events come so much later than the stimulus says, in all."""
        other = copy(self)
        other.late_us = late_us
        return other

    def with_shown(self) -> Forward:
        """Return the same, looked at with the views by which no fit goes, too."""
        other = copy(self)
        other.shown = True
        return other

    def run(
        self,
        models: Sequence[Sequence[PixelModel]],
        seed: int,
        sensors: int = 1,
        share: float | Sequence[float] = 1.0,
    ) -> list[list[Sensor]]:
        """Return what each sensor of each model shows.

        Models that are given together see the same random numbers, so that their differences are sharp. What was
        simulated a short while ago is not simulated again.

        Parameters
        ----------
        models
            For each model what holds at each point.
        seed, sensors
            Sensors of another number, or seed, are others.
        share
            Part of the pixels that is simulated, of all models or of each: quicker, and less certain.
        """
        shares = [share] * len(models) if isinstance(share, float) else list(share)
        names = [tuple(once_each(repr, one)) for one in models]
        keys = {
            (i, s): (names[i], seed, s, shares[i], self.late_us, self.shown)
            for i in range(len(models)) for s in range(sensors)
        }  # fmt: skip
        found = {place: known for place, key in keys.items() if (known := self._remembered.get(key)) is not None}
        pixels = [
            repr([before_readout(m) for m in dict.fromkeys(one)]) if part >= 1.0 else ""
            for one, part in zip(models, shares, strict=True)
        ]
        bundles = _bundles([place for place in keys if place not in found], shares, pixels)
        tasks = [self._task([models[i] for i, _ in some], [s for _, s in some], seed, part) for part, some in bundles]
        for number, taken in self._executor.map(sensors_of, tasks, name=_name):
            for place, sensor in zip(bundles[number][1], taken, strict=True):
                found[place] = sensor
                self._remembered.put(keys[place], sensor)
                if self._done is not None:
                    self._done()
        return [[found[index, sensor] for sensor in range(sensors)] for index in range(len(models))]

    def _task(self, models: Sequence[Sequence[PixelModel]], sensors: Sequence[int], seed: int, share: float) -> Task:
        each = tuple(tuple(one) for one in models)
        return Task(self._points, each, tuple(sensors), self.dt_s, seed, share, self.late_us, self._run, self.shown)


def _bundles(
    wanted: Iterable[tuple[int, int]], shares: Sequence[float], pixels: Sequence[str]
) -> list[tuple[float, list[tuple[int, int]]]]:  # fmt: skip
    """Return which sensors of which models are simulated side by side, with their share of the pixels.

    Whole sensors are only where their pixels are the same: there is enough to do for each of the others.

    Parameters
    ----------
    wanted
        Numbers of model and sensor.
    shares, pixels
        Of each model: part of the pixels; what tells their pixels from those of others.
    """
    places: dict[tuple[float, Hashable], list[tuple[int, int]]] = {}
    for index, sensor in wanted:
        alike = (pixels[index], sensor) if shares[index] >= 1.0 else None
        places.setdefault((shares[index], alike), []).append((index, sensor))
    return [
        (share, mine[first : first + _TOGETHER])
        for (share, _), mine in places.items()
        for first in range(0, len(mine), _TOGETHER)
    ]


def _name(task: Task) -> str:
    return f"sensor {task.sensors[0]}"
