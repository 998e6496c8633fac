"""The model on the bench: every point of the run is simulated and summarised, as often as wanted."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from bench.diagnosis.recording import Frame, Recording
from bench.diagnosis.summary import summarise
from bench.diagnosis.views.registry import VIEWS
from bench.models.simulation import recording_seed, simulate_point
from sim_backend.pixel.engines.fast import FastEngine

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from bench.compute import Executor
    from bench.diagnosis.summary import Summary
    from bench.store.data import PointData
    from sim_backend.pixel.model import PixelModel

__all__ = ["Forward", "Task"]


@dataclass(frozen=True, slots=True)
class Task:
    """One sensor that takes all points of the run."""

    points: tuple[PointData, ...]
    models: tuple[PixelModel, ...]  #: of each point
    dt_s: float
    seed: int
    sensor: int


def summaries_of(task: Task) -> list[Summary]:
    """Simulate a task."""
    engine = FastEngine(task.dt_s, threads=1)
    found = []
    for point, model in zip(task.points, task.models, strict=True):
        events = simulate_point(
            point,
            model,
            engine,
            sensor_seed=recording_seed(task.seed, task.sensor, 0),
            seed=recording_seed(task.seed, task.sensor, 1 + point.index),
        )
        found.append(summarise(Recording(Frame(point), events), VIEWS))
    return found


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
        self.simulated = 0  #: sensors so far

    def run(self, models: Sequence[Sequence[PixelModel]], seed: int, sensors: int = 1) -> list[list[list[Summary]]]:
        """Return the summaries of all points, for each sensor of each model.

        Models that are given together see the same random numbers, so that their differences are sharp.

        Parameters
        ----------
        models
            For each model what holds at each point.
        seed, sensors
            Sensors of another number, or seed, are others.
        """
        tasks = [Task(self._points, tuple(m), self.dt_s, seed, s) for m in models for s in range(sensors)]
        found: list[list[list[Summary]]] = [[] for _ in models]
        for index, summaries in self._executor.map(summaries_of, tasks, ordered=True, name=_name):
            found[index // sensors].append(summaries)
            self.simulated += 1
            if self._done is not None:
                self._done()
        return found


def _name(task: Task) -> str:
    return f"sensor {task.sensor}"
