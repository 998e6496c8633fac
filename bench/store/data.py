"""What a run folder holds, as the rest of the bench sees it (format ``evs-bench-run/1``)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from bench.store.layout import FROM_EVENTS

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    import numpy as np
    import numpy.typing as npt

    from protocols.points import Polarity, Roi, Waveform

__all__ = ["PointData", "RunHeader", "Sensor"]


@dataclass(frozen=True, slots=True)
class Sensor:
    """The sensor of a run."""

    name: str
    width: int
    height: int
    pixel_pitch_m: float
    quantum_efficiency: float  #: average over the light's spectrum
    photons_per_lux: float = 1.12e16  #: per m2 and s


@dataclass(frozen=True, slots=True)
class RunHeader:
    """What ``run.yaml`` says: what was asked, on what, by whom."""

    id: str
    sensor: Sensor
    roi: Roi
    title: str = ""
    created: str = ""
    everything: dict[str, Any] = field(default_factory=dict)  #: the whole file, unknown keys too


@dataclass(frozen=True, slots=True)
class PointData:
    """One measurement point as it was recorded. Events stay on disk; :meth:`events` streams them."""

    path: Path
    index: int
    waveform: Waveform
    polarity: Polarity
    baseline_lux: float
    log_contrast: float
    duration_s: float
    nd_od: float
    refractory_s: float  #: NaN if unknown
    temperature_c: float  #: NaN if unknown
    roi: Roi
    n_events: int
    stimulus_t_s: npt.NDArray[np.float64]  #: (m,)
    stimulus_lux: npt.NDArray[np.float64]  #: (m,)
    pulse_start_s: npt.NDArray[np.float64]  #: (k,)
    pulse_stop_s: npt.NDArray[np.float64]  #: (k,)
    pulse_kind: npt.NDArray[np.uint8]  #: (k,) 0 = step up, 1 = step down
    pulse_valid: npt.NDArray[np.bool_]  #: (k,) all True unless the file says otherwise
    pulse_log_contrast: npt.NDArray[np.float64]  #: (k,) `log_contrast` unless the file says otherwise
    triggers_t_us: npt.NDArray[np.int64]
    triggers_p: npt.NDArray[np.uint8]
    masked: npt.NDArray[np.uint16]  #: (n, 2) x, y of pixels that were switched off
    gaps_s: npt.NDArray[np.float64]  #: (g, 2) stretches without data
    bias: dict[str, float]  #: settings as read back; empty if not recorded
    quality: dict[str, Any]
    attributes: dict[str, Any]  #: all root attributes of the file, unknown ones too
    until_s: float = field(default=math.inf, kw_only=True)  #: later events are left on disk
    stored_roi: Roi | None = field(default=None, kw_only=True)  #: window on disk, where `roi` is a part of it

    @property
    def tells_latency(self) -> bool:
        """Whether the time from an edge to its answer may be read: not where the answers told when the edge was."""
        return bool(self.attributes.get("time_axis") != FROM_EVENTS)

    def events(self, chunk: int = 1_000_000) -> Iterator[npt.NDArray[np.void]]:
        """Yield the events of the window in order up to `until_s`, at most `chunk` at a time, of `EVENT_DTYPE`.

        A file that turns out to be damaged raises :class:`bench.store.errors.RunError`.
        """
        from bench.store.event_reader import read_events

        if self.stored_roi is None:
            return read_events(self.path, chunk, self.roi, self.until_s)
        every = read_events(self.path, chunk, self.stored_roi, self.until_s)
        return (inside for events in every if len(inside := _inside(events, self.roi)))


def _inside(events: npt.NDArray[np.void], roi: Roi) -> npt.NDArray[np.void]:
    x, y = events["x"], events["y"]
    return events[(x >= roi.x) & (x < roi.x + roi.width) & (y >= roi.y) & (y < roi.y + roi.height)]
