"""The light between two edges: where it settles, and until when it moves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from sim_backend.pixel.light_path import ChipLight

__all__ = ["LAST", "Segments", "segments_of"]

#: Later than any sample; times the addresses of a whole sensor it is still a 64-bit number, as events are written.
LAST: Final = 1 << 40
#: The light counts as settled when the log photocurrent is this close to its level, in rms of the noise, and in any
#: case after so many time constants: where it settles in the dark, the dark current settles it.
_SETTLED_RMS: Final = 1e-4
_MOST_TAUS: Final = 40.0
#: Less light than this, lux, is none: any other level is more than exp(40) times as much.
_DARK_LUX: Final = 1e-30


@dataclass(frozen=True, slots=True)
class Segments:
    """The m stretches of a recording between two edges of the commanded light."""

    first: npt.NDArray[np.int64]  #: (m + 1,) first sample of each, and one beyond all others
    until: npt.NDArray[np.int64]  #: (m,) last sample at which its light still moves; before its first: it does not
    lux: npt.NDArray[np.float64]  #: (m,) illuminance on the chip at which it settles

    @property
    def moving(self) -> bool:
        """Whether any light moves."""
        return bool(np.any(self.until >= self.first[:-1]))


def segments_of(on_chip: ChipLight, noise_rms: float, dt_s: float, *, restless: bool = False) -> Segments:
    """Return the segments of a recording.

    Parameters
    ----------
    on_chip
        The light.
    noise_rms
        The smaller the noise (ln units), the longer it takes until nothing of an edge can be seen.
    dt_s
        Length of a sample, s.
    restless
        What the pixel makes of the light never settles, even if the light does.
    """
    first = on_chip.first
    lux = on_chip.settled_lux
    if on_chip.never_settles or restless:
        until = np.full(len(first), LAST)
    else:
        until = first - 1
        rise_tau_s = on_chip.rise_tau_s
        if rise_tau_s > 0.0:
            floor = np.maximum(np.minimum(lux, on_chip.at_edge_lux), _DARK_LUX)
            away = np.abs(on_chip.at_edge_lux - lux) / floor
            taus = np.log(np.maximum(away / (_SETTLED_RMS * noise_rms), 1.0))
            until = until + np.ceil(np.minimum(taus, _MOST_TAUS) * rise_tau_s / dt_s).astype(np.int64)
    return Segments(np.append(first, LAST), until, lux)
