"""Photons, lumens and electrons of a spectrum."""

from __future__ import annotations

import builtins
import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bench.photometry.cie import luminosity, names, spectrum_named
from bench.photometry.spectrum import Efficiency, Spectrum, constant_efficiency, per_lux, read_spectrum
from protocols.errors import InputError

if TYPE_CHECKING:
    from pathlib import Path

VISIBLE = (400.0, 700.0)
WIDE = (380.0, 780.0)


@pytest.mark.parametrize(
    ("name", "range_nm", "photons"),
    [
        ("mono 555", VISIBLE, 4.09e15),
        ("mono 525", VISIBLE, 4.88e15),
        ("mono 450", VISIBLE, 8.73e16),
        ("mono 630", VISIBLE, 1.75e16),
        ("D55", VISIBLE, 1.075e16),
        ("D65", VISIBLE, 1.088e16),
        ("D65", WIDE, 1.39e16),
        ("A", VISIBLE, 1.203e16),
        ("A", WIDE, 2.11e16),
        ("E", VISIBLE, 1.142e16),
        ("LED-B1", VISIBLE, 8.99e15),
        ("LED-B3", VISIBLE, 8.64e15),
        ("LED-B5", VISIBLE, 8.68e15),
        ("LED-RGB1", VISIBLE, 9.95e15),
        ("blackbody 5800", VISIBLE, 1.099e16),
        ("blackbody 6500", WIDE, 1.44e16),
    ],
)
def test_photons_per_lux_are_those_of_the_table(name: str, range_nm: tuple[float, float], photons: float) -> None:
    found = per_lux(spectrum_named(name), luminosity(), range_nm)
    assert found.photons_per_lux == pytest.approx(photons, rel=0.01)
    assert found.cut_off_nm == ()


def test_one_watt_at_555_nm_is_683_lumens() -> None:
    found = per_lux(spectrum_named("mono 555"), luminosity(), VISIBLE)
    assert found.efficacy_lm_w == pytest.approx(683.0, rel=1e-6)
    assert found.photons_per_lux == pytest.approx(555e-9 / (6.62607015e-34 * 299792458.0) / 683.0, rel=1e-9)


def test_a_blackbody_of_2856_k_is_illuminant_a() -> None:
    a, planck = (per_lux(spectrum_named(name), luminosity(), WIDE) for name in ("A", "blackbody 2856"))
    assert planck.photons_per_lux == pytest.approx(a.photons_per_lux, rel=2e-3)


def test_the_integrals_are_those_of_straight_lines() -> None:
    flat = Spectrum("flat", np.array([400.0, 500.0]), np.array([2.0, 2.0]))
    eye = (np.array([400.0, 500.0]), np.array([1.0, 1.0]))
    qe = Efficiency("ramp", np.array([400.0, 500.0]), np.array([0.0, 1.0]))
    found = per_lux(flat, eye, (420.0, 480.0), qe)
    hc = 6.62607015e-34 * 299792458.0 * 1e9
    assert found.photons_per_lux == pytest.approx((480.0**2 - 420.0**2) / hc / (683.0 * 200.0), rel=1e-6)
    assert found.efficacy_lm_w == pytest.approx(683.0 * 200.0 / 120.0)
    # int(x (x - 400) / 100) / int(x) over 420 to 480
    ramp = ((480.0**3 - 420.0**3) / 3.0 - 200.0 * (480.0**2 - 420.0**2)) / 100.0
    assert found.eta == pytest.approx(ramp / (0.5 * (480.0**2 - 420.0**2)), rel=1e-4)
    assert found.outside == pytest.approx(0.4, rel=1e-6)
    assert found.cut_off_nm == (400.0, 500.0)


def test_a_constant_efficiency_is_its_own_mean() -> None:
    for name in ("D65", "mono 525"):
        found = per_lux(spectrum_named(name), luminosity(), VISIBLE, constant_efficiency(0.6, VISIBLE))
        assert found.eta == pytest.approx(0.6, rel=1e-12)


def test_the_unit_of_the_power_does_not_matter() -> None:
    one = spectrum_named("LED-B3")
    other = Spectrum("x", one.wavelength_nm, 1e-12 * one.power)
    first, second = (per_lux(s, luminosity(), VISIBLE) for s in (one, other))
    assert first.photons_per_lux == pytest.approx(second.photons_per_lux, rel=1e-12)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("D6", "did you mean D65"),
        ("LED-B9", "did you mean LED-B"),
        ("zzz", "--list names them"),
        ("mono", "expected a number from 380 to 780 nm"),
        ("mono 900", "expected a number from 380 to 780 nm"),
        ("blackbody hot", "expected a number from 1000 to 30000 K"),
        ("blackbody nan", "expected a number from 1000"),
    ],
)
def test_what_is_no_spectrum_is_refused(name: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        spectrum_named(name)
    assert len(str(caught.value).splitlines()) == 1


def test_names_in_any_case_and_with_units() -> None:
    assert {"A", "D50", "D55", "D65", "E", "LED-B1", "LED-B5", "LED-RGB1"} <= set(names())
    assert spectrum_named("led-b3").name == "LED-B3"
    assert spectrum_named("mono 525 nm").name == "mono 525"


def test_light_that_does_not_fit_the_question_is_refused() -> None:
    led = spectrum_named("LED-B3")
    with pytest.raises(InputError, match="LED-B3: known from 380 to 780 nm, not over the range 300 to 700 nm"):
        per_lux(led, luminosity(), (300.0, 700.0))
    with pytest.raises(InputError, match="no light from 400 to 500 nm"):
        per_lux(spectrum_named("mono 555"), luminosity(), (400.0, 500.0))
    short = Efficiency("qe.csv", np.array([400.0, 500.0]), np.array([0.5, 0.5]))
    with pytest.raises(InputError, match="not at 555 nm"):
        per_lux(spectrum_named("mono 555"), luminosity(), VISIBLE, short)
    infrared = Spectrum("ir", np.array([900.0, 1000.0]), np.array([1.0, 1.0]))
    with pytest.raises(InputError, match="ir: the eye sees nothing of it"):
        per_lux(infrared, luminosity(), (900.0, 1000.0))


def test_a_dark_spectrum_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "dark.csv"
    file.write_text("wavelength_nm,power\n400,0\n700,0\n")
    with pytest.raises(InputError, match=r"dark.csv: expected a power above 0"):
        read_spectrum(file)


def test_without_the_package_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    found = builtins.__import__

    def without(name: str, *args: Any, **kwargs: Any) -> Any:
        if name == "colour":
            raise ImportError(name)
        return found(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(InputError, match=r"pip install evs-bench\[spectra\]"):
        luminosity()
    assert math.isclose(spectrum_named("mono 525").wavelength_nm[0], 525.0)
