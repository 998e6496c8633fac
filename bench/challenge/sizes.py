"""How large an effect of a challenge may be: from barely visible to gross, in the unit of each of its numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

__all__ = ["ALIKE", "NOT_TO_BE_FOUND", "SIZES", "Size"]

_FIGURES: Final = 4


@dataclass(frozen=True, slots=True)
class Size:
    """The range of one number of an effect; between its ends the logarithm is drawn evenly.

    Where a larger number is a weaker effect, as of a bandwidth, `faint` is the larger one.
    """

    name: str
    faint: float  #: barely visible in the protocol `challenge`
    gross: float  #: cannot be overlooked
    either_sign: bool = False
    kind: bool = False  #: it says of what kind the effect is, not how large: drawn from the whole range

    def at(self, strength: float) -> float:
        """Return the number at a strength from 0, barely visible, to 1, gross; to four figures."""
        exact = self.faint * math.exp(strength * math.log(self.gross / self.faint))
        return float(f"{exact:.{_FIGURES}g}")


#: By effect. What is not named has its default.
SIZES: Final[dict[str, tuple[Size, ...]]] = {
    "light_rise_time": (Size("tau_s", 2e-4, 1e-2),),
    "light_drift": (Size("rate_per_s", 3e-3, 0.1, either_sign=True),),
    "light_flicker": (Size("depth", 0.01, 0.2), Size("frequency_hz", 80.0, 125.0, kind=True)),
    "nd_error": (Size("delta_od", 0.02, 0.3, either_sign=True),),
    "stray_light": (Size("illuminance_lux", 0.01, 0.5),),
    "dark_current": (Size("mean_fa", 0.5, 20.0),),
    "shot_noise": (Size("factor", 0.01, 1.0),),
    "photoreceptor_bandwidth": (Size("hz_per_fa", 50.0, 1.0),),
    "low_frequency_noise": (Size("rms", 0.01, 0.08), Size("tau_s", 0.3, 3.0, kind=True)),
    "high_pass": (Size("corner_hz", 0.1, 3.0),),
    "leak": (Size("rate_per_s", 0.01, 0.3),),
    "parasitic_photocurrent": (Size("rate_per_s_per_lux", 1e-4, 5e-3),),
    "reset_noise": (Size("rms", 5e-3, 0.06),),
    "threshold_mismatch": (Size("sigma_on", 8e-3, 0.06), Size("sigma_off", 8e-3, 0.06)),
    "comparator_delay": (Size("delay_s", 5e-5, 2e-3),),
    "refractory_mismatch": (Size("spread", 0.1, 0.8),),
    "hot_pixels": (Size("fraction", 0.01, 0.06), Size("rate_hz", 3.0, 100.0, kind=True)),
    "crosstalk": (Size("probability", 4e-3, 0.1),),
    "readout_saturation": (Size("max_rate_eps", 5e5, 2e4),),
    "event_rate_limit": (Size("max_rate_eps", 5e5, 2e4),),
    "timestamp_jitter": (Size("sigma_s", 5e-5, 2e-3),),
    "trail_filter": (Size("window_s", 5e-3, 0.1),),
}

#: They are the same as other thresholds (and noise), which nobody is told: no measurement of the events finds them.
NOT_TO_BE_FOUND: Final = frozenset({"contrast_error", "injection_offset"})

#: Effects of which a challenge has one at most: together they are one of them, only larger.
ALIKE: Final = (frozenset({"dark_current", "stray_light"}), frozenset({"readout_saturation", "event_rate_limit"}))
