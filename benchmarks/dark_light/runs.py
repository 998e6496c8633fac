"""A simulated run in memory: its points hold their events."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.models.simulation import on_sensor, recording_seed, simulate_point
from bench.store.data import PointData, RunHeader
from benchmarks.dark_light.settings import ROI_PIXELS, SENSOR, plan_of
from protocols.points import Roi
from protocols.waveforms import reset_test_edges
from sim_backend.pixel import FastEngine

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

    from benchmarks.dark_light.settings import Plan, Setting

__all__ = ["SimulatedRun", "simulate"]

_ROI: Final = Roi(600, 300, ROI_PIXELS, ROI_PIXELS)
_SENSOR_SEED: Final = 636


@dataclass(frozen=True, slots=True)
class _Point(PointData):
    """A point whose events are here."""

    recorded: tuple[npt.NDArray[np.void], ...] = field(default=(), repr=False)

    def events(self, chunk: int = 1_000_000) -> Iterator[npt.NDArray[np.void]]:
        """Yield the events in order."""
        del chunk
        yield from self.recorded


@dataclass(frozen=True)
class SimulatedRun:
    """What analysis needs of a run."""

    header: RunHeader
    taken: tuple[PointData, ...]

    def points(self) -> Iterator[PointData]:
        """Yield the points."""
        yield from self.taken

    def __len__(self) -> int:
        return len(self.taken)


def simulate(setting: Setting, seed: int) -> SimulatedRun:
    """Return a run of a sensor; the same seed gives the same events."""
    model, engine = on_sensor(setting.model, SENSOR), FastEngine(dt_s=1e-5, threads=1)
    pixels = recording_seed(seed, _SENSOR_SEED, 0)
    taken = []
    for index, plan in enumerate(plan_of(setting)):
        point = _point(index, plan, model.refractory_s)
        noise = recording_seed(seed, _SENSOR_SEED, 1 + index)
        taken.append(
            replace(point, recorded=tuple(simulate_point(point, model, engine, sensor_seed=pixels, seed=noise)))
        )
    return SimulatedRun(RunHeader(id=f"{setting.name}-{seed}", sensor=SENSOR, roi=_ROI), tuple(taken))


def _point(index: int, plan: Plan, refractory_s: float) -> _Point:
    light = reset_test_edges(
        baseline_lux=plan.baseline_lux,
        reset_lux=plan.baseline_lux * math.exp(plan.reset_log_contrast),
        test_lux=plan.baseline_lux * math.exp(plan.log_contrast),
        gap_s=plan.gap_s, reset_s=plan.reset_s, test_s=plan.test_s, cycles=plan.pulses,
    )  # fmt: skip
    return _Point(
        path=Path(f"{index:06d}.h5"), index=index, waveform="reset_test", polarity="on",
        baseline_lux=plan.baseline_lux, log_contrast=plan.log_contrast, duration_s=light.duration_s, nd_od=plan.nd_od,
        refractory_s=refractory_s, temperature_c=math.nan, roi=_ROI, n_events=0, stimulus_t_s=light.t_s,
        stimulus_lux=light.lux, pulse_start_s=light.pulse_start_s, pulse_stop_s=light.pulse_stop_s,
        pulse_kind=light.pulse_kind, pulse_valid=np.ones(plan.pulses, np.bool_),
        pulse_log_contrast=np.full(plan.pulses, plan.log_contrast), triggers_t_us=np.zeros(0, np.int64),
        triggers_p=np.zeros(0, np.uint8), masked=np.zeros((0, 2), np.uint16), gaps_s=np.zeros((0, 2)), bias={},
        quality={}, attributes={"reset_log_contrast": plan.reset_log_contrast},
    )  # fmt: skip
