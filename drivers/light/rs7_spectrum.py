"""The spectrum that an RS-7 says it emits.

Source: Gamma Scientific, SpectralLED RS-7 User Manual, rev. A/X1 (2018), section 4.4: `WLR` sets the range of
wavelengths, `STM 1` makes a spectrum a list with a row for each nanometre, `OSP` reports the one that is emitted.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from drivers.errors import UnexpectedAnswer

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

__all__ = ["FIRST_NM", "LAST_NM", "EmittedSpectrum", "spectrum_in"]

FIRST_NM: Final = 360
LAST_NM: Final = 1100


@dataclass(frozen=True, slots=True)
class EmittedSpectrum:
    """What is emitted at each nanometre."""

    wavelength_nm: npt.NDArray[np.float64]  #: (n,)
    density: npt.NDArray[np.float64]  #: (n,) in `unit`
    unit: str  #: uW/cm2/nm/sr (radiance) or uW/cm2/nm (irradiance at the working distance)


def spectrum_in(device: str, rows: Sequence[str], unit: str) -> EmittedSpectrum:
    """Return the spectrum that the rows from `OSP` are, over the whole range of wavelengths.

    Raises
    ------
    UnexpectedAnswer
        They are none.
    """
    wavelength_nm = np.arange(FIRST_NM, LAST_NM + 1, dtype=np.float64)
    try:
        density = np.array([float(row) for row in rows])
    except ValueError as error:
        raise UnexpectedAnswer(device, "read the spectrum (OSP)", str(error)) from error
    if density.shape != wavelength_nm.shape or not np.all(np.isfinite(density)):
        expected = f"expected {len(wavelength_nm)} finite ones, {FIRST_NM} nm to {LAST_NM} nm"
        raise UnexpectedAnswer(device, "read the spectrum (OSP)", f"{len(rows)} values; {expected}")
    return EmittedSpectrum(wavelength_nm, density, unit)
