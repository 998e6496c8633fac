"""Comparing a run with a model: every point is simulated with its own stimulus and counted in the same way."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.analysis.tally import tally_events, tally_point
from bench.models.comparison import Compared, Comparison, PixelCovariance
from bench.models.simulation import on_sensor, recording_seed, simulate_point
from bench.models.views import pixel_views
from protocols.errors import InputError
from sim_backend.pixel.engines.fast import FastEngine
from sim_backend.pixel.model import PixelModel

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Sequence

    import numpy.typing as npt

    from bench.analysis.whole import RunLike
    from bench.models.simulation import ModelOf
    from bench.models.views import PixelView
    from bench.store.data import PointData
    from sim_backend.pixel.engines.base import Engine

__all__ = ["compare_run"]

_FEWEST_PIXELS: Final = 2


def compare_run(
    run: RunLike,
    model: PixelModel | ModelOf,
    *,
    engine: Engine | None = None,
    sensors: int = 4,
    seed: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Comparison:
    """Simulate each point of a run and lay what was measured beside it.

    The events of the simulation are counted by the same code as those of the run. Its standard errors are those that
    the model expects: from the variance between its pixels, as the pulses of one pixel are not independent. Each
    simulated sensor takes all points, so that what is frozen in a pixel is the same in all of them.

    Parameters
    ----------
    run
        An opened run; its stimulus, windows, filters, ambient light and sensor are used, never its station.
    model
        The pixel, or a function that returns it for a point, where thresholds, bandwidth or dead time differ between
        settings (:func:`bench.models.simulation.with_recorded_dead_time` is one). The photoconversion is replaced by
        that of the run's sensor.
    engine
        Makes the events; None for the fast engine on its own grid of times.
    sensors
        How many sensors are simulated, each with as many pixels as the window of the point. The expected values are
        sharper than the measured ones by its square root.
    seed
        Of all random numbers of the simulation, 0 or more.
    progress
        Called with how many recordings are simulated, and of how many.

    Raises
    ------
    InputError
        The run has points at several settings and there is only one model, a point has no stimulus, or fewer than
        two pixels would be simulated.
    bench.store.errors.RunError
        A file of the run is damaged.
    """
    points = list(run.points())
    models = [on_sensor(m, run.header.sensor) for m in _models(points, model)]
    maker = engine if engine is not None else FastEngine()
    views = [pixel_views(point, tally_point(point)) for point in points]
    groups = _same_pixels(points, views)
    moments = [_Moments(len(group)) for group in groups]
    for sensor in range(_sensors(sensors)):
        simulated: list[tuple[PixelView, ...]] = []
        for i, point in enumerate(points):
            if progress is not None:
                progress(sensor * len(points) + i, sensors * len(points))
            events = simulate_point(
                point,
                models[i],
                maker,
                sensor_seed=recording_seed(seed, sensor, 0),
                seed=recording_seed(seed, sensor, 1 + point.index),
            )
            simulated.append(pixel_views(point, tally_events(point, events)))
        for group, sums in zip(groups, moments, strict=True):
            sums.add(np.array([simulated[i][j].values for i, j in group]))
    return _comparison(run.header.id, points, views, groups, moments)


def _sensors(sensors: int) -> int:
    if sensors < 1:
        raise InputError(f"{sensors} simulated sensors; expected 1 or more")
    return sensors


def _models(points: Sequence[PointData], model: PixelModel | ModelOf) -> list[PixelModel]:
    """Return the model of each point."""
    if not isinstance(model, PixelModel):
        return [model(point) for point in points]
    for point in points:
        for what, one, first in (
            ("bias setting", point.bias, points[0].bias),
            ("dead time", repr(point.refractory_s), repr(points[0].refractory_s)),
        ):
            if one != first:
                raise InputError(
                    f"{point.path}: another {what} than in {points[0].path.name}, but one model for all points; "
                    "expected a model for each setting"
                )
    return [model] * len(points)


def _same_pixels(points: Sequence[PointData], views: Sequence[Sequence[PixelView]]) -> list[list[tuple[int, int]]]:
    """Return point and view of all numbers, in groups that come from the same pixels."""
    groups: dict[Hashable, list[tuple[int, int]]] = {}
    for i, point in enumerate(points):
        key = (point.roi, point.masked.tobytes())
        groups.setdefault(key, []).extend((i, j) for j in range(len(views[i])))
    return [group for group in groups.values() if group]


class _Moments:
    """Mean and covariance over pixels, of many numbers for each."""

    def __init__(self, numbers: int) -> None:
        self.pixels = 0
        self._sum = np.zeros(numbers)
        self._products = np.zeros((numbers, numbers))

    def add(self, values: npt.NDArray[np.float64]) -> None:
        """Take more pixels in; `values` is (numbers, pixels)."""
        self.pixels += values.shape[1]
        self._sum += values.sum(axis=1)
        self._products += values @ values.T

    def mean(self) -> npt.NDArray[np.float64]:
        return self._sum / self.pixels

    def covariance(self) -> npt.NDArray[np.float64]:
        mean = self.mean()
        return np.asarray((self._products - self.pixels * np.outer(mean, mean)) / (self.pixels - 1))


def _comparison(
    run_id: str,
    points: Sequence[PointData],
    views: Sequence[Sequence[PixelView]],
    groups: Sequence[Sequence[tuple[int, int]]],
    moments: Sequence[_Moments],
) -> Comparison:
    order = {ij: row for row, ij in enumerate((i, j) for i, mine in enumerate(views) for j in range(len(mine)))}
    compared: dict[int, Compared] = {}
    covariances = []
    for group, sums in zip(groups, moments, strict=True):
        if sums.pixels < _FEWEST_PIXELS:
            raise InputError(f"{sums.pixels} simulated pixels; expected {_FEWEST_PIXELS} or more")
        mean, covariance = sums.mean(), sums.covariance()
        rows = [order[ij] for ij in group]
        for k, (i, j) in enumerate(group):
            variance = max(float(covariance[k, k]), 0.0)
            compared[rows[k]] = _compared(points[i], views[i][j], float(mean[k]), variance, sums.pixels)
        measured = views[group[0][0]][group[0][1]].values.size
        covariances.append(PixelCovariance(np.array(rows), covariance, measured, sums.pixels))
    return Comparison(run_id, tuple(compared[row] for row in sorted(compared)), tuple(covariances))


def _compared(point: PointData, view: PixelView, expected: float, variance: float, simulated: int) -> Compared:
    """Return one view beside its expectation. Finer than by one answer of all, a share is neither known nor made."""
    pixels = view.values.size
    return Compared(
        point=point.index,
        view=view.view,
        baseline_lux=point.baseline_lux,
        log_contrast=view.log_contrast,
        width_s=view.width_s,
        pulses=view.pulses,
        pixels=pixels,
        measured=float(view.values.mean()),
        expected=expected,
        standard_error=max(math.sqrt(variance / pixels), view.least / pixels),
        monte_carlo_error=max(math.sqrt(variance / simulated), view.least / simulated),
    )
