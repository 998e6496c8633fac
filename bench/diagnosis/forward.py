"""The model on the bench: every point of the run is simulated and summarised, as often as wanted."""

from __future__ import annotations

import math
import uuid
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.recording import Frame, Recording
from bench.diagnosis.same_law import representatives
from bench.diagnosis.summary import summarise_each
from bench.diagnosis.views.registry import views
from bench.models.simulation import point_chain, recording_seed
from protocols.points import Roi
from sim_backend.pixel.engines.fast import FastEngine

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Iterator, Sequence

    import numpy.typing as npt

    from bench.compute import Executor
    from bench.diagnosis.summary import Summary
    from bench.store.data import PointData
    from sim_backend.pixel.chain import Chain
    from sim_backend.pixel.model import PixelModel

__all__ = ["Forward", "Sensor", "Task", "engine_of"]

#: Sensors of few pixels that are simulated side by side: most of the time goes into calls, not into events.
_TOGETHER: Final = 4

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
    run: str = ""  #: tells the points of one run from those of another; empty: nothing is remembered


def engine_of(dt_s: float) -> FastEngine:
    """Return the engine with which models are laid beside a run; the comparators look every `dt_s`."""
    return FastEngine(dt_s, threads=1, quiet_high_pass=_QUIET_HIGH_PASS, steady_leak=True, stepped_light=True)


def sensors_of(task: Task) -> list[Sensor]:
    """Simulate a task; points with the same law are taken once for each sensor."""
    taken = [_Taken(task, models, number) for models, number in zip(task.models, task.sensors, strict=True)]
    found: list[list[Summary]] = [[] for _ in taken]
    for index in range(len(task.points)):
        fresh = [i for i, one in enumerate(taken) if one.same[index] == index]
        if fresh:
            frame = _frame(task, index)
            recording = Recording(frame, *(taken[i].events(frame, index) for i in fresh))
            summaries = summarise_each(recording, views(), whole=task.share >= 1.0)
            for i, summary in zip(fresh, summaries, strict=True):
                found[i].append(summary)
        for i, one in enumerate(taken):
            if one.same[index] < index:
                found[i].append(found[i][one.same[index]])
    whole = sum(p.roi.pixels for p in task.points)
    share = sum(_part(p, task.share).roi.pixels for p in task.points) / whole
    return [Sensor(tuple(summaries), share) for summaries in found]


class _Taken:
    """One sensor of a task."""

    def __init__(self, task: Task, models: Sequence[PixelModel], number: int) -> None:
        self._task, self._models, self._number = task, models, number
        self.same = representatives(task.points, models)  #: for each point the first one with the same law
        self._engine = engine_of(task.dt_s)
        self._seed = recording_seed(task.seed, number, 0)
        self._chains: dict[Hashable, Chain] = {}  # points at one setting have the same pixels

    def events(self, frame: Frame, index: int) -> Iterator[npt.NDArray[np.void]]:
        """Yield the events of a point."""
        point, model = frame.point, self._models[index]
        pixels = (id(model), point.roi, point.attributes.get("ambient"))
        if pixels not in self._chains:
            self._chains[pixels] = point_chain(point, model, self._seed)
        seed = recording_seed(self._task.seed, self._number, 1 + point.index)
        return self._engine.events(self._chains[pixels], frame.light, point.duration_s, seed)


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
        self.simulated = 0  #: sensors so far

    @property
    def engine(self) -> FastEngine:
        """What makes the events of one point."""
        return engine_of(self.dt_s)

    def beside(self, points: Sequence[PointData]) -> Forward:
        """Return the same for other points, simulated by the same workers."""
        return Forward(points, self._executor, self.dt_s, self._done)

    def run(
        self,
        models: Sequence[Sequence[PixelModel]],
        seed: int,
        sensors: int = 1,
        share: float | Sequence[float] = 1.0,
    ) -> list[list[Sensor]]:
        """Return what each sensor of each model shows.

        Models that are given together see the same random numbers, so that their differences are sharp.

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
        found: dict[tuple[int, int], Sensor] = {}
        bundles = _bundles(shares, sensors)
        tasks = [self._task([models[i] for i, _ in some], [s for _, s in some], seed, part) for part, some in bundles]
        for number, taken in self._executor.map(sensors_of, tasks, name=_name):
            for place, sensor in zip(bundles[number][1], taken, strict=True):
                found[place] = sensor
                self.simulated += 1
                if self._done is not None:
                    self._done()
        return [[found[index, sensor] for sensor in range(sensors)] for index in range(len(models))]

    def _task(self, models: Sequence[Sequence[PixelModel]], sensors: Sequence[int], seed: int, share: float) -> Task:
        each = tuple(tuple(one) for one in models)
        return Task(self._points, each, tuple(sensors), self.dt_s, seed, share, self._run)


def _bundles(shares: Sequence[float], sensors: int) -> list[tuple[float, list[tuple[int, int]]]]:
    """Return which sensors of which models are simulated side by side, with their share of the pixels."""
    places: dict[float, list[tuple[int, int]]] = {}
    for index, share in enumerate(shares):
        places.setdefault(share, []).extend((index, sensor) for sensor in range(sensors))
    found = []
    for share, mine in places.items():
        size = 1 if share >= 1.0 else _TOGETHER
        found += [(share, mine[first : first + size]) for first in range(0, len(mine), size)]
    return found


def _name(task: Task) -> str:
    return f"sensor {task.sensors[0]}"
