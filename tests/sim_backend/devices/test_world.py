"""The simulated world: light, time and memory."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from protocols.errors import InputError
from sim_backend.clock import VirtualClock, to_ns
from sim_backend.world import OpticalBench


def world(**arguments: Any) -> OpticalBench:
    return OpticalBench(**{"lux_per_level": 0.05, "pixel": {}, "sensor_seed": 1, **arguments})


def test_lux_is_level_times_transmission_plus_ambient() -> None:
    bench = world(ambient_lux=0.02, nd_error_od={"nd30": 0.05})
    bench.set_level(1000.0)
    assert bench.lux() == pytest.approx(50.0 + 0.02)
    bench.set_filter("nd30", 3.0)
    assert bench.lux() == pytest.approx(50.0 * 10.0**-3.05 + 0.02)
    bench.set_filter("nd10", 1.0)
    assert bench.lux() == pytest.approx(5.0 + 0.02)


def test_shroud_keeps_the_room_out_and_a_cap_everything() -> None:
    bench = world(ambient_lux=0.5)
    bench.set_level(1000.0)
    bench.set_ambient("shrouded")
    assert bench.lux() == pytest.approx(50.0)
    bench.set_ambient("capped")
    assert bench.lux() == 0.0


def test_light_is_told_from_the_start_of_a_recording() -> None:
    bench = world()
    bench.rise_tau_s = 1e-4
    bench.set_level(100.0)
    bench.clock.sleep(1.0)
    start_ns = bench.clock.now_ns
    bench.clock.sleep(0.25)
    bench.set_level(200.0)
    bench.clock.sleep(0.25)
    light = bench.light(start_ns)
    np.testing.assert_array_equal(light.t_s, [0.0, 0.25])
    np.testing.assert_allclose(light.lux, [5.0, 10.0])
    assert light.rise_tau_s == 1e-4


def test_the_light_knows_the_filter_and_the_room() -> None:
    bench = world(ambient_lux=0.02)
    bench.set_filter("nd30", 3.0)
    bench.clock.sleep(0.1)
    start_ns = bench.clock.now_ns
    bench.set_level(100.0)
    bench.clock.sleep(0.1)
    bench.set_filter("open", 0.0)
    light = bench.light(start_ns)
    np.testing.assert_allclose(light.t_s, [0.0, 0.0, 0.1])
    np.testing.assert_allclose(light.lux, [0.02, 0.025, 5.02])
    np.testing.assert_array_equal(light.nd_od, [3.0, 3.0, 0.0])
    np.testing.assert_array_equal(light.room_lux, [0.02, 0.02, 0.02])
    bench.clock.sleep(0.1)
    bench.set_ambient("shrouded")
    shrouded = bench.light(bench.clock.now_ns)
    np.testing.assert_allclose(shrouded.lux, [5.0])
    np.testing.assert_array_equal(shrouded.room_lux, [0.0])


def test_a_step_at_the_very_start_of_a_recording_is_a_step() -> None:
    bench = world()
    bench.set_level(100.0)
    bench.clock.sleep(1.0)
    start_ns = bench.clock.now_ns
    bench.set_level(200.0)
    np.testing.assert_allclose(bench.light(start_ns).lux, [5.0, 10.0])
    np.testing.assert_array_equal(bench.light(start_ns).t_s, [0.0, 0.0])


def test_forgetting_keeps_the_level_that_still_holds() -> None:
    bench = world()
    for level in range(1, 1001):
        bench.set_level(float(level))
        bench.emit_trigger(rising=True)
        bench.clock.sleep(0.001)
    start_ns = bench.clock.now_ns
    before = bench.light(start_ns)
    bench.forget_before(start_ns)
    np.testing.assert_array_equal(bench.light(start_ns).lux, before.lux)
    np.testing.assert_allclose(before.lux, [50.0])
    assert bench.triggers(0, start_ns) == []
    bench.set_level(20.0)
    np.testing.assert_allclose(bench.light(start_ns).lux, [50.0, 1.0])


def test_a_level_that_does_not_change_the_light_is_no_step() -> None:
    bench = world()
    bench.set_level(100.0)
    bench.clock.sleep(1.0)
    bench.set_level(100.0)
    assert len(bench.light(0).t_s) == 2  # dark, and the first step


def test_times_of_a_recording_do_not_depend_on_when_it_is_taken() -> None:
    edges_s = np.arange(1, 50) * 0.0371
    taken = []
    for late_s in (0.0, 123_456.789):
        bench = world()
        bench.clock.sleep(late_s)
        start_ns = bench.clock.now_ns
        for i, t_s in enumerate(edges_s):
            bench.clock.advance_to(start_ns + to_ns(t_s))
            bench.set_level(20.0 + i)
        taken.append(bench.light(start_ns).t_s)
    np.testing.assert_array_equal(taken[0], taken[1])


def test_triggers_within_a_recording() -> None:
    bench = world()
    for _ in range(4):
        bench.clock.sleep(0.1)
        bench.emit_trigger(rising=True)
    assert [edge.time_ns for edge in bench.triggers(200_000_000, 400_000_000)] == [200_000_000, 300_000_000]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"lux_per_level": 0.0}, "lux_per_level is 0.0; expected more than 0 lux"),
        ({"ambient_lux": -1.0}, "ambient_lux is -1.0; expected 0 lux or more"),
        ({"ambient": "outdoors"}, "ambient is 'outdoors'; expected open or shrouded or capped"),
        ({"sensor_seed": -1}, r"sensor_seed is -1; expected 0 to 2\^64 - 1"),
        ({"sensor_seed": True}, r"sensor_seed is True; expected 0 to 2\^64 - 1"),
        ({"nd_error_od": {"nd30": float("nan")}}, "nd_error_od of nd30 is nan; expected -10 to 10"),
        ({"temperature_c": -300.0}, "temperature_c is -300.0; expected degrees Celsius"),
        ({"pixel": {"noise_rsm": 0.1}}, "did you mean noise_rms"),
        ({"pixel": {"effects": {"dark_curent": {}}}}, "did you mean dark_current"),
    ],
)
def test_wrong_arguments_are_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        world(**arguments)


def test_clock_advances_by_waiting_alone() -> None:
    clock = VirtualClock()
    assert clock.now() == clock.now() == 0.0
    clock.sleep(1.5)
    assert clock.now() == 1.5
    clock.advance_to(2_000_000_000)
    assert clock.now() == 2.0
    with pytest.raises(ValueError, match="cannot go back"):
        clock.advance_to(1)
    with pytest.raises(ValueError, match="expected 0 or more"):
        clock.sleep(float("nan"))
