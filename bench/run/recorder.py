"""Taking one point: bring the devices there, record, and write the file."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bench.alignment.counts import EventCounts
from bench.alignment.latency import Answering
from bench.alignment.placing import PlacedEdges, Taken, place_edges
from bench.alignment.triggers import moved_windows
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

_TIME_CONSTANTS: Final = math.log(9.0)  #: from 10 % to 90 % of a step


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
        started, before_c = utc_now(), station.camera.temperature_c()
        with naming(station.camera, "start"):
            station.camera.start(Recording(_label(point), planned.waveform.duration_s, point.seed, point.ambient))
        begin = station.clock.now()
        with naming(station.light, "play"):
            played = station.light.play(planned.waveform)
        play_s = station.clock.now() - begin
        with naming(station.camera, "stop"):
            station.camera.stop()
        duration_s = round(station.clock.now() - begin, 9)
        t_us, p = self._received(writer)
        taken = Taken(
            name=f"point {point.index}",
            edges_s=played.t_s,
            lux=planned.stimulus.lux,
            trigger_t_us=t_us,
            trigger_p=p,
            marks_s=played.trigger_t_s,
            duration_s=duration_s,
            latest_s=max(0.0, play_s - planned.waveform.duration_s),
            answering=self._answering(point),
            counted=lambda: _counted(writer),
        )
        placed = _Placed.of(planned, played, place_edges(taken))
        with naming(station.camera, "say how it went"):
            return self._record(
                planned, duration_s, placed, {"started": started, **_known("temperature_before_c", before_c)}
            )

    def _received(self, writer: PointWriter) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.uint8]]:
        """Pass what the camera recorded to `writer`; return times (us) and polarities of the triggers."""
        triggers = [np.empty((2, 0), np.int64)]
        for chunk in self._chunks():
            writer.append(chunk)
            triggers.append(np.stack([chunk.triggers["t"], chunk.triggers["p"].astype(np.int64)]))
        t_us, p = np.concatenate(triggers, axis=1)
        return t_us, p.astype(np.uint8)

    def _answering(self, point: Point) -> Answering:
        """Return what is known of light and pixels, for edges that are to be placed by the events."""
        edge_s, settings = self._station.light.edge_time_s, point.settings
        rise_tau_s = edge_s / _TIME_CONSTANTS if math.isfinite(edge_s) else None
        known = {
            "theta_on": settings.theta_on,
            "theta_off": settings.theta_off,
            "bandwidth_hz": settings.bandwidth_hz,
        }
        return Answering(rise_tau_s, **{name: value for name, value in known.items() if value is not None})

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

    def _record(
        self, planned: PlannedPoint, duration_s: float, placed: _Placed, beginning: dict[str, Any]
    ) -> PointRecord:
        camera, point = self._station.camera, planned.point
        quality = dataclasses.asdict(camera.quality())
        gaps = quality.pop("gaps_s")
        refractory_s, source = self._refractory_s(point)
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
            refractory_s=refractory_s,
            temperature_c=camera.temperature_c(),
            roi=None if point.roi == self._roi else point.roi,
            attributes={
                **self._attributes(planned),
                "refractory_source": source,
                **beginning,
                **placed.attributes,
            },
            bias={name: float(value) for name, value in camera.biases().items()},
            quality={**quality, "gaps": len(gaps), **placed.quality},
            gaps_s=tuple(gaps),
        )

    def _refractory_s(self, point: Point) -> tuple[float, str]:
        """Return the dead time and who says so: the device if it measures it, else the protocol, else the map."""
        measured = self._station.camera.refractory_s()
        if not math.isnan(measured):
            return measured, "measured"
        if point.settings.refractory_s is not None:
            return point.settings.refractory_s, "asked"
        mapped = self._station.calibration.settings_at(self._station.camera.biases()).get("refractory_s", math.nan)
        return mapped, "unknown" if math.isnan(mapped) else "bias_map"

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
    quality: dict[str, Any]

    @classmethod
    def of(cls, planned: PlannedPoint, played: PlayedWaveform, edges: PlacedEdges) -> _Placed:
        stimulus = planned.stimulus
        start, stop = moved_windows(stimulus, edges.t_s)
        host = [
            None if t is None else t + edges.offset_s
            for t in (played.t_written_s, played.t_acknowledged_s, played.t_settled_s)
        ]
        record = StimulusRecord(edges.t_s, stimulus.lux, edges.trigger, *host)
        pulses = PulseRecord(start, stop, stimulus.pulse_kind)
        return cls(record, pulses, edges.attributes, edges.quality)


def _known(name: str, value: float) -> dict[str, float]:
    return {} if math.isnan(value) else {name: value}


def _label(point: Point) -> str:
    return f"{point.measurement} {point.index}"


def _counted(writer: PointWriter) -> EventCounts:
    """Return the events that `writer` has, counted in short bins."""
    counts = EventCounts()
    for t_us, p in writer.times_and_polarities():
        counts.add(t_us, p)
    return counts
