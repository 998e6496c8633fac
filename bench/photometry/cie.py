"""Standard spectra and V(lambda) of the CIE, from the package colour-science (extra ``spectra``)."""

from __future__ import annotations

from difflib import get_close_matches
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bench.photometry.csv_tables import plain_number
from bench.photometry.spectrum import Spectrum
from protocols.errors import InputError

if TYPE_CHECKING:
    import numpy.typing as npt

    _Curve = npt.NDArray[np.float64]

__all__ = ["luminosity", "names", "spectrum_named"]

_OBSERVER: Final = "CIE 1924 Photopic Standard Observer"
#: Wavelengths of a computed spectrum, nm: all that silicon sees.
_FIRST_NM: Final = 300.0
_LAST_NM: Final = 1200.0
_SECOND_RADIATION_NM_K: Final = 1.438776877e7  #: h c / k, nm K
#: What is computed instead of looked up: the word, its unit, the lowest and the highest number.
_COMPUTED: Final = {"blackbody": ("K", 1000.0, 30000.0), "mono": ("nm", 380.0, 780.0)}


def _colour() -> Any:
    try:
        import colour
    except ImportError:
        raise InputError(
            "V(lambda) and the standard spectra need the package colour-science: pip install evs-bench[spectra]"
        ) from None
    return colour


def luminosity() -> tuple[_Curve, _Curve]:
    """Return V(lambda), the sensitivity of the eye in daylight (CIE 1924), against wavelength in nm.

    Raises
    ------
    InputError
        The package with the data is not there.
    """
    curve = _colour().SDS_LEFS[_OBSERVER]
    return np.array(curve.wavelengths, float), np.array(curve.values, float)


def names() -> tuple[str, ...]:
    """Return the names of the standard spectra, sorted.

    Raises
    ------
    InputError
        The package with the data is not there.
    """
    return tuple(sorted(_colour().SDS_ILLUMINANTS))


def spectrum_named(name: str) -> Spectrum:
    """Return a standard spectrum, or ``blackbody KELVIN`` (Planck's law) or ``mono NANOMETRES`` (a line).

    Raises
    ------
    InputError
        There is none of this name; the nearest are named. Or the package with the data is not there.
    """
    word, _, rest = name.strip().partition(" ")
    if word.lower() in _COMPUTED:
        return _computed(word.lower(), rest.strip())
    known = names()
    by_lower = {one.lower(): one for one in known}
    if name.strip().lower() not in by_lower:
        close = get_close_matches(name.lower(), [*by_lower, *_COMPUTED], n=3)
        hint = f"did you mean {' or '.join(by_lower.get(c, c) for c in close)}?" if close else "--list names them"
        raise InputError(f"there is no spectrum {name!r}, and no file of this name that ends in .csv; {hint}")
    found = by_lower[name.strip().lower()]
    curve = _colour().SDS_ILLUMINANTS[found]
    return Spectrum(found, np.array(curve.wavelengths, float), np.array(curve.values, float))


def _computed(word: str, text: str) -> Spectrum:
    unit, lowest, highest = _COMPUTED[word]
    value = plain_number(text.removesuffix(unit).strip())
    if value is None or not lowest <= value <= highest:
        raise InputError(
            f"spectrum {word}: expected a number from {lowest:g} to {highest:g} {unit} behind it, found {text!r}"
        )
    if word == "mono":
        return Spectrum(f"mono {value:g}", np.array([value]), np.ones(1))
    wavelength_nm = np.arange(_FIRST_NM, _LAST_NM + 1.0)
    # Planck's law, without its constants in front; the factor keeps the numbers near 1.
    power = (wavelength_nm / 560.0) ** -5.0 / np.expm1(_SECOND_RADIATION_NM_K / (wavelength_nm * value))
    return Spectrum(f"blackbody {value:g}", wavelength_nm, power)
