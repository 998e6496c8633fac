"""Taking one point: bring the devices there, record, and write the file."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from bench.run.alignment import align_to_triggers, moved_windows
from bench.store.record import PointRecord, PulseRecord, StimulusRecord
from bench.store.writer import utc_now
from drivers.interfaces import Recording
from protocols.points import ResetTestTiming

if TYPE_CHECKING:
    import numpy.typing as npt

    from bench.run.plan import PlannedPoint
    from bench.station import Station
    from bench.store.point_writer import PointWriter
    from drivers.interfaces import PlayedWaveform
    from protocols.points import Point, Roi

__all__ = ["Recorder"]


class Recorder:
    """Takes points one after the other on a connected station, and changes only what differs between them.

    Parameters
    ----------
    station
        Connected.
    roi
        The run's window; a point with another one says so in its file.
    """

    def __init__(self, station: Station, roi: Roi) -> None:
        self._station = station
        self._roi = roi
        self._filter: str | None = None
        self._biases: dict[str, int] | None = None
        self._window: Roi | None = None
        self._bias_read_back: dict[str, float] = {}

    def prepare(self, planned: PlannedPoint) -> None:
        """Bring filter, biases, window and light to where the point begins, and let them settle."""
        settle = planned.point.settle
        seconds = settle.light_s
        if self._move_filter(planned.filter_name):
            seconds += settle.filter_s
        if self._configure(planned):
            seconds += settle.bias_s
        self._station.light.set_level(float(planned.waveform.level[0]))
        self._station.clock.sleep(seconds)

    def take(self, planned: PlannedPoint, writer: PointWriter) -> PointRecord:
        """Record the point, pass its events to `writer` as they come, and return the rest of what is written."""
        station, point = self._station, planned.point
        started = utc_now()
        station.camera.start(Recording(_label(point), planned.waveform.duration_s, point.seed))
        begin = station.clock.now()
        played = station.light.play(planned.waveform)
        station.camera.stop()
        duration_s = round(station.clock.now() - begin, 9)
        triggers = [np.empty((2, 0), np.int64)]
        for chunk in station.camera.chunks():
            writer.append(chunk)
            triggers.append(np.stack([chunk.triggers["t"], chunk.triggers["p"].astype(np.int64)]))
        t_us, p = np.concatenate(triggers, axis=1)
        stimulus, pulses, more = _on_camera_time(planned, played, t_us, p.astype(np.uint8))
        return self._record(planned, duration_s, stimulus, pulses, {"started": started, **more})

    def _move_filter(self, name: str) -> bool:
        if name == self._filter:
            return False
        self._filter = None  # unknown until it has arrived
        self._station.wheel.select(name)
        self._filter = name
        return True

    def _configure(self, planned: PlannedPoint) -> bool:
        """Set biases and window where they differ; return whether they did."""
        changed = False
        camera, roi = self._station.camera, planned.point.roi
        if planned.biases != self._biases:
            self._biases = None
            camera.set_biases(planned.biases)
            self._biases = planned.biases
            changed = True
        if roi != self._window:
            self._window = None
            camera.set_roi(roi)
            self._window = roi
            changed = True
        return changed

    def _record(
        self,
        planned: PlannedPoint,
        duration_s: float,
        stimulus: StimulusRecord,
        pulses: PulseRecord,
        more: dict[str, Any],
    ) -> PointRecord:
        camera, point = self._station.camera, planned.point
        quality = dataclasses.asdict(camera.quality())
        gaps = quality.pop("gaps_s")
        return PointRecord(
            index=point.index,
            waveform=point.waveform,
            polarity=point.polarity,
            baseline_lux=point.baseline_lux,
            log_contrast=point.log_contrast,
            duration_s=duration_s,
            nd_od=point.nd_od,
            stimulus=stimulus,
            pulses=pulses,
            refractory_s=self._refractory_s(point),
            temperature_c=camera.temperature_c(),
            roi=None if point.roi == self._roi else point.roi,
            attributes={**self._attributes(planned), **more},
            bias={name: float(value) for name, value in camera.biases().items()},
            quality={**quality, "gaps": len(gaps)},
            gaps_s=tuple(gaps),
        )

    def _refractory_s(self, point: Point) -> float:
        """Return the dead time as the device measures it, else as it was asked for, else as the bias map has it."""
        measured = self._station.camera.refractory_s()
        if not math.isnan(measured):
            return measured
        if point.settings.refractory_s is not None:
            return point.settings.refractory_s
        return self._station.calibration.settings_at(self._station.camera.biases()).get("refractory_s", math.nan)

    def _attributes(self, planned: PlannedPoint) -> dict[str, Any]:
        point = planned.point
        reset = point.timing.reset_log_contrast if isinstance(point.timing, ResetTestTiming) else None
        return {
            "measurement": point.measurement,
            "ambient": point.ambient,
            "seed": point.seed,
            "reset_log_contrast": reset,
            "nd_id": planned.filter_name,
            "nd_transmission": self._transmission(planned.filter_name),
        }

    def _transmission(self, filter_name: str) -> float | None:
        """Return the measured transmission of a filter; None where no clear position was measured."""
        clear = [f.name for f in self._station.wheel.filters if f.nd_od == 0.0]
        if not clear:
            return None
        calibration = self._station.calibration
        return calibration.lux_per_level(filter_name) / calibration.lux_per_level(clear[0])


def _label(point: Point) -> str:
    return f"{point.measurement} {point.index}"


def _on_camera_time(
    planned: PlannedPoint, played: PlayedWaveform, t_us: npt.NDArray[np.int64], p: npt.NDArray[np.uint8]
) -> tuple[StimulusRecord, PulseRecord, dict[str, Any]]:
    """Return the stimulus and the windows on the camera's time axis, and the attributes that say how they got there.

    The triggers place the edges; without them the edges lie where the source says, counted from the beginning.
    """
    stimulus = planned.stimulus
    found = align_to_triggers(played.t_s, t_us, p)
    if found is None:
        t_s, shift, trigger = played.t_s.copy(), 0.0, None
        t_s[0] = 0.0  # the level at the beginning is no edge
        more: dict[str, Any] = {"time_axis": "edges_known"}
    else:
        t_s, shift, trigger = found.t_s, found.offset_s, found.trigger
        more = {"time_axis": "trigger", **found.attributes()}
    start, stop = moved_windows(stimulus, t_s)
    host = [
        None if t is None else t + shift for t in (played.t_written_s, played.t_acknowledged_s, played.t_settled_s)
    ]
    record = StimulusRecord(t_s, stimulus.lux, trigger, *host)
    return record, PulseRecord(start, stop, stimulus.pulse_kind), more
