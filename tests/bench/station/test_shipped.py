"""The stations that come with the bench."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from bench.station import Station, load_station, stations
from drivers.events.types import empty_events
from drivers.interfaces import Recording, Waveform
from protocols import library, load_protocol
from protocols.points import Roi, Settings

#: What the ready-made protocols ask for.
WANTED = {
    "theta_on": (0.2, 0.25, 0.27, 0.3, 0.33, 0.35),
    "theta_off": (0.2, 0.25, 0.27, 0.3, 0.33, 0.35),
    "refractory_s": (1e-4, 1e-3, 1e-2, 2e-2),
    "bandwidth_hz": (50.0, 200.0, 2000.0),
}
#: The range of each quantity that can be had at all.
REACH = {"theta_on": (0.1, 0.6), "theta_off": (0.1, 0.6), "refractory_s": (1e-4, 2e-2), "bandwidth_hz": (5.0, 5000.0)}


def settings(quantity: str, value: float) -> Settings:
    asked: dict[str, Any] = {quantity: value}
    return Settings(**asked)


@pytest.fixture(name="station", params=stations())
def shipped(request: pytest.FixtureRequest) -> Station:
    return load_station(request.param)


def test_names() -> None:
    assert stations() == ("simulated", "simulated_ideal", "simulated_paper", "wire", "wire_generator", "wire_rs7")


def test_common_settings_are_reached_exactly(station: Station) -> None:
    for quantity, values in WANTED.items():
        for value in values:
            biases = station.calibration.biases_for(settings(quantity, value))
            assert station.calibration.settings_at(biases)[quantity] == pytest.approx(value, rel=2e-3)


def test_range_of_settings_and_grain(station: Station) -> None:
    for quantity, (low, high) in REACH.items():
        for value in np.geomspace(low, high, 200).clip(low, high):
            biases = station.calibration.biases_for(settings(quantity, float(value)))
            assert station.calibration.settings_at(biases)[quantity] == pytest.approx(value, rel=0.06)


def test_every_bias_that_the_camera_takes_is_in_the_map(station: Station) -> None:
    for name, limits in station.camera.bias_limits.items():
        for offset in (int(limits.lowest), int(limits.highest)):
            assert all(math.isfinite(v) for v in station.calibration.settings_at({name: offset}).values())
    assert station.camera.bias_limits["bias_diff_on"].lowest == -85
    assert station.camera.bias_limits["bias_refr"].highest == 235


def test_factory_biases(station: Station) -> None:
    assert station.calibration.settings_at({}) == {
        "theta_on": 0.3,
        "theta_off": 0.25,
        "refractory_s": 5e-3,
        "bandwidth_hz": 200.0,
    }


def test_higher_bias_refr_is_a_shorter_dead_time(station: Station) -> None:
    curve = station.calibration.bias_map.curve("refractory_s")
    assert curve.bias == "bias_refr"
    assert curve.value_at(-20) == max(curve.values) == 20e-3


def test_what_is_believed_is_true(station: Station) -> None:
    resolved = station.resolved
    world, sensor = resolved["world"]["args"], resolved["sensor"]
    assert world["lux_per_level"] == station.calibration.lux_per_level("clear")
    conversion = world["pixel"]["photoconversion"]
    assert conversion == {
        "eta": sensor["quantum_efficiency"],
        "pitch_m": sensor["pixel_pitch_m"],
        "photons_per_lux": sensor["photons_per_lux"],
    }
    for name, known in station.calibration.filters.items():
        assert known.transmission == pytest.approx(10.0**-known.nd_od), name


def test_range_of_the_light(station: Station) -> None:
    calibration = station.calibration
    # Counts of an LED driver, volts of a generator, else cd/m2.
    limits = {"wire": (20.0, 60000.0), "wire_generator": (0.02, 9.5)}.get(station.name, (20.0, 15000.0))
    assert (calibration.levels.lowest, calibration.levels.highest) == limits
    assert calibration.reachable(300.0 * 1.5, "clear")
    assert calibration.reachable(0.076 / 1.5, calibration.filter_for(3.0))
    assert calibration.filter_for(1.0) == "nd10"
    assert calibration.filter_for(2.0) == "nd20"


def test_dark_current_is_that_of_the_paper() -> None:
    from sim_backend.devices.camera import SimulatedCamera
    from sim_backend.pixel.effects import DarkCurrent

    camera = load_station("simulated").camera
    assert isinstance(camera, SimulatedCamera)
    pixel = vars(camera)["_world"].pixel
    dark = pixel.effect("dark_current")
    assert isinstance(dark, DarkCurrent)
    assert dark.mean_fa / pixel.photoconversion.gain_fa_per_lux == pytest.approx(0.1463, rel=1e-3)


def record(station: Station, contrast: float, seed: int) -> int:
    """Return the number of ON events of four steps up by `contrast` in 4 x 4 pixels at 10 lux."""
    levels = [station.calibration.level_for(10.0 * math.exp(c), "clear") for c in (0.0, contrast)]
    station.camera.set_roi(Roi(600, 300, 4, 4))
    station.light.set_level(levels[0])
    station.clock.sleep(0.5)
    station.camera.start(Recording(seed=seed))
    station.light.play(Waveform(np.arange(8, dtype=np.float64) * 0.1, np.array(levels * 4), 0.8))
    station.camera.stop()
    events = np.concatenate([empty_events(), *(chunk.events for chunk in station.camera.chunks())])
    return int(np.count_nonzero(events["p"]))


def test_the_ideal_station_has_a_threshold_of_exactly_0_3() -> None:
    with load_station("simulated_ideal") as station:
        station.connect()
        assert record(station, 0.2999, seed=1) == 0
        assert record(station, 0.3001, seed=1) == 64


def test_the_simulated_station_is_noisy_and_repeatable() -> None:
    counts = []
    for seed in (1, 1, 2):
        with load_station("simulated") as station:
            station.connect()
            counts.append([record(station, contrast, seed) for contrast in (0.05, 0.12, 0.3)])
    assert counts[0] == counts[1] != counts[2]
    low, middle, high = counts[0]
    assert low < middle < high


@pytest.mark.parametrize("protocol", library.names())
def test_ready_made_protocols_get_the_settings_they_ask_for(protocol: str) -> None:
    calibration = load_station("simulated").calibration
    for asked in {point.settings for point in load_protocol(protocol).protocol.expand()}:
        got = calibration.settings_at(calibration.biases_for(asked))
        for quantity, value in got.items():
            wanted = getattr(asked, quantity)
            assert wanted is None or value == pytest.approx(wanted, rel=2e-3)
