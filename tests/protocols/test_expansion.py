"""From a protocol to numbered points: values, order, seeds."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import pytest

from protocols.expected import off_log_contrast, on_log_contrast, rearm_log_contrast
from protocols.points import ConstantTiming, Point, ResetTestTiming, Roi, Settings, Settle, SquareTiming
from protocols.schema import Protocol

RESET_TEST = {
    "kind": "reset_test",
    "reset_s": 0.1,
    "test_s": 0.05,
    "reset_contrast": {"scale": "linear", "value": 0.5},
}
LOG = {"scale": "log", "values": [0.2, 0.3]}
THRESHOLD = {"scale": "threshold", "values": [0.5, 1, 2]}


def protocol(*measurements: dict[str, Any], **top: Any) -> Protocol:
    base = {"format": "evs-bench-protocol/1", "title": "t", "roi": {"x": 1, "y": 2, "width": 3, "height": 4}}
    named = [{"name": f"m{i}"} | m for i, m in enumerate(measurements)]
    return Protocol.model_validate(base | {"pulses": 10} | top | {"measurements": named})


def reset_test(sweep: dict[str, Any], **stimulus: Any) -> dict[str, Any]:
    written = RESET_TEST | stimulus
    if "polarity" not in sweep:
        written = {"polarity": "on"} | written
    return {"stimulus": {k: v for k, v in written.items() if v is not None}, "sweep": sweep}


def constant(lux: Any, **sweep: Any) -> dict[str, Any]:
    return {"stimulus": {"kind": "constant", "duration_s": 1}, "sweep": {"illuminance_lux": lux} | sweep}


def changes(points: tuple[Point, ...], key: str) -> int:
    return sum(getattr(a, key) != getattr(b, key) for a, b in pairwise(points))


def test_a_point_carries_everything() -> None:
    settings = {
        "long_refractory_period_s": 0.01,
        "imbalanced_thresholds": {"on": 0.3, "off": 0.2},
        "biases": {"b": 1},
    }
    measurement = reset_test({"illuminance_lux": 2, "contrast": {"scale": "linear", "values": [0.5]}, "nd_od": 3})
    (point,) = protocol(measurement, settings=settings, settle={"bias_s": 2}).expand()
    assert point == Point(
        index=0,
        measurement="m0",
        waveform="reset_test",
        polarity="on",
        baseline_lux=2.0,
        log_contrast=math.log(1.5),
        pulses=10,
        timing=ResetTestTiming(0.1, 0.1, math.log(1.5), "up", 0.05, 0.05),
        roi=Roi(1, 2, 3, 4),
        nd_od=3.0,
        settings=Settings(theta_on=0.3, theta_off=0.2, refractory_s=0.01, biases=(("b", 1),)),
        settle=Settle(0.2, 0.5, 2.0),
        seed=point.seed,
    )


def test_a_measurement_overrides_the_protocol() -> None:
    own = {
        "pulses": 3,
        "settings": {"bandwidth_hz": 50, "biases": {"c": 2}},
        "settle": {"light_s": 1},
        "roi": {"x": 0, "y": 0, "width": 1, "height": 1},
        "ambient": "capped",
    }
    common = {"settings": {"bandwidth_hz": 200, "biases": {"b": 1}}, "settle": {"bias_s": 2}}
    (point,) = protocol(
        reset_test({"illuminance_lux": 1, "contrast": LOG | {"values": [0.1]}}) | own, **common
    ).expand()
    assert point.pulses == 3
    assert point.settings == Settings(bandwidth_hz=50, biases=(("b", 1), ("c", 2)))
    assert point.settle == Settle(1.0, 0.5, 2.0)
    assert point.roi == Roi(0, 0, 1, 1)
    assert point.ambient == "capped"


def test_threshold_scale_on_off_and_square() -> None:
    dark, theta_on, theta_off = 0.146, 0.3, 0.25
    expect = {"dark_light_lux": dark, "theta_on": theta_on, "theta_off": theta_off}
    square = {
        "stimulus": {"kind": "square", "frequency_hz": 5},
        "sweep": {"illuminance_lux": 0.1, "contrast": THRESHOLD},
    }
    points = protocol(
        reset_test({"illuminance_lux": 0.1, "contrast": THRESHOLD, "polarity": ["on", "off"]}), square, expect=expect
    ).expand()
    on = on_log_contrast(0.1, theta_on, dark)
    off = off_log_contrast(0.1, theta_off, dark)
    expected = [0.5 * on, on, 2 * on, 0.5 * off, off, 2 * off, 0.5 * on, on, 2 * on]
    assert [p.log_contrast for p in points] == pytest.approx(expected, rel=1e-12)
    assert {p.polarity for p in points[6:]} == {"both"}


def test_threshold_scale_follows_the_settings() -> None:
    sweep = {
        "illuminance_lux": 100,
        "contrast": {"scale": "threshold", "values": [1]},
        "thresholds": [{"on": 0.2, "off": 0.1}, {"on": 0.4, "off": 0.1}],
    }
    points = protocol(reset_test(sweep), expect={"dark_light_lux": 0, "theta_on": 0.3}).expand()
    assert [p.log_contrast for p in points] == pytest.approx([0.2, 0.4], rel=1e-12)


@pytest.mark.parametrize("direction", ["same", "opposite"])
def test_reset_in_units_of_what_rearms(direction: str) -> None:
    expect = {"dark_light_lux": 0.146, "theta_on": 0.3, "theta_off": 0.25}
    sweep = {"illuminance_lux": 0.1, "contrast": LOG | {"values": [0.1]}, "polarity": ["on", "off"]}
    reset = {"reset_direction": direction, "reset_contrast": {"scale": "threshold", "value": 1.5}}
    on, off = (p.timing for p in protocol(reset_test(sweep, **reset), expect=expect).expand())
    assert isinstance(on, ResetTestTiming)
    assert isinstance(off, ResetTestTiming)
    assert (on.reset_direction, off.reset_direction) == (("up", "down") if direction == "same" else ("down", "up"))
    for timing in (on, off):
        unit = rearm_log_contrast(timing.reset_direction, 0.1, 0.3, 0.25, 0.146)
        assert timing.reset_log_contrast == pytest.approx(1.5 * unit, rel=1e-12)


def test_reset_for_each_level() -> None:
    by_level = [{"illuminance_lux": 1, "value": 0.5}, {"illuminance_lux": 0.1, "value": 1.0}]
    sweep = {
        "illuminance_lux": {"logspace": {"start": 0.1, "stop": 1, "num": 2}},
        "contrast": LOG | {"values": [0.1]},
    }
    points = protocol(reset_test(sweep, reset_contrast={"scale": "linear", "by_level": by_level})).expand()
    timings = [p.timing for p in points]
    assert [t.reset_log_contrast for t in timings if isinstance(t, ResetTestTiming)] == pytest.approx(
        [math.log(2), math.log(1.5)]
    )


def test_pulse_width_of_reset_test_sets_test_and_window() -> None:
    sweep = {"illuminance_lux": 1, "contrast": LOG | {"values": [0.1]}, "pulse_width_s": [0.01, 0.02]}
    timings = [p.timing for p in protocol(reset_test(sweep, test_s=None)).expand()]
    assert [(t.test_s, t.window_s) for t in timings if isinstance(t, ResetTestTiming)] == [(0.01, 0.01), (0.02, 0.02)]


def test_pulse_width_of_a_square_wave_is_its_bright_part() -> None:
    sweep = {"illuminance_lux": 1, "contrast": LOG | {"values": [0.1]}, "pulse_width_s": 0.02}
    (point,) = protocol({"stimulus": {"kind": "square", "duty": 0.2}, "sweep": sweep}).expand()
    assert isinstance(point.timing, SquareTiming)
    assert point.timing.frequency_hz == pytest.approx(10.0)
    assert point.timing.duty == 0.2


def test_linspace_and_logspace_are_values_with_both_ends() -> None:
    lin = protocol(constant({"linspace": {"start": 1, "stop": 3, "num": 5}})).expand()
    log = protocol(constant({"logspace": {"start": 0.01, "stop": 100, "num": 5}})).expand()
    assert [p.baseline_lux for p in lin] == [1.0, 1.5, 2.0, 2.5, 3.0]
    assert [p.baseline_lux for p in log] == pytest.approx([0.01, 0.1, 1, 10, 100], rel=1e-12)
    assert (log[0].baseline_lux, log[-1].baseline_lux) == (0.01, 100.0)
    assert log[0].timing == ConstantTiming(1.0)
    assert (log[0].pulses, log[0].log_contrast) == (0, 0.0)


def test_points_are_numbered_and_as_written_within_a_setting() -> None:
    points = protocol(reset_test({"illuminance_lux": [5, 1], "contrast": LOG, "polarity": ["off", "on"]})).expand()
    assert [p.index for p in points] == list(range(8))
    assert [(p.baseline_lux, p.polarity, p.log_contrast) for p in points] == [
        (lux, polarity, c) for lux in (5, 1) for polarity in ("off", "on") for c in (0.2, 0.3)
    ]


def test_filters_move_as_seldom_as_possible() -> None:
    below = {"od": 3, "below_lux": 1}
    points = protocol(constant([0.1, 10, 0.2], nd_od=below), constant([20, 0.3], nd_od=below)).expand()
    assert [p.baseline_lux for p in points] == [10, 20, 0.1, 0.2, 0.3]
    assert changes(points, "nd_od") == 1
    swept = protocol(constant([1, 2], nd_od=[3, 0, 1])).expand()
    assert [p.nd_od for p in swept] == [0, 0, 3, 3, 1, 1]


def test_settings_change_as_seldom_as_possible_within_a_filter() -> None:
    axes = {"bandwidth_hz": [200, 50], "biases": {"bias_fo": [0, 5]}, "nd_od": [0, 3]}
    points = protocol(constant([1, 2], **axes), constant([3], **axes)).expand()
    assert len(points) == 24
    assert changes(points, "nd_od") == 1
    # four settings at each filter, and the one that is in when the filter moves comes first behind it
    assert changes(points, "settings") == 6
    assert {p.settings.biases for p in points} == {(("bias_fo", 0),), (("bias_fo", 5),)}


def test_windows_are_an_axis() -> None:
    rois = [{"x": 0, "y": 0, "width": 2, "height": 2}, {"x": 4, "y": 0, "width": 2, "height": 2}]
    points = protocol(constant([1, 2], roi=rois)).expand()
    assert [p.roi.x for p in points] == [0, 0, 4, 4]


def test_points_do_not_cross_an_operators_step() -> None:
    step = {"operator": {"before": "put the lens cap on"}, "ambient": "capped"}
    dark = constant([0, 1], nd_od=[0, 3]) | step
    points = protocol(constant(5, nd_od=[3, 0]), dark, constant(6, nd_od=3)).expand()
    assert [p.measurement for p in points] == ["m0", "m0", "m1", "m1", "m1", "m1", "m2"]
    assert [p.operator_before for p in points] == [None, None, "put the lens cap on", None, None, None, None]
    assert [p.nd_od for p in points] == [0, 3, 3, 3, 0, 0, 3]


def test_points_do_not_cross_a_change_of_ambient_light() -> None:
    points = protocol(
        constant(5, nd_od=[0, 3]), constant(6, nd_od=[0, 3]) | {"ambient": "shrouded"}, constant(7, nd_od=3)
    ).expand()
    assert [p.measurement for p in points] == ["m0", "m0", "m1", "m1", "m2"]


def test_shuffling_permutes_contrasts_within_a_level_by_the_seed() -> None:
    values = [0.1 + 0.01 * i for i in range(20)]
    measurement = reset_test({"illuminance_lux": [1, 2], "contrast": {"scale": "log", "values": values}})
    written = protocol(measurement).expand()
    shuffled = protocol(measurement, order="shuffled").expand()
    assert [p.baseline_lux for p in shuffled] == [1] * 20 + [2] * 20
    for part in (slice(0, 20), slice(20, 40)):
        contrasts = [p.log_contrast for p in shuffled[part]]
        assert contrasts != values
        assert sorted(contrasts) == values
    again = protocol(measurement, order="shuffled").expand()
    other = protocol(measurement, order="shuffled", seed=1).expand()
    assert shuffled == again
    assert [p.log_contrast for p in other] != [p.log_contrast for p in shuffled]
    assert {(p.log_contrast, p.baseline_lux, p.seed) for p in written} == {
        (p.log_contrast, p.baseline_lux, p.seed) for p in shuffled
    }


def test_seeds_are_the_same_on_every_machine() -> None:
    points = protocol(constant([1, 2]), seed=7).expand()
    # SHA-256 of "7/m0/0" and "7/m0/1", the first 8 bytes as a big-endian number, halved
    assert [p.seed for p in points] == [0x2839E7F5D4F2D374, 0x6AD53FF2D8EC434F]


def test_seeds_differ_and_do_not_depend_on_other_measurements() -> None:
    alone = protocol(constant([1, 2, 1]) | {"name": "a"}, seed=7).expand()
    assert len({p.seed for p in alone}) == 3
    together = protocol(constant([9]) | {"name": "b"}, constant([1, 2, 1]) | {"name": "a"}, seed=7).expand()
    assert [p.seed for p in together[1:]] == [p.seed for p in alone]
    own = protocol(constant([1, 2, 1]) | {"name": "a", "seed": 7}, seed=1).expand()
    assert [p.seed for p in own] == [p.seed for p in alone]
    assert all(0 <= p.seed < 2**63 for p in together)


def test_expected_at_a_point() -> None:
    expect = {"dark_light_lux": 0.1, "theta_on": 0.3, "refractory_period_s": 0.001}
    made = protocol(constant(1), settings={"thresholds": {"on": 0.4, "off": 0.2}}, expect=expect)
    expected = made.expected_at(made.expand()[0])
    assert (expected.theta_on, expected.theta_off, expected.dark_light_lux) == (0.4, 0.2, 0.1)
    assert (expected.refractory_s, expected.bandwidth_hz) == (0.001, None)
    assert protocol(constant(1)).believed().dark_light_lux is None
