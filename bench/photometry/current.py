"""From illuminance to photocurrent and back, and the quantum efficiency that a stated dark current implies.

A curve tells only the light that dark current is worth, in lux. Femtoampere follow from it with the quantum
efficiency, the pitch and the photon number of the light, and no better than these are known.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from bench.photometry.propagation import Known, propagate

if TYPE_CHECKING:
    from bench.photometry.propagation import Propagated
    from bench.store.data import Sensor

__all__ = ["DAYLIGHT_PHOTONS_PER_LUX", "Photodiode", "disagreement"]

_ELEMENTARY_CHARGE_FC: Final = 1.602176634e-4
#: Photons per m2, s and lux of a daylight-like white, counted over 400 to 700 nm.
DAYLIGHT_PHOTONS_PER_LUX: Final = 1.12e16
_SURE_SIGMA: Final = 2.0


@dataclass(frozen=True, slots=True)
class Photodiode:
    """What turns light into current: ``I = k E``, ``k = eta * photons_per_lux * q * pitch^2``.

    Each number with its standard error; 42.4 fA/lux times eta at 4.86 um and 1.12e16 photons per lux, m2 and s.
    """

    eta: Known  #: quantum efficiency, averaged over the spectrum of the light
    pitch_m: Known  #: distance of two pixels, m
    photons_per_lux: Known  #: per m2 and s

    @classmethod
    def of(cls, sensor: Sensor, eta_sd: float = 0.0) -> Photodiode | None:
        """Return that of the sensor of a run; None where the run does not tell its efficiency or its pitch."""
        if not (math.isfinite(sensor.quantum_efficiency) and math.isfinite(sensor.pixel_pitch_m)):
            return None
        return cls(
            Known(sensor.quantum_efficiency, eta_sd), Known(sensor.pixel_pitch_m), Known(sensor.photons_per_lux)
        )

    @property
    def fa_per_lux(self) -> float:
        """Photocurrent at one lux, fA."""
        return _fa_per_lux(self.eta.value, self.pitch_m.value, self.photons_per_lux.value)

    def current(self, lux: Known) -> Propagated:
        """Return the photocurrent of an illuminance on the chip, fA, with its standard error and where it is from."""
        return propagate(
            lambda e, eta, pitch, photons: e * _fa_per_lux(eta, pitch, photons),
            {"illuminance": lux, "eta": self.eta, "pitch": self.pitch_m, "photons per lux": self.photons_per_lux},
        )

    def efficiency_for(self, current_fa: Known, lux: Known) -> Propagated:
        """Return the quantum efficiency with which `lux` on the chip makes `current_fa`; that of `self` is not used.

        Above 1, the two numbers do not belong together.
        """
        return propagate(
            lambda i, e, pitch, photons: i / (e * _fa_per_lux(1.0, pitch, photons)),
            {
                "current": current_fa,
                "illuminance": lux,
                "pitch": self.pitch_m,
                "photons per lux": self.photons_per_lux,
            },
        )


def _fa_per_lux(eta: float, pitch_m: float, photons_per_lux: float) -> float:
    return eta * photons_per_lux * _ELEMENTARY_CHARGE_FC * pitch_m**2


def disagreement(first: Known, second: Known) -> tuple[float, float]:
    """Return by which part two numbers differ, of their mean, and by how many standard errors.

    Infinitely many where neither has one and they differ.

    Examples
    --------
    >>> disagreement(Known(0.9, 0.03), Known(0.6, 0.04))
    (0.4, 6.0)
    """
    mean = 0.5 * (first.value + second.value)
    off = abs(first.value - second.value)
    sd = math.hypot(first.sd, second.sd)
    return round(off / mean, 12), round(off / sd, 12) if sd > 0.0 else (math.inf if off > 0.0 else 0.0)
