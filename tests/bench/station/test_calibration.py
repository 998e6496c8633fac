"""Lux to levels, settings to biases, and the geometries."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

from bench.station import load_station
from bench.station.schema import BareGeometry, LensGeometry
from protocols.errors import InputError
from protocols.points import Settings

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from bench.station import Calibration


@pytest.fixture(name="calibration")
def calibration_of_lab(write: Callable[..., Path]) -> Calibration:
    return load_station(str(write())).calibration


def test_lux_behind_a_filter_is_as_measured(calibration: Calibration) -> None:
    assert calibration.lux_per_level("none") == 0.5
    assert calibration.lux_per_level("grey") == pytest.approx(0.5 * 0.012)
    assert calibration.level_for(3.0, "grey") == pytest.approx(500.0)
    assert calibration.level_for(0.0, "grey") == 0.0
    with pytest.raises(InputError, match="no filter 'blue' in the calibration; it has none, grey"):
        calibration.lux_per_level("blue")


def test_what_the_source_cannot_give_is_refused_in_lux(calibration: Calibration) -> None:
    with pytest.raises(
        InputError, match=r"^600 lux .* filter none: .* reaches 0.5 to 500 lux there \(1 to 1000 cd/m2"
    ):
        calibration.level_for(600.0, "none")
    with pytest.raises(InputError, match=r"reaches 0.006 to 6 lux"):
        calibration.level_for(0.005, "grey")
    for bad in (-1.0, math.nan, math.inf):
        with pytest.raises(InputError, match="reaches"):
            calibration.level_for(bad, "none")
    assert calibration.reachable(1.0, "grey")
    assert calibration.reachable(0.0, "grey")
    assert not calibration.reachable(6.1, "grey")


def test_the_limits_themselves_can_be_reached(calibration: Calibration) -> None:
    for name in calibration.filters:
        reach = calibration.lux_range(name)
        assert calibration.level_for(reach.lowest, name) == calibration.levels.lowest
        assert calibration.level_for(reach.highest, name) == calibration.levels.highest


def test_filter_by_optical_density(calibration: Calibration) -> None:
    assert calibration.filter_for(0.0) == "none"
    assert calibration.filter_for(2.0) == "grey"
    with pytest.raises(InputError, match=r"no filter of optical density 3; the station has 0 \(none\), 2 \(grey\)"):
        calibration.filter_for(3.0)


def test_settings_and_raw_biases(calibration: Calibration) -> None:
    assert calibration.biases_for(Settings()) == {}
    assert calibration.biases_for(Settings(theta_on=0.4, refractory_s=0.0055)) == {"bias_a": 10, "bias_b": 50}
    assert calibration.biases_for(Settings(theta_on=0.4, biases=(("bias_b", 3), ("bias_z", -1)))) == {
        "bias_a": 10,
        "bias_b": 3,
        "bias_z": -1,
    }
    assert calibration.biases_for(Settings(theta_on=0.4, biases=(("bias_a", 10),))) == {"bias_a": 10}


def test_conflicts_and_what_cannot_be_set_are_refused(calibration: Calibration) -> None:
    with pytest.raises(InputError, match="bias_a is set to offset 3, but the physical settings need it at 10"):
        calibration.biases_for(Settings(theta_on=0.4, biases=(("bias_a", 3),)))
    with pytest.raises(InputError, match=r"^theta_on 2 ln: bias_a reaches 0.1 to 0.8 ln"):
        calibration.biases_for(Settings(theta_on=2.0))
    with pytest.raises(InputError, match="bandwidth_hz: the station's bias map does not say"):
        calibration.biases_for(Settings(bandwidth_hz=100.0))


def test_settings_at_offsets_are_nan_where_nothing_is_known(calibration: Calibration) -> None:
    settings = calibration.settings_at({"bias_a": 20})
    assert settings["theta_on"] == 0.8
    assert settings["refractory_s"] == 0.01
    assert math.isnan(settings["theta_off"])
    assert math.isnan(settings["bandwidth_hz"])
    assert calibration.uncalibrated == ("theta_off", "refractory_s", "bandwidth_hz")


@pytest.mark.parametrize(
    ("distance_mm", "expected"), [(0.0, math.pi), (100.0, 0.387), (300.0, 0.0483), (1000.0, 0.0044)]
)
def test_bare_sensor_in_front_of_a_port(distance_mm: float, expected: float) -> None:
    geometry = BareGeometry(kind="bare", distance_mm=distance_mm, port_radius_mm=37.5)
    assert geometry.lux_per_luminance == pytest.approx(expected, rel=6e-3)


def test_lens() -> None:
    lens = LensGeometry(kind="lens", f_number=2.0, transmittance=0.9)
    assert lens.lux_per_luminance == pytest.approx(0.177, rel=3e-3)
    macro = LensGeometry(kind="lens", f_number=2.0, transmittance=0.9, magnification=1.0)
    assert macro.lux_per_luminance == pytest.approx(lens.lux_per_luminance / 4.0)


def test_geometry_replaces_a_measurement(write: Callable[..., Path]) -> None:
    geometry = {"kind": "bare", "distance_mm": 300.0, "port_radius_mm": 37.5}
    station = load_station(
        str(write({"calibration/light/lux_per_level": None, "calibration/light/geometry": geometry}))
    )
    assert station.calibration.lux_per_level("none") == pytest.approx(0.048332, rel=1e-4)
