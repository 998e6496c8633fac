"""What is to be written of one point beside its events."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from protocols.points import Polarity, Roi, Waveform

__all__ = ["PointRecord", "PulseRecord", "StimulusRecord"]


@dataclass(frozen=True, slots=True)
class StimulusRecord:
    """The light of a point, on the camera's time axis."""

    t_s: npt.NDArray[np.float64]  #: (m,) s; the first entry is 0
    lux: npt.NDArray[np.float64]  #: (m,) on chip, commanded
    trigger: npt.NDArray[np.int64] | None = (
        None  #: (m,) trigger of each edge, -1 = none; None if there are no triggers
    )
    t_written_s: npt.NDArray[np.float64] | None = None  #: (m,) host-timed sources
    t_acknowledged_s: npt.NDArray[np.float64] | None = None  #: (m,)
    t_settled_s: npt.NDArray[np.float64] | None = None  #: (m,)


@dataclass(frozen=True, slots=True)
class PulseRecord:
    """The response windows of a point, on the camera's time axis."""

    start_s: npt.NDArray[np.float64]  #: (k,)
    stop_s: npt.NDArray[np.float64]  #: (k,)
    kind: npt.NDArray[np.uint8]  #: (k,) 0 = step up, 1 = step down
    valid: npt.NDArray[np.uint8] | None = None  #: (k,) None if all are


@dataclass(frozen=True, slots=True)
class PointRecord:
    """One point, beside its events and triggers. The fields are the root attributes of the point file."""

    index: int
    waveform: Waveform
    polarity: Polarity
    baseline_lux: float
    log_contrast: float
    duration_s: float
    nd_od: float
    stimulus: StimulusRecord
    pulses: PulseRecord
    refractory_s: float = float("nan")
    temperature_c: float = float("nan")
    roi: Roi | None = None  #: None if it is the run's
    attributes: dict[str, Any] = field(default_factory=dict)  #: more root attributes, by name; None is left out
    bias: dict[str, float] = field(default_factory=dict)  #: settings as read back
    quality: dict[str, Any] = field(default_factory=dict)  #: attributes of `/quality`
    gaps_s: tuple[tuple[float, float], ...] = ()
    masked: npt.NDArray[np.uint16] | None = None  #: (n, 2) x, y of pixels that were switched off; None if none
