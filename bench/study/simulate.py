"""The points of a protocol, taken from a simulated pixel: a run in memory, without devices between."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Final

from bench.models.planned import planned_point
from bench.models.simulation import point_chain, recorded_light
from bench.store.data import PointData, RunHeader, Sensor

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import numpy as np
    import numpy.typing as npt

    from protocols.points import Point
    from sim_backend.pixel import Chain, PixelModel
    from sim_backend.pixel.engines.base import Engine

__all__ = ["SimulatedRun"]

_SENSOR_SEED: Final = 636
_SENSOR_SIDE: Final = 65536


@dataclass(frozen=True, slots=True)
class _SimulatedPoint(PointData):
    """A point whose events are made when they are read; read again, they are the same."""

    chain: Chain
    engine: Engine
    seed: int

    def events(self, chunk: int = 1_000_000) -> Iterator[npt.NDArray[np.void]]:
        """Yield the events in order, at most `chunk` at a time."""
        for events in self.engine.events(self.chain, recorded_light(self), self.duration_s, self.seed):
            for start in range(0, len(events), chunk):
                yield events[start : start + chunk]


class SimulatedRun:
    """What :func:`bench.analysis.analyze` reads: the points, simulated one after the other.

    Parameters
    ----------
    points
        One recording each. Their settings are not looked at: `model` says what the pixel is.
    model
        The pixel.
    engine
        What makes events of it.
    title
        Of the run.
    """

    def __init__(self, points: Sequence[Point], model: PixelModel, engine: Engine, title: str) -> None:
        self._points = tuple(points)
        self.model = model
        self._engine = engine
        conversion = model.photoconversion
        sensor = Sensor(
            "simulated", _SENSOR_SIDE, _SENSOR_SIDE, conversion.pitch_m, conversion.eta, conversion.photons_per_lux
        )
        self.header = RunHeader(id=title, sensor=sensor, roi=self._points[0].roi, title=title)

    def __len__(self) -> int:
        return len(self._points)

    def points(self) -> Iterator[PointData]:
        """Yield the points; each simulates itself when its events are read."""
        for point in self._points:
            yield self._taken(point)

    def _taken(self, point: Point) -> PointData:
        planned = planned_point(point, point.roi, self.model.refractory_s)
        return _SimulatedPoint(
            **{field.name: getattr(planned, field.name) for field in fields(planned)},
            chain=point_chain(planned, self.model, _SENSOR_SEED),
            engine=self._engine,
            seed=point.seed,
        )
