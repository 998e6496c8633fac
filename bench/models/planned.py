"""A point of a protocol as it will have been recorded, without its events."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bench.store.data import PointData
from protocols.waveforms import stimulus_of

if TYPE_CHECKING:
    from protocols.points import Point, Roi

__all__ = ["planned_point"]


def planned_point(point: Point, roi: Roi, refractory_s: float) -> PointData:
    """Return a point as an undisturbed measurement will leave it: no events yet, no gaps, every pulse valid.

    Parameters
    ----------
    point
        Of a protocol.
    roi
        The window that is read.
    refractory_s
        Dead time after an event, s, of the pixel that will be there; NaN if unknown.
    """
    light = stimulus_of(point)
    pulses = len(light.pulse_start_s)
    return PointData(
        path=Path(f"{point.index:06d}.h5"),
        index=point.index,
        waveform=point.waveform,
        polarity=point.polarity,
        baseline_lux=point.baseline_lux,
        log_contrast=point.log_contrast,
        duration_s=light.duration_s,
        nd_od=point.nd_od,
        refractory_s=refractory_s,
        temperature_c=math.nan,
        roi=roi,
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
        attributes={"ambient": point.ambient},
    )
