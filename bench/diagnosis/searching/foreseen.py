"""Points that were not taken yet, and how far two models of a run would be apart there.

Both are simulated at the run's settings of the camera, in a small window that stands for the run's. The numbers of
the first model may move as far as the run leaves them free, and take up what they can: that is what is left to tell
the two apart once the new points are merged into the diagnosis.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.expected.parameters import ALIGNMENT
from bench.diagnosis.expected.problem import Problem, settings_of
from bench.diagnosis.expected.residuals import measured
from bench.diagnosis.fitting.normal import inverse, solved
from bench.diagnosis.fitting.slopes import sample_of, samples_around, slopes
from bench.diagnosis.fitting.steps import longest_of
from bench.diagnosis.recorded.recording import Frame, Recording
from bench.diagnosis.recorded.summary import summarise
from bench.diagnosis.searching.apart import differences, least_product
from bench.diagnosis.views.registry import views
from bench.models.planned import planned_point
from bench.models.simulation import recording_seed, simulate_point
from protocols.points import Roi

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.diagnosis.fitting.fitted import Fit
    from bench.store.data import PointData
    from protocols.points import Point
    from sim_backend.pixel.model import PixelModel

    Floats = npt.NDArray[np.float64]

__all__ = ["apart_at", "planned_points"]

#: Points that stand for all of a protocol: what tells two models apart goes with their number.
_POINTS: Final = 36
#: Effort of a simulation, and how often the two models are compared.
_EFFORT: Final = 0.6
_TIMES: Final = 3
#: Numbers are moved by so many of the standard errors that the run leaves them.
_MOVED: Final = 2.0
_FARTHEST: Final = 0.3


def planned_points(
    points: Sequence[Point], like: PointData, model: PixelModel, side: int
) -> list[PointData]:  # fmt: skip
    """Return some points of a protocol as they will have been recorded, without their events.

    Parameters
    ----------
    points
        Of the protocol; every few of them are chosen.
    like
        A point of the run: its window and dead time are kept.
    model
        Contrasts are planned in the thresholds that a protocol prescribes: here they are in those of the model.
    side
        Pixels of a side of the window, at the most.
    """
    chosen = [points[i] for i in np.unique(np.linspace(0, len(points) - 1, _POINTS).round().astype(int))]
    return [_planned(replace(p, index=i, preamble=None), like, model, side) for i, p in enumerate(chosen)]


def _planned(point: Point, like: PointData, model: PixelModel, side: int) -> PointData:
    window = Roi(like.roi.x, like.roi.y, min(like.roi.width, side), min(like.roi.height, side))
    seen = replace(point, log_contrast=point.log_contrast * _of_threshold(point, model))
    return replace(planned_point(seen, window, like.refractory_s), temperature_c=like.temperature_c, bias=like.bias)


def _of_threshold(point: Point, model: PixelModel) -> float:
    """Return the model's threshold beside the one that a protocol prescribes; 1 where it prescribes none."""
    off = point.polarity == "off"
    prescribed = point.settings.theta_off if off else point.settings.theta_on
    return (model.theta_off if off else model.theta_on) / prescribed if prescribed else 1.0


def apart_at(
    problem: Problem, fit: Fit, rival: PixelModel, points: Sequence[PointData], of_all: float, seed: int
) -> float:
    """Return by how many standard errors points that were not taken yet would tell a rival from a fitted model.

    Parameters
    ----------
    problem, fit
        The runs so far, and the model fitted to them.
    rival
        A model that they cannot tell from it, with the same base numbers.
    points
        Some points of a protocol, see :func:`planned_points`.
    of_all
        How many pixels and points there are for each that is simulated.
    """
    there = _problem_of(problem, fit, points, seed)
    base = fit.models(there)
    covariance = fit.covariance(problem.measured.points)
    new = _fit_there(there, fit, np.sqrt(np.diag(covariance)), seed + 1)
    (change,) = differences(there, new, base, [[rival] * len(points)], seed + 2, _EFFORT, _TIMES)
    columns = new.whiten(new.jacobian.mean(axis=0), there.measured.points)
    left = columns.T @ columns + _precision(covariance) / of_all
    taken = solved(left, columns.T @ change.T)
    return math.sqrt(max(least_product(change, change - (columns @ taken).T), 0.0) * of_all)


def _problem_of(problem: Problem, fit: Fit, points: Sequence[PointData], seed: int) -> Problem:
    """Return points as a problem, with one recording of the fitted model in the place of what will be measured."""
    forward = problem.forward.beside(points)
    seen = []
    for point in points:
        pixels, noise = recording_seed(seed, 0, 0), recording_seed(seed, 0, 1 + point.index)
        events = simulate_point(point, fit.model, forward.engine, sensor_seed=pixels, seed=noise)
        seen.append(summarise(Recording(Frame(point), events), views()))
    return Problem(
        tuple(points), forward, measured(seen), tuple(settings_of(points)), problem.timing_sd_s, problem.given
    )


def _fit_there(there: Problem, fit: Fit, sd: Floats, seed: int) -> Fit:
    """Return the fitted model at other points: what it expects of them, and how that changes with its numbers.

    Parameters
    ----------
    sd
        (k,) standard errors that the runs leave the numbers.
    """
    slots, at = fit.slots, fit.x
    sensors = there.simulate([there.models(fit.model, slots, at)], seed, _EFFORT)[0]
    here = there.expect(sensors)
    steps = np.minimum(_MOVED * sd, _FARTHEST * longest_of(slots, at))
    directions = np.diag(steps)[:, [slot.free.owner != ALIGNMENT for slot in slots]]
    samples = [
        *samples_around(there, fit.model, slots, at, seed + 1, directions, _EFFORT), sample_of(there, at, sensors)
    ]  # fmt: skip
    return replace(
        fit,
        value=here.value,
        ratio=here.ratio,
        roots=here.roots,
        deviation=here.deviation,
        jacobian=slopes(there, slots, at, here, samples, directions),
        scale=1.0,
        residual=np.zeros_like(here.value),
        frozen=None,
        common=1.0,
    )


def _precision(covariance: Floats) -> Floats:
    """Return the inverse; nothing is known of numbers of infinite variance."""
    known = np.isfinite(np.diag(covariance))
    found = np.zeros_like(covariance)
    found[np.ix_(known, known)] = inverse(covariance[np.ix_(known, known)])[0]
    return found
