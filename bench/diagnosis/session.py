"""One or several runs, opened for comparison and diagnosis."""

from __future__ import annotations

import math
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Final

from bench.compute import Workforce
from bench.diagnosis.approach import approach
from bench.diagnosis.fit import finish, fit
from bench.diagnosis.forward import Forward
from bench.diagnosis.phases import phases_of
from bench.diagnosis.problem import Problem
from bench.diagnosis.ripple import with_ripple
from bench.diagnosis.time_grid import time_grid_us
from bench.models.simulation import on_sensor
from protocols.errors import InputError
from sim_backend.pixel.effects.light_flicker import LightFlicker
from sim_backend.pixel.model import PixelModel

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from bench.diagnosis.fitted import Fit
    from bench.store import Run
    from bench.store.data import PointData

__all__ = ["Session", "open_session"]

#: Time between two looks of the comparators where the time stamps do not tell it, us.
_USUAL_GRID_US: Final = 10
#: Then a latency is compared no finer than this share of it.
_BLUR: Final = 0.5
#: Pixels that are looked at, at the most: more sharpen nothing that the pulses do not.
_MOST_PIXELS: Final = 4096
#: Frequencies of a ripple are the same when they agree to this.
_SAME_HZ: Final = 1e-3


class Session:
    """Runs that are explained by one model.

    Parameters
    ----------
    runs
        Of one sensor.
    problem
        All their points.
    model
        To start from, on that sensor.
    by_eye
        Its base numbers are nobody's: those that the curves show by eye are a better start.
    """

    def __init__(self, runs: Sequence[Run], problem: Problem, model: PixelModel, by_eye: bool) -> None:
        self.ids = tuple(run.header.id for run in runs)
        self.problem = problem
        self.model = model
        self.by_eye = by_eye

    def fit(self, seed: int) -> Fit:
        """Return the model with its free numbers fitted; from then on a ripple has the phase of each recording."""
        slots = self.problem.slots_of(self.model)
        starts = self.problem.starts(self.model, by_eye=self.by_eye)
        found = fit(self.problem, self.model, slots, starts, seed=seed)
        given = self.problem.given.get(LightFlicker.id)
        own = self.model.effect(LightFlicker.id)
        if given is None:
            return found
        ripple, hz = LightFlicker(**given), given["frequency_hz"]
        if isinstance(own, LightFlicker) and not math.isclose(own.frequency_hz, hz, rel_tol=_SAME_HZ):
            return found  # the model has another one
        models = self.problem.models(found.model.without(LightFlicker.id), found.slots, found.x)
        grid_s = self.problem.forward.dt_s
        phases = phases_of(self.problem.points, models, ripple, grid_s, seed + 7)
        self.problem = replace(self.problem, phases=tuple(phases))
        if own is None:
            return found
        # Until now it was any phase.
        again = approach(self.problem, self.model, slots, list(found.x), seed=seed + 8, prior=found.start)
        return finish(self.problem, again)


@contextmanager
def open_session(
    runs: Sequence[Run],
    model: PixelModel | None = None,
    workforce: Workforce | None = None,
    done: Callable[[], None] | None = None,
) -> Iterator[Session]:
    """Look at the events of all points, and have the workers ready.

    Parameters
    ----------
    model
        To start from; None for the base pixel alone.
    done
        Called after each simulated sensor.

    Raises
    ------
    InputError
        There are no points, the runs are of different sensors, or a window has too many pixels.
    """
    points = with_ripple(_points(runs))
    with (workforce or Workforce()).open() as executor:
        grid_us = time_grid_us(points)
        forward = Forward(points, executor, (grid_us or _USUAL_GRID_US) * 1e-6, done)
        blur_s = 0.0 if grid_us else _BLUR * _USUAL_GRID_US * 1e-6
        sensor = runs[0].header.sensor
        yield Session(
            runs, Problem.of(points, forward, blur_s), on_sensor(model or PixelModel(), sensor), model is None
        )


def _points(runs: Sequence[Run]) -> list[PointData]:
    """Return the points of all runs, numbered through."""
    points: list[PointData] = []
    for run in runs:
        if run.header.sensor != runs[0].header.sensor:
            raise InputError(f"{run.header.id}: another sensor than that of {runs[0].header.id}; expected the same")
        first = 1 + max((p.index for p in points), default=-1)
        points += [replace(p, index=first + p.index) for p in run.points()]
    if not points:
        raise InputError(f"{runs[0].header.id}: has no points; expected some that were taken")
    for point in points:
        if point.roi.pixels > _MOST_PIXELS:
            raise InputError(
                f"{point.path}: a window of {point.roi.pixels} pixels; expected {_MOST_PIXELS} or fewer (64 x 64)"
            )
    return points
