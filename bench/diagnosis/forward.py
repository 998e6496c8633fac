"""The model on the bench: every point of the run is simulated and summarised, as often as wanted."""

from __future__ import annotations

import math
import uuid
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.recording import Frame, Recording
from bench.diagnosis.same_law import representatives
from bench.diagnosis.summary import summarise
from bench.diagnosis.views.registry import VIEWS
from bench.models.simulation import point_chain, recording_seed
from protocols.points import Roi
from sim_backend.pixel.engines.fast import FastEngine

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Sequence

    from bench.compute import Executor
    from bench.diagnosis.summary import Summary
    from bench.store.data import PointData
    from sim_backend.pixel.chain import Chain
    from sim_backend.pixel.model import PixelModel

__all__ = ["Forward", "Sensor", "Task"]

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
    """One sensor that takes all points of the run."""

    points: tuple[PointData, ...]
    models: tuple[PixelModel, ...]  #: of each point
    dt_s: float
    seed: int
    sensor: int
    share: float = 1.0  #: of the pixels
    run: str = ""  #: tells the points of one run from those of another; empty: nothing is remembered


def sensor_of(task: Task) -> Sensor:
    """Simulate a task; points with the same law are taken once."""
    engine = FastEngine(task.dt_s, threads=1, quiet_high_pass=_QUIET_HIGH_PASS)
    sensor_seed = recording_seed(task.seed, task.sensor, 0)
    chains: dict[Hashable, Chain] = {}  # points at one setting have the same pixels
    found: list[Summary] = []
    for index, same in enumerate(representatives(task.points, task.models)):
        if same < index:
            found.append(found[same])
            continue
        frame, model = _frame(task, index), task.models[index]
        point = frame.point
        pixels = (id(model), point.roi, point.attributes.get("ambient"))
        if pixels not in chains:
            chains[pixels] = point_chain(point, model, sensor_seed)
        seed = recording_seed(task.seed, task.sensor, 1 + point.index)
        events = engine.events(chains[pixels], frame.light, point.duration_s, seed)
        found.append(summarise(Recording(frame, events), VIEWS, labelled=False))
    whole = sum(p.roi.pixels for p in task.points)
    return Sensor(tuple(found), sum(_part(p, task.share).roi.pixels for p in task.points) / whole)


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
        tasks = [
            Task(self._points, tuple(m), self.dt_s, seed, s, part, self._run)
            for m, part in zip(models, shares, strict=True)
            for s in range(sensors)
        ]
        found: list[list[Sensor]] = [[] for _ in models]
        for index, sensor in self._executor.map(sensor_of, tasks, ordered=True, name=_name):
            found[index // sensors].append(sensor)
            self.simulated += 1
            if self._done is not None:
                self._done()
        return found


def _name(task: Task) -> str:
    return f"sensor {task.sensor}"
