"""One or several runs, opened for comparison and diagnosis."""

from __future__ import annotations

import math
from contextlib import contextmanager
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Final

from bench.compute import Workforce
from bench.diagnosis.expected.catalogue import OF_ALL_PIXELS
from bench.diagnosis.expected.forward import Forward
from bench.diagnosis.expected.parameters import ALIGNMENT
from bench.diagnosis.expected.phases import phases_of
from bench.diagnosis.expected.problem import Problem
from bench.diagnosis.fitting.approach import approach
from bench.diagnosis.fitting.fit import finish, fit
from bench.diagnosis.fitting.in_phase import has_open_ripple, in_phase, tuned
from bench.diagnosis.fitting.judging import deviance_per_dof, leaves_more_than_chance
from bench.diagnosis.fitting.sharpening import asks_for_more, from_here, sharpened
from bench.diagnosis.recorded.excerpt import ENOUGH_EVENTS, beginnings, middles, shortened_text
from bench.diagnosis.recorded.ripple import with_ripple
from bench.diagnosis.recorded.time_grid import time_grid_us
from bench.models.simulation import on_sensor
from protocols.errors import InputError
from sim_backend.pixel.effects.light_flicker import LightFlicker
from sim_backend.pixel.model import PixelModel

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    import numpy as np
    import numpy.typing as npt

    from bench.diagnosis.expected.problem import Slot
    from bench.diagnosis.fitting.fitted import Fit
    from bench.store import Run
    from bench.store.data import PointData, Sensor

__all__ = ["Session", "on_its_clock", "open_session"]

#: Time between two looks of the comparators where the time stamps do not tell it, us.
_USUAL_GRID_US: Final = 10
#: Then a latency is compared no finer than this share of it.
_BLUR: Final = 0.5
#: Events are simulated later or earlier where a fit says so by as much, us, and is not so far off that its offset
#: stands in for something else; so often.
_LATE_US: Final = 3
_STANDS_IN: Final = 1.5
_ROUNDS: Final = 2
#: A fit is made sharper so often at the most, until its error has not fallen by this share so often in a row.
_SHARPENINGS: Final = 5
_BETTER: Final = 0.02
_IDLE: Final = 2


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
    shortened
        How much of the recordings is looked at, where it is not all.
    """

    def __init__(
        self, runs: Sequence[Run], problem: Problem, model: PixelModel, by_eye: bool, shortened: str = ""
    ) -> None:  # fmt: skip
        self.ids = tuple(run.header.id for run in runs)
        self.problem = problem
        self.model = model
        self.by_eye = by_eye
        self.shortened = shortened

    def fit(self, seed: int) -> Fit:
        """Return the model with its free numbers fitted; from then on a ripple has the phase of each recording."""
        slots = self.problem.slots_of(self.model)
        starts = self.problem.starts(self.model, by_eye=self.by_eye)
        found = fit(self.problem, self.model, slots, starts, seed=seed)
        found = self.in_time(found, seed + 6)
        given, has_it = self.problem.given.get(LightFlicker.id), has_open_ripple(self.problem, self.model)
        if given is None or (self.model.effect(LightFlicker.id) is not None and not has_it):
            return found
        models = self.problem.models(found.model.without(LightFlicker.id), found.slots, found.x)
        grid_s = self.problem.forward.dt_s
        phases = phases_of(self.problem.points, models, LightFlicker(**given), grid_s, seed + 7)
        self.problem = replace(self.problem, phases=tuple(phases))
        if not has_it:
            return found
        # Until now it was any phase.
        again = approach(self.problem, self.model, slots, list(found.x), seed=seed + 8, prior=found.start)
        return self.in_phase(finish(self.problem, again), seed + 9)

    def in_time(self, found: Fit, seed: int) -> Fit:
        """Return a fit, or one of events which are simulated as late as it says, if they were not.

        That is as it should be: it is kept unless it leaves more than chance does, and more than the first.
        """
        for number in range(_ROUNDS):
            problem = on_its_clock(self.problem, found.slots, found.x)
            late_us = abs(problem.forward.late_us - self.problem.forward.late_us)
            if late_us < _LATE_US or deviance_per_dof(self.problem, found) > _STANDS_IN:
                break
            again = finish(problem, from_here(problem, found, seed + 10 * number), known=found)
            worse = deviance_per_dof(problem, again) >= deviance_per_dof(self.problem, found)
            if worse and leaves_more_than_chance(problem, again):
                break
            self.problem, found = problem, again
        return found

    def in_phase(self, found: Fit, seed: int) -> Fit:
        """Return a fit, or a better one in which the ripple has the phases that the fitted model asks for."""
        if not has_open_ripple(self.problem, found.model):
            return found
        self.problem, turned = in_phase(self.problem, found, seed)
        # At other phases the fit may have been too far off for its time offset to be believed.
        return found if turned is found else self.in_time(turned, seed + 4)

    def sharpened(self, found: Fit, seed: int) -> Fit:
        """Return a fit, or a better one where more is left than chance leaves, and little was simulated of it."""
        idle = 0
        for number in range(_SHARPENINGS):
            if idle == _IDLE or not asks_for_more(self.problem, found):
                break
            problem, again = self.problem, sharpened(self.problem, found, seed + 10 * number)
            if has_open_ripple(problem, again.model):
                problem, again = tuned(problem, again, seed + 10 * number + 5)
            before, after = deviance_per_dof(self.problem, found), deviance_per_dof(problem, again)
            idle = 0 if after < (1.0 - _BETTER) * before else idle + 1
            if after < before:
                self.problem, found = problem, again
        return found


@contextmanager
def open_session(
    runs: Sequence[Run],
    model: PixelModel | None = None,
    workforce: Workforce | None = None,
    done: Callable[[], None] | None = None,
    *,
    whole: bool = False,
) -> Iterator[Session]:
    """Look at the events of all points, and have the workers ready.

    Parameters
    ----------
    model
        To start from; None for the base pixel alone.
    done
        Called after each simulated sensor.
    whole
        Look at all of long recordings, and not at their beginnings.

    Raises
    ------
    InputError
        There are no points, the runs are of different sensors, or the model limits the readout of windows of which a
        part is looked at.
    """
    taken = _points(runs)
    looked_at = taken if whole else beginnings(middles(taken), ENOUGH_EVENTS)
    if model is not None:
        _check_readout(model, looked_at)
    points = with_ripple(looked_at)
    with (workforce or Workforce()).open() as executor:
        grid_us = time_grid_us(points)
        forward = Forward(points, executor, (grid_us or _USUAL_GRID_US) * 1e-6, done)
        blur_s = 0.0 if grid_us else _BLUR * _USUAL_GRID_US * 1e-6
        sensor = runs[0].header.sensor
        yield Session(
            runs, Problem.of(points, forward, blur_s), on_sensor(model or PixelModel(), sensor), model is None,
            shortened_text(taken, looked_at),
        )  # fmt: skip


def on_its_clock(problem: Problem, slots: Sequence[Slot], at: npt.NDArray[np.float64]) -> Problem:
    """Return the problem with events that are simulated as late as those of the run are.

    What that does to latencies is no straight line where they are not much longer.
    """
    late_s = sum(float(x) for slot, x in zip(slots, at, strict=True) if slot.free.owner == ALIGNMENT)
    forward = problem.forward.later(round(1e6 * late_s))
    # Phases are those at which events go with the ripple as they do in the run: they turn with the events.
    hz = problem.given.get(LightFlicker.id, {}).get("frequency_hz", 0.0)
    turn = 2.0 * math.pi * hz * 1e-6 * (forward.late_us - problem.forward.late_us)
    phases = tuple(None if phase is None else (phase + turn) % (2.0 * math.pi) for phase in problem.phases)
    return replace(problem, forward=forward, phases=phases)


def _points(runs: Sequence[Run]) -> list[PointData]:
    """Return the points of all runs, numbered through."""
    points: list[PointData] = []
    for run in runs:
        if run.header.sensor != runs[0].header.sensor:
            raise InputError(f"{run.folder}: {_unlike(run.header.sensor, runs[0])}; expected runs of one sensor")
        first = 1 + max((p.index for p in points), default=-1)
        points += [replace(p, index=first + p.index) for p in run.points()]
    if not points:
        raise InputError(f"{runs[0].folder}: has no points; expected some that were taken")
    return points


def _unlike(sensor: Sensor, run: Run) -> str:
    """Return in what a sensor is another one than that of a run."""
    other = asdict(run.header.sensor)
    unlike = [f"{name} {value} and {other[name]}" for name, value in asdict(sensor).items() if value != other[name]]
    return f"another sensor than that of {run.folder} ({', '.join(unlike)})"


def _check_readout(model: PixelModel, points: Sequence[PointData]) -> None:
    limits = [effect.id for effect in model.effects if effect.id in OF_ALL_PIXELS]
    for point in points:
        if limits and point.stored_roi is not None:
            raise InputError(
                f"{point.path}: a window of {point.stored_roi.pixels} pixels, of which a part is looked at, and a "
                f"model with {limits[0]}, which shows in all of them; expected --whole, or a model without it"
            )
