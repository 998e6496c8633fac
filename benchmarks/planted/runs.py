"""The run of a case: what a bench would have left behind, and nothing that tells the truth."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.models.simulation import on_sensor, recording_seed, simulate_point
from bench.store import RunWriter
from bench.store.data import PointData, Sensor
from bench.store.record import PointRecord, PulseRecord, StimulusRecord
from drivers.events.types import EventChunk, empty_triggers
from protocols.points import Roi
from sim_backend.pixel import FastEngine, ReferenceEngine, build_chain
from sim_backend.pixel.effects.light_flicker import LightFlicker
from sim_backend.pixel.light_path import flicker_phase

if TYPE_CHECKING:
    import numpy.typing as npt

    from benchmarks.planted.cases import Case
    from sim_backend.pixel.engines.base import Engine

    Floats = npt.NDArray[np.float64]

__all__ = ["ROI", "SENSOR", "make_run", "phases_in_run", "planned_points"]

SENSOR: Final = Sensor("IMX636", 1280, 720, 4.86e-6, 0.6)
ROI: Final = Roi(600, 300, 16, 16)
_ND_OD: Final = 3.0
#: Number of the pixels among those of a seed: the models that are held against the run have others.
_TRUE_SENSOR: Final = 636


def make_run(case: Case, folder: Path | str) -> Path:
    """Simulate the run of a case, write it to a new folder, and return the folder.

    Raises
    ------
    RunError
        The folder exists, or cannot be written.
    """
    folder = Path(folder)
    points = planned_points(case)
    model, engine = on_sensor(case.model, SENSOR), _engine(case)
    with RunWriter(folder, _header(case)) as writer:
        writer.note_plan([p.index for p in points])
        writer.note("run_started")
        for point in points:
            with writer.point(point.index) as file:
                pixels = recording_seed(case.seed, _TRUE_SENSOR, 0)
                for events in simulate_point(point, model, engine, sensor_seed=pixels, seed=_noise(case, point)):
                    file.append(EventChunk(events, empty_triggers()))
                writer.finish(file, _record(point))
        writer.note("run_finished")
    return folder


def phases_in_run(case: Case) -> list[float | None]:
    """Return the phase that a ripple of the light has at the start of each recording, rad; None: there is none."""
    ripple = case.model.effect(LightFlicker.id)
    if ripple is None:
        return [None for _ in planned_points(case)]
    chain = build_chain(on_sensor(case.model, SENSOR), ROI, sensor_seed=0)
    return [flicker_phase(chain, _noise(case, point)) for point in planned_points(case)]


def planned_points(case: Case) -> list[PointData]:
    """Return the points of a case without their events: constant light first, then contrasts, at each level."""
    plan = case.plan
    found: list[PointData] = []
    for rank, lux in enumerate(sorted(plan.levels_lux)):
        nd_od = _ND_OD if rank < 2 else 0.0
        found.append(_point(len(found), lux, nd_od, 0.0, plan.constant_s, 0, case))
        for contrast in plan.long:
            found.append(_point(len(found), lux, nd_od, contrast, plan.long_s, plan.long_periods, case))
        for contrast in plan.short:
            found.append(_point(len(found), lux, nd_od, contrast, plan.short_s, plan.short_periods, case))
    return found


def _noise(case: Case, point: PointData) -> int:
    """Return the seed of a recording."""
    return recording_seed(case.seed, _TRUE_SENSOR, 1 + point.index)


def _engine(case: Case) -> Engine:
    """Return the engine on one thread: cases run side by side instead."""
    return (ReferenceEngine if case.reference else FastEngine)(dt_s=case.dt_s, threads=1)


def _header(case: Case) -> dict[str, object]:
    return {
        "id": case.name,
        "title": "planted-effect study",
        "sensor": {
            "name": SENSOR.name,
            "width": SENSOR.width,
            "height": SENSOR.height,
            "pixel_pitch_m": SENSOR.pixel_pitch_m,
            "quantum_efficiency": SENSOR.quantum_efficiency,
            "photons_per_lux": SENSOR.photons_per_lux,
        },
        "roi": {"x": ROI.x, "y": ROI.y, "width": ROI.width, "height": ROI.height},
    }


def _point(
    index: int, lux: float, nd_od: float, contrast: float, half_s: float, periods: int, case: Case
) -> PointData:  # fmt: skip
    """Return one point; `half_s` is half a period of a square wave, or all of constant light (contrast 0)."""
    pulses = 2 * periods
    edges: Floats = np.arange(pulses + 1, dtype=np.float64) * half_s
    return PointData(
        path=Path(f"{index:06d}.h5"),
        index=index,
        waveform="square" if pulses else "constant",
        polarity="both",
        baseline_lux=lux,
        log_contrast=contrast,
        duration_s=float((pulses + 1) * half_s),
        nd_od=nd_od,
        refractory_s=case.model.refractory_s,
        temperature_c=math.nan,
        roi=ROI,
        n_events=0,
        stimulus_t_s=edges,
        stimulus_lux=lux * np.exp(contrast * (np.arange(len(edges)) % 2)),
        pulse_start_s=edges[1:],
        pulse_stop_s=edges[1:] + half_s,
        pulse_kind=(np.arange(pulses) % 2).astype(np.uint8),
        pulse_valid=np.ones(pulses, np.bool_),
        pulse_log_contrast=np.full(pulses, contrast),
        triggers_t_us=np.zeros(0, np.int64),
        triggers_p=np.zeros(0, np.uint8),
        masked=np.zeros((0, 2), np.uint16),
        gaps_s=np.zeros((0, 2)),
        bias={},
        quality={},
        attributes={},
    )


def _record(point: PointData) -> PointRecord:
    return PointRecord(
        index=point.index,
        waveform=point.waveform,
        polarity=point.polarity,
        baseline_lux=point.baseline_lux,
        log_contrast=point.log_contrast,
        duration_s=point.duration_s,
        nd_od=point.nd_od,
        refractory_s=point.refractory_s,
        stimulus=StimulusRecord(point.stimulus_t_s, point.stimulus_lux),
        pulses=PulseRecord(point.pulse_start_s, point.pulse_stop_s, point.pulse_kind),
    )
