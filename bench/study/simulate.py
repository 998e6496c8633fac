"""The points of a protocol, taken from a simulated pixel: a run in memory, without devices between."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.store.data import PointData, RunHeader, Sensor
from protocols.waveforms import stimulus_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import numpy.typing as npt

    from protocols.points import Point
    from sim_backend.pixel import Chain, PixelModel
    from sim_backend.pixel.engines.base import Engine

__all__ = ["SimulatedRun"]

_SENSOR_SEED: Final = 636
_SENSOR_SIDE: Final = 65536
_NOWHERE: Final = Path("simulated")


@dataclass(frozen=True, slots=True)
class _SimulatedPoint(PointData):
    """A point whose events are made when they are read; read again, they are the same."""

    chain: Chain
    engine: Engine
    seed: int

    def events(self, chunk: int = 1_000_000) -> Iterator[npt.NDArray[np.void]]:
        """Yield the events in order, at most `chunk` at a time."""
        from bench.models.simulation import recorded_light

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
        from sim_backend.pixel import build_chain

        light = stimulus_of(point)
        pulses = len(light.pulse_start_s)
        return _SimulatedPoint(
            path=_NOWHERE,
            index=point.index,
            waveform=point.waveform,
            polarity=point.polarity,
            baseline_lux=point.baseline_lux,
            log_contrast=point.log_contrast,
            duration_s=light.duration_s,
            nd_od=point.nd_od,
            refractory_s=self.model.refractory_s,
            temperature_c=math.nan,
            roi=point.roi,
            n_events=0,
            stimulus_t_s=light.t_s,
            stimulus_lux=light.lux,
            pulse_start_s=light.pulse_start_s,
            pulse_stop_s=light.pulse_stop_s,
            pulse_kind=light.pulse_kind,
            pulse_valid=np.ones(pulses, np.bool_),
            pulse_log_contrast=np.full(pulses, point.log_contrast),
            triggers_t_us=np.zeros(0, np.int64),
            triggers_p=np.zeros(0, np.uint8),
            masked=np.zeros((0, 2), np.uint16),
            gaps_s=np.zeros((0, 2)),
            bias={},
            quality={},
            attributes={},
            chain=build_chain(self.model, point.roi, _SENSOR_SEED),
            engine=self._engine,
            seed=point.seed,
        )
