"""What chance does to a fit: the scatter of a true model, what is frozen in the pixels, what was simulated twice."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.expected.residuals import expectation, measured
from bench.diagnosis.expected.same_law import representatives
from bench.diagnosis.fitting.fitted import prior_precision, whiten
from bench.diagnosis.fitting.normal import solved
from bench.diagnosis.recorded.summary import add

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.diagnosis.expected.forward import Sensor
    from bench.diagnosis.expected.problem import Problem
    from bench.diagnosis.expected.residuals import Expectation
    from bench.diagnosis.fitting.fitted import Fit
    from bench.diagnosis.recorded.summary import Summary
    from sim_backend.pixel.model import PixelModel

    Flags = npt.NDArray[np.bool_]
    Floats = npt.NDArray[np.float64]

__all__ = ["away_from_mean", "frozen_of", "pooled", "scale_of"]

#: The largest square of a residual that counts for how residuals scatter.
_FAR_OUT: Final = 16.0
#: Places from which all statistics together are this many standard errors away count as close by.
_CLOSE: Final = 20.0


def scale_of(problem: Problem, here: Expectation, sensors: Sequence[Sensor]) -> float:
    """Return the mean square residual of a run of the model itself: each simulated sensor against the others.

    One number far out says nothing about the others: none counts for more than a square of 16. What a sensor says
    nothing about does not count.

    Parameters
    ----------
    here
        What is expected there: how residuals scatter.
    sensors
        All with as many pixels.
    """
    n, of = len(sensors), problem.measured
    transformed = of.kinds.share | of.kinds.count
    squares, expected_squares = 0.0, 0.0
    for i, one in enumerate(sensors):
        others = [s.summaries for k, s in enumerate(sensors) if k != i]
        as_run = measured(one.summaries, of.labels)
        expected = expectation(as_run, [add(column) for column in zip(*others, strict=True)])
        said = np.isfinite(as_run.ratio) & expected.said
        # A share or a count of fewer pixels was transformed to the same scatter; a mean of fewer scatters more.
        fewer = np.where(transformed, 1.0, _fewer(of.bottom, as_run.bottom, others, n))
        away = np.where(said, fewer * (as_run.value - expected.value), 0.0)
        squares += float(np.minimum(whiten(here.roots, away, of.points) ** 2, _FAR_OUT).sum())
        expected_squares += _expected_squares(here, said, of.points)
    # The roots are those of a run less what is expected; here it is less the mean of the other sensors.
    return max(squares / max(expected_squares, 1.0) * here.more / (1.0 + 1.0 / max(n - 1, 1)), 1e-3)


def _fewer(measured: Floats, one: Floats, others: Sequence[Sequence[Summary]], sensors: int) -> Floats:
    """(n,) by what to multiply a difference of means that scatters by the numbers of events of both.

    With as many events as were measured in each sensor it is 1.

    Parameters
    ----------
    measured, one
        (n,) numbers of events.
    others
        Summaries of the sensors from which the mean is taken.
    """
    rest = sum(np.concatenate([s.bottom for s in column]) for column in others)
    scatter = measured * (1.0 / np.maximum(one, 1.0) + 1.0 / np.maximum(rest, 1.0))
    return np.sqrt((1.0 + 1.0 / max(sensors - 1, 1)) / np.maximum(scatter, 1e-12))


def _expected_squares(here: Expectation, said: Flags, points: Sequence[slice]) -> float:
    """Return the expected sum of squares of independent residuals if some statistics are left out.

    It is their number if none is.

    Parameters
    ----------
    said
        (n,) which are not.
    """
    total = 0.0
    for root, covariance, where in zip(here.roots, here.scatter.covariance, points, strict=True):
        mine = said[where]
        left = root[:, mine]
        total += float(np.sum((left @ covariance[np.ix_(mine, mine)]) * left))
    return total * here.more


def away_from_mean(problem: Problem, sensors: Sequence[Sensor]) -> Floats:
    """Return (sensors, n) what each lets expect less their mean; 0 for a statistic of which one says nothing."""
    each = [problem.expect([one]) for one in sensors]
    values = np.stack([e.value for e in each])
    said = np.all([e.said for e in each], axis=0)
    return np.where(said, values - values.mean(axis=0), 0.0)


def frozen_of(problem: Problem, found: Fit, models: Sequence[PixelModel], seen: Sequence[Sequence[Sensor]]) -> Floats:
    """Return by how much the coordinates vary from sensor to sensor for what is frozen in the pixels of all points.

    The covariance of the statistics of each point does not know that points have their pixels in common. What chance
    does to points with other laws is independent; so is what is found in their products.
    """
    points = problem.measured.points
    columns = found.whiten(found.jacobian.mean(axis=0), points)
    left = columns.T @ columns + np.diag(prior_precision(found.slots))
    weights = solved(left, columns.T)
    laws = np.unique(representatives(problem.points, models), return_inverse=True)[1]
    groups = int(laws.max(initial=0)) + 1
    if groups == 1:
        return np.zeros(len(found.x))
    products, freedom = np.zeros(len(found.x)), 0.0
    for sensors in seen:
        for away in away_from_mean(problem, sensors):
            white = found.whiten(away, points)
            each = np.zeros((groups, len(found.x)))
            for law, where in zip(laws, points, strict=True):
                each[law] += weights[:, where] @ white[where]
            products += (each.sum(axis=0) ** 2 - (each**2).sum(axis=0)) * sensors[0].share
        freedom += len(sensors) - 1
    return np.asarray(np.maximum(products / max(freedom, 1.0) * groups / (groups - 1.0), 0.0))


def pooled(
    problem: Problem, visited: Sequence[tuple[Floats, Expectation]], jacobian: Floats, at: Floats
) -> Expectation:  # fmt: skip
    """Return what is expected at a place, from the simulations there and at all places close by.

    How near they are tells how statistics change on the way, not how well they fit: the best ones would be those that
    are by chance what was measured.
    """
    here = next(e for x, e in visited if x is at)
    change = jacobian.mean(axis=0)
    moves = [change @ (at - x) for x, _ in visited]
    far = [float(np.linalg.norm(whiten(here.roots, move, problem.measured.points))) for move in moves]
    close = [(e, move) for (_, e), move, away in zip(visited, moves, far, strict=True) if away <= _CLOSE]
    total = sum(e.recordings for e, _ in close)
    weights = np.stack([e.recordings * e.said for e, _ in close])
    values = np.stack([e.value + move for e, move in close])
    known = weights.sum(axis=0)
    value = np.divide((weights * values).sum(axis=0), known, out=np.zeros_like(known), where=known > 0.0)
    scatter = here.scatter.beside([e.scatter for e, _ in close])
    ratio = np.where(here.said, here.ratio, scatter.ratio)
    return replace(here, ratio=ratio, value=value, recordings=total, scatter=scatter)
