"""How many photons a lux is, and what a sensor of a known quantum efficiency makes of them.

A lux is light weighted by the eye, a photodiode counts photons. Between the two stands the spectrum E_lambda:

    photons per lux, m2 and s   N   = int_range(E_lambda lambda / (h c)) / (683 int(E_lambda V))
    efficacy, lm/W              K   = 683 int(E_lambda V) / int_range(E_lambda)
    effective efficiency        eta = int_range(E_lambda lambda QE) / int_range(E_lambda lambda)

with V(lambda) of CIE 1924 and 683 lm/W (ISO 23539, CIE S 010). The range is what the sensor is taken to see; the
integral with V goes over the whole spectrum, as a lux meter takes it. All are means over straight lines between the
values that are given.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.photometry.csv_tables import read_curve
from protocols.errors import InputError

if TYPE_CHECKING:
    import os

    import numpy.typing as npt

    _Curve = npt.NDArray[np.float64]

__all__ = ["Efficiency", "PerLux", "Spectrum", "constant_efficiency", "per_lux", "read_efficiency", "read_spectrum"]

_LUMENS_PER_WATT: Final = 683.0
_HC_J_NM: Final = 6.62607015e-34 * 299792458.0 * 1e9  #: Planck's constant times the speed of light, J nm
_STEP_NM: Final = 1.0  #: of the integrals, where neither spectrum nor efficiency is finer
#: A spectrum that ends where it still makes this part of its largest contribution to lux is said to be cut off.
_CUT: Final = 0.01


@dataclass(frozen=True, slots=True)
class Spectrum:
    """Power per nm against wavelength, in any unit; a single wavelength is light of that wavelength alone."""

    name: str
    wavelength_nm: _Curve  #: ascending
    power: _Curve


@dataclass(frozen=True, slots=True)
class Efficiency:
    """Quantum efficiency against wavelength, electrons per photon that falls on the whole pixel."""

    name: str
    wavelength_nm: _Curve  #: ascending
    value: _Curve  #: 0 to 1


@dataclass(frozen=True, slots=True)
class PerLux:
    """What one lux of a spectrum is."""

    photons_per_lux: float  #: per m2 and s, in the range
    efficacy_lm_w: float  #: lumens per watt in the range
    eta: float | None  #: effective quantum efficiency, weighted with photons; None where none was given
    outside: float  #: part of all photons of the spectrum, as far as it is known, that is not in the range
    cut_off_nm: tuple[float, ...]  #: ends of the spectrum at which the eye still sees much of it


def read_spectrum(path: str | os.PathLike[str]) -> Spectrum:
    """Return the spectrum of a CSV file with the header ``wavelength_nm,power``.

    Raises
    ------
    InputError
        With file, line and column of what is wrong.
    """
    wavelength_nm, power = read_curve(path, "power")
    if not power.any():
        raise InputError(f"{path}: expected a power above 0, found none")
    return Spectrum(str(path), wavelength_nm, power)


def read_efficiency(path: str | os.PathLike[str]) -> Efficiency:
    """Return the quantum efficiency of a CSV file with the header ``wavelength_nm,qe``, from 0 to 1.

    Raises
    ------
    InputError
        With file, line and column of what is wrong.
    """
    return Efficiency(str(path), *read_curve(path, "qe", highest=1.0))


def constant_efficiency(value: float, range_nm: tuple[float, float]) -> Efficiency:
    """Return the same efficiency at all wavelengths of a range."""
    return Efficiency(f"{value:g}", np.array(range_nm), np.array([value, value]))


def per_lux(
    spectrum: Spectrum,
    luminosity: tuple[_Curve, _Curve],
    range_nm: tuple[float, float],
    efficiency: Efficiency | None = None,
) -> PerLux:
    """Return photons, efficacy and effective efficiency of a spectrum; see the module for the equations.

    Parameters
    ----------
    spectrum
        The light.
    luminosity
        Wavelengths (nm) and values of V; 0 outside of them.
    range_nm
        The photons that count, nm.
    efficiency
        That of the sensor.

    Raises
    ------
    InputError
        Spectrum or efficiency do not cover the range, or nothing of the light is in it or is seen by the eye.
    """
    low, high = range_nm
    line = float(spectrum.wavelength_nm[0]) if len(spectrum.wavelength_nm) == 1 else None
    if line is None:
        _covered(spectrum.name, spectrum.wavelength_nm, range_nm)
    if efficiency is not None:
        _covered(efficiency.name, efficiency.wavelength_nm, range_nm if line is None else (line, line))
    grid = _grid(spectrum, efficiency, range_nm)
    power = np.interp(grid, spectrum.wavelength_nm, spectrum.power)
    seen = power * np.interp(grid, *luminosity, left=0.0, right=0.0)
    photons = power * grid / _HC_J_NM
    inside = (grid >= low) & (grid <= high)
    lux = _LUMENS_PER_WATT * _integral(seen, grid)
    counted = _integral(photons[inside], grid[inside])
    if not lux > 0.0:
        raise InputError(f"{spectrum.name}: the eye sees nothing of it, so a lux of it is no measure")
    if not counted > 0.0:
        raise InputError(f"{spectrum.name}: it has no light from {low:g} to {high:g} nm; choose another range")
    eta = None
    if efficiency is not None:
        qe = np.interp(grid, efficiency.wavelength_nm, efficiency.value)
        eta = _integral((photons * qe)[inside], grid[inside]) / counted
    return PerLux(
        counted / lux,
        lux / _integral(power[inside], grid[inside]),
        eta,
        1.0 - counted / _integral(photons, grid),
        tuple(float(grid[i]) for i in (0, -1) if len(grid) > 1 and seen[i] > _CUT * seen.max()),
    )


def _covered(name: str, wavelength_nm: _Curve, range_nm: tuple[float, float]) -> None:
    low, high = range_nm
    first, last = float(wavelength_nm[0]), float(wavelength_nm[-1])
    if low < first or high > last:
        where = f"at {low:g} nm" if low == high else f"over the range {low:g} to {high:g} nm"
        raise InputError(f"{name}: known from {first:g} to {last:g} nm, not {where}")


def _grid(spectrum: Spectrum, efficiency: Efficiency | None, range_nm: tuple[float, float]) -> _Curve:
    """Return the wavelengths at which the integrals are taken: all that are given, the range's ends, and between."""
    first, last = spectrum.wavelength_nm[[0, -1]]
    if len(spectrum.wavelength_nm) == 1:
        return spectrum.wavelength_nm
    own = [] if efficiency is None else [efficiency.wavelength_nm]
    regular = np.arange(first, last, _STEP_NM)
    grid = np.unique(np.concatenate([spectrum.wavelength_nm, np.array(range_nm), regular, *own]))
    inside: _Curve = grid[(grid >= first) & (grid <= last)]
    return inside


def _integral(values: _Curve, grid: _Curve) -> float:
    """Return the integral over straight lines; of a single wavelength its value."""
    return float(values.sum()) if len(grid) < 2 else float(np.trapezoid(values, grid))
