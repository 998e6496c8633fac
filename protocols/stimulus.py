"""The light of one point over time: edges, levels and response windows, as plain arrays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

__all__ = ["Stimulus"]


@dataclass(frozen=True, slots=True)
class Stimulus:
    """Light on chip as a step function, and the windows in which a response counts."""

    t_s: npt.NDArray[np.float64]  #: (m,) s; time of each commanded edge, the first entry is 0
    lux: npt.NDArray[np.float64]  #: (m,) lux on chip from that edge to the next
    duration_s: float  #: length of the recording, s
    pulse_start_s: npt.NDArray[np.float64]  #: (k,) s; response window of each test pulse
    pulse_stop_s: npt.NDArray[np.float64]  #: (k,) s; the window is [start, stop)
    pulse_kind: npt.NDArray[np.uint8]  #: (k,) 0 = step up (ON expected), 1 = step down (OFF expected)
