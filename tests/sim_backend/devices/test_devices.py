"""What the simulated devices do beyond the contract of their kind."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from drivers.events.types import empty_events
from drivers.interfaces import Recording, Waveform
from protocols.errors import InputError
from protocols.points import Ambient, Roi
from sim_backend.devices.camera import BIAS_RANGES, SimulatedCamera
from sim_backend.devices.filter_wheel import SimulatedFilterWheel
from sim_backend.devices.light import SimulatedLightSource
from sim_backend.world import OpticalBench

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy.typing as npt

CORNER_HZ = 200.0
TAU_S = 1.0 / (2.0 * math.pi * CORNER_HZ)
DT_US = 10


class Behaviour:
    """One bias moves both thresholds by a hundredth for each offset."""

    ranges: Mapping[str, tuple[int, int]] = {"bias_diff_on": (-20, 500)}

    def settings_at(self, offsets: Mapping[str, int]) -> dict[str, float]:
        theta = 0.3 + 0.01 * offsets.get("bias_diff_on", 0)
        return {"theta_on": theta, "theta_off": theta}


class Bench:
    """A connected noise-free bench."""

    def __init__(
        self, *, pixel: Mapping[str, Any] | None = None, light: Mapping[str, Any] | None = None, **more: Any
    ) -> None:
        base = {"noise_rms": 0.0, "corner_hz": CORNER_HZ, "refractory_s": 5e-3}
        self.world = OpticalBench(lux_per_level=0.05, pixel={**base, **(pixel or {})}, sensor_seed=5, **more)
        self.light = SimulatedLightSource(self.world, lowest=1.0, highest=20000.0, unit="cd/m2", **(light or {}))
        self.wheel = SimulatedFilterWheel(self.world, filters={"clear": 0.0, "nd30": 3.0}, move_s=0.5)
        self.camera = SimulatedCamera(self.world, bias_behaviour=Behaviour())
        for device in (self.light, self.wheel, self.camera):
            device.connect()
        self.camera.set_roi(Roi(3, 4, 2, 2))

    def step(
        self,
        log_contrast: float,
        low: float = 1000.0,
        seed: int = 1,
        ambient: Ambient = "open",
        length_s: float = 0.2,
    ) -> npt.NDArray[np.void]:
        """Return the events of a recording with a step up after 0.1 s."""
        self.light.set_level(low)
        self.world.clock.sleep(0.5)
        self.camera.start(Recording(seed=seed, ambient=ambient))
        self.light.play(Waveform(np.array([0.0, 0.1]), low * np.array([1.0, math.exp(log_contrast)]), length_s))
        self.camera.stop()
        return self.events()

    def events(self) -> npt.NDArray[np.void]:
        """Return the events of the last recording."""
        found = [chunk.events for chunk in self.camera.chunks()]
        return np.concatenate([empty_events(), *found])


def test_a_step_above_the_threshold_is_seen_once_by_each_pixel_and_when_it_should() -> None:
    bench = Bench()
    events = bench.step(0.5)
    # First-order low-pass: the output reaches theta after tau ln(c / (c - theta)).
    expected_us = 1e5 + 1e6 * TAU_S * math.log(0.5 / 0.2)
    assert len(events) == 4
    assert np.all(events["p"] == 1)
    assert np.all(np.abs(events["t"] - expected_us) <= DT_US)


def test_a_step_below_the_threshold_is_not_seen() -> None:
    assert len(Bench().step(0.2999)) == 0
    assert len(Bench().step(0.3001)) == 4


def test_biases_move_the_thresholds() -> None:
    bench = Bench()
    bench.camera.set_biases({"bias_diff_on": 10})
    assert len(bench.step(0.3999)) == 0
    assert len(bench.step(0.4001)) == 4
    bench.camera.set_biases({})
    assert len(bench.step(0.3999)) == 4


def test_dark_current_hides_a_step_behind_a_filter() -> None:
    # At 0.05 lux and 0.1 lux of dark light a step of 0.8 ln is one of ln((0.05 e^0.8 + 0.1) / 0.15) = 0.342.
    gain_fa = Bench().world.pixel.photoconversion.gain_fa_per_lux
    bench = Bench(pixel={"effects": {"dark_current": {"mean_fa": 0.1 * gain_fa}}})
    assert len(bench.step(0.8)) == 4
    bench.wheel.select("nd30")
    assert len(bench.step(0.8)) == 4
    assert len(bench.step(0.6)) == 0  # 0.242


def test_light_of_the_room_hides_a_step_as_dark_current_does() -> None:
    bench = Bench(ambient_lux=0.1)
    bench.wheel.select("nd30")
    assert len(bench.step(0.8)) == 4
    assert len(bench.step(0.6)) == 0
    assert len(bench.step(0.6, ambient="shrouded")) == 4
    assert len(bench.step(0.6)) == 0  # open again


def test_stray_light_acts_only_when_open() -> None:
    bench = Bench(pixel={"effects": {"stray_light": {"illuminance_lux": 0.1}}})
    bench.wheel.select("nd30")
    assert len(bench.step(0.6)) == 0
    assert len(bench.step(0.6, ambient="shrouded")) == 4


def test_under_a_cap_the_source_is_not_seen() -> None:
    gain_fa = Bench().world.pixel.photoconversion.gain_fa_per_lux
    bench = Bench(ambient_lux=0.1, pixel={"effects": {"dark_current": {"mean_fa": 0.1 * gain_fa}}})
    assert len(bench.step(2.0)) > 0
    assert len(bench.step(2.0, ambient="capped")) == 0


def test_rise_time_of_the_source_delays_the_events() -> None:
    sharp, slow = Bench().step(0.5), Bench(light={"rise_tau_s": 1e-3}).step(0.5)
    delay_us = np.median(slow["t"]) - np.median(sharp["t"])
    assert 500 < delay_us < 1500


def test_recording_without_a_waveform_sees_constant_light() -> None:
    bench = Bench(pixel={"noise_rms": 0.1})
    bench.light.set_level(1000.0)
    bench.camera.start(Recording(seed=1))
    bench.world.clock.sleep(0.5)
    bench.camera.stop()
    events = bench.events()
    assert len(events) > 10
    assert events["t"].max() < 500_000


def test_events_do_not_depend_on_when_a_recording_is_taken() -> None:
    bench = Bench(pixel={"noise_rms": 0.08})
    first = bench.step(0.5, seed=9)
    bench.world.clock.sleep(98_765.4321)
    np.testing.assert_array_equal(first, bench.step(0.5, seed=9))


def test_pixels_are_those_of_the_sensor_not_of_the_window() -> None:
    bench = Bench(pixel={"noise_rms": 0.08, "effects": {"threshold_mismatch": {}}})
    small = bench.step(0.5)
    bench.camera.set_roi(Roi(2, 4, 4, 4))
    large = bench.step(0.5)
    inside = (large["x"] >= 3) & (large["x"] < 5) & (large["y"] >= 4) & (large["y"] < 6)
    np.testing.assert_array_equal(small, large[inside])


def test_chunks_come_one_by_one_and_can_be_read_again() -> None:
    bench = Bench(pixel={"noise_rms": 0.1})
    bench.step(0.5, length_s=3.0)  # longer than the engine gathers events before it hands them over
    chunks = bench.camera.chunks()
    assert isinstance(chunks, Iterator)
    first = next(chunks)
    again = list(bench.camera.chunks())
    np.testing.assert_array_equal(first.events, again[0].events)
    assert len(again) > 1


def test_triggers_of_a_silent_recording_are_kept() -> None:
    bench = Bench()
    bench.step(0.1)
    chunks = list(bench.camera.chunks())
    assert [chunk.triggers["t"].tolist() for chunk in chunks] == [[100_000]]
    assert len(chunks[0].events) == 0


def test_a_bias_without_effect_has_no_range() -> None:
    limits = Bench().camera.bias_limits
    assert (limits["bias_hpf"].lowest, limits["bias_hpf"].highest) == (0, 0)
    assert (limits["bias_diff_on"].lowest, limits["bias_diff_on"].highest) == (-20, 140)


def test_source_timed_by_the_host_comes_late_and_says_so() -> None:
    bench = Bench(light={"timing": "host", "latency_s": 2e-3, "settling_s": 50e-3})
    bench.light.set_level(100.0)
    bench.camera.start(Recording())
    played = bench.light.play(Waveform(np.array([0.0, 0.02, 0.04]), np.array([100.0, 200.0, 100.0]), 0.06))
    bench.camera.stop()
    assert played.t_written_s is not None
    assert played.t_settled_s is not None
    np.testing.assert_allclose(played.t_written_s, [0.0, 0.02, 0.072])
    np.testing.assert_allclose(played.t_s, [0.0, 0.022, 0.074])
    np.testing.assert_allclose(played.t_settled_s, [0.0, 0.072, 0.124])
    triggers = np.concatenate([chunk.triggers for chunk in bench.camera.chunks()])
    assert triggers["t"].tolist() == [22_000, 74_000]
    assert triggers["p"].tolist() == [1, 0]


def test_a_waveform_that_makes_no_sense_is_refused() -> None:
    bench = Bench()
    with pytest.raises(ValueError, match="ascend from 0 s"):
        bench.light.play(Waveform(np.array([0.1]), np.array([100.0]), 1.0))
    with pytest.raises(ValueError, match="edge after its end"):
        bench.light.play(Waveform(np.array([0.0, 1.0]), np.array([100.0, 200.0]), 0.5))


def test_wrong_arguments_are_refused() -> None:
    world = OpticalBench(lux_per_level=1.0, pixel={}, sensor_seed=0)
    with pytest.raises(InputError, match="timing is 'clockwork'; expected host or device"):
        SimulatedLightSource(world, lowest=1.0, highest=2.0, unit="%", timing="clockwork")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="expected 0 < lowest < highest"):
        SimulatedLightSource(world, lowest=2.0, highest=1.0, unit="%")
    with pytest.raises(InputError, match="rise_tau_s is -1"):
        SimulatedLightSource(world, lowest=1.0, highest=2.0, unit="%", rise_tau_s=-1.0)
    with pytest.raises(InputError, match="has no filters"):
        SimulatedFilterWheel(world, filters={})
    with pytest.raises(InputError, match="filter nd has optical density -1"):
        SimulatedFilterWheel(world, filters={"nd": -1.0})
    erring = OpticalBench(lux_per_level=1.0, pixel={}, sensor_seed=0, nd_error_od={"nd3": 0.1})
    with pytest.raises(InputError, match="the world knows an error of nd3; it has clear, nd30"):
        SimulatedFilterWheel(erring, filters={"clear": 0.0, "nd30": 3.0})
    with pytest.raises(InputError, match="dt_s is 0"):
        SimulatedCamera(world, bias_behaviour=Behaviour(), dt_s=0.0)
    with pytest.raises(InputError, match="0 x 720 pixels"):
        SimulatedCamera(world, bias_behaviour=Behaviour(), width=0)


def test_biases_are_those_of_the_evk4() -> None:
    document = Path(__file__).parents[2] / "data" / "evk4" / "evk4_biases.json"
    biases = json.loads(document.read_text(encoding="utf-8"))["biases"]
    assert {b["name"]: (b["recommended_min"], b["recommended_max"]) for b in biases} == BIAS_RANGES


def test_the_low_pass_step_can_be_chosen() -> None:
    # At an eighth of the time constant it takes 8 samples to reach theta, or 7.
    arrivals = {}
    for step in ("exact", "euler"):
        bench = Bench()
        bench.camera = SimulatedCamera(bench.world, bias_behaviour=Behaviour(), dt_s=1e-4, step=step)
        bench.camera.connect()
        bench.camera.set_roi(Roi(3, 4, 2, 2))
        arrivals[step] = float(np.median(bench.step(0.5)["t"]))
    assert arrivals["euler"] < arrivals["exact"]
    with pytest.raises(InputError, match="step is 'midpoint'; expected exact or euler"):
        SimulatedCamera(bench.world, bias_behaviour=Behaviour(), step="midpoint")  # type: ignore[arg-type]
