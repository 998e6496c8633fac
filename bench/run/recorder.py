"""Taking one point: bring the devices there, record, and write the file."""

from __future__ import annotations

import dataclasses
import logging
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from bench.run.alignment import align_to_triggers, moved_windows
from bench.station.station import naming
from bench.store.record import PointRecord, PulseRecord, StimulusRecord
from bench.store.writer import utc_now
from drivers.interfaces import Recording
from protocols.points import ResetTestTiming

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

    from bench.run.plan import PlannedPoint
    from bench.station import Station
    from bench.store.point_writer import PointWriter
    from drivers.events.types import EventChunk
    from drivers.interfaces import PlayedWaveform
    from protocols.points import Point, Roi

__all__ = ["Recorder"]

_log = logging.getLogger("evs_bench.run")


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
        with naming(self._station.light, "set the level"):
            self._station.light.set_level(float(planned.waveform.level[0]))
        self._station.clock.sleep(seconds)

    def take(self, planned: PlannedPoint, writer: PointWriter) -> PointRecord:
        """Record the point, pass its events to `writer` as they come, and return the rest of what is written."""
        station, point = self._station, planned.point
        started = utc_now()
        with naming(station.camera, "start"):
            station.camera.start(Recording(_label(point), planned.waveform.duration_s, point.seed, point.ambient))
        begin = station.clock.now()
        with naming(station.light, "play"):
            played = station.light.play(planned.waveform)
        with naming(station.camera, "stop"):
            station.camera.stop()
        duration_s = round(station.clock.now() - begin, 9)
        triggers = [np.empty((2, 0), np.int64)]
        for chunk in self._chunks():
            writer.append(chunk)
            triggers.append(np.stack([chunk.triggers["t"], chunk.triggers["p"].astype(np.int64)]))
        t_us, p = np.concatenate(triggers, axis=1)
        placed = _on_camera_time(planned, played, t_us, p.astype(np.uint8))
        with naming(station.camera, "say how it went"):
            return self._record(planned, duration_s, started, placed)

    def _chunks(self) -> Iterator[EventChunk]:
        """Yield what the camera recorded; only what it raises itself is put down to it."""
        camera = self._station.camera
        with naming(camera, "read the events"):
            chunks = iter(camera.chunks())
        while True:
            with naming(camera, "read the events"):
                chunk = next(chunks, None)
            if chunk is None:
                return
            yield chunk

    def _move_filter(self, name: str) -> bool:
        if name == self._filter:
            return False
        self._filter = None  # unknown until it has arrived
        with naming(self._station.wheel, f"select filter {name}"):
            self._station.wheel.select(name)
        self._filter = name
        return True

    def _configure(self, planned: PlannedPoint) -> bool:
        """Set biases and window where they differ; return whether they did."""
        changed = False
        camera, roi = self._station.camera, planned.point.roi
        if planned.biases != self._biases:
            self._biases = None
            with naming(camera, "set biases"):
                camera.set_biases(planned.biases)
            self._biases = planned.biases
            changed = True
        if roi != self._window:
            self._window = None
            with naming(camera, "set the window"):
                camera.set_roi(roi)
            self._window = roi
            changed = True
        return changed

    def _record(self, planned: PlannedPoint, duration_s: float, started: str, placed: _Placed) -> PointRecord:
        camera, point = self._station.camera, planned.point
        quality = dataclasses.asdict(camera.quality())
        gaps = quality.pop("gaps_s")
        return PointRecord(
            index=point.index,
            waveform=point.waveform,
            polarity=point.polarity,
            baseline_lux=point.baseline_lux,
            log_contrast=planned.log_contrast,
            duration_s=duration_s,
            nd_od=point.nd_od,
            stimulus=placed.stimulus,
            pulses=placed.pulses,
            refractory_s=self._refractory_s(point),
            temperature_c=camera.temperature_c(),
            roi=None if point.roi == self._roi else point.roi,
            attributes={**self._attributes(planned), "started": started, **placed.attributes},
            bias={name: float(value) for name, value in camera.biases().items()},
            quality={**quality, "gaps": len(gaps), **placed.quality},
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
        calibration = self._station.calibration
        return {
            "measurement": point.measurement,
            "ambient": point.ambient,
            "seed": point.seed,
            "reset_log_contrast": reset,
            "nd_id": planned.filter_name,
            "nd_transmission": self._transmission(planned.filter_name),
            "nd_uncertainty": calibration.filters[planned.filter_name].uncertainty,
            "lux_uncertainty": calibration.light_uncertainty,
        }

    def _transmission(self, filter_name: str) -> float | None:
        """Return the measured transmission of a filter; None where no clear position was measured."""
        clear = [f.name for f in self._station.wheel.filters if f.nd_od == 0.0]
        if not clear:
            return None
        calibration = self._station.calibration
        return calibration.lux_per_level(filter_name) / calibration.lux_per_level(clear[0])


@dataclasses.dataclass(frozen=True, slots=True)
class _Placed:
    """Stimulus and windows on the camera's time axis, and what the file says of how they got there."""

    stimulus: StimulusRecord
    pulses: PulseRecord
    attributes: dict[str, Any]
    quality: dict[str, int]


def _label(point: Point) -> str:
    return f"{point.measurement} {point.index}"


def _on_camera_time(
    planned: PlannedPoint, played: PlayedWaveform, t_us: npt.NDArray[np.int64], p: npt.NDArray[np.uint8]
) -> _Placed:
    """Return the stimulus and the windows on the camera's time axis.

    The triggers place the edges; where they do not fit, or there are none, the edges lie where the source says,
    counted from the beginning.
    """
    stimulus = planned.stimulus
    found = align_to_triggers(played.t_s, t_us, p)
    if found is None:
        t_s, shift, trigger = played.t_s.copy(), 0.0, None
        t_s[0] = 0.0  # the level at the beginning is no edge
        more: dict[str, Any] = {"time_axis": "edges_known"}
        quality = _unmatched(planned, len(t_s) - 1, len(t_us)) if len(t_us) else {}
    else:
        t_s, shift, trigger = found.t_s, found.offset_s, found.trigger
        more = {"time_axis": "trigger", **found.attributes()}
        quality = {"edges_without_trigger": found.lost, "triggers_without_edge": found.extra}
    start, stop = moved_windows(stimulus, t_s)
    host = [
        None if t is None else t + shift for t in (played.t_written_s, played.t_acknowledged_s, played.t_settled_s)
    ]
    record = StimulusRecord(t_s, stimulus.lux, trigger, *host)
    return _Placed(record, PulseRecord(start, stop, stimulus.pulse_kind), more, quality)


def _unmatched(planned: PlannedPoint, edges: int, triggers: int) -> dict[str, int]:
    """Return the counts of a point whose triggers do not fit its edges, and warn where that matters."""
    if edges:
        _log.warning(
            "point %d: triggers (%d) do not fit the edges of the stimulus (%d), which are taken to be where the "
            "source says", planned.point.index, triggers, edges,
        )  # fmt: skip
    return {"edges_without_trigger": edges, "triggers_without_edge": triggers}
