"""The light of a point, against arrays written by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from protocols import stimulus_of
from protocols.estimation import recording_s
from protocols.points import ConstantTiming, Point, Polarity, ResetTestTiming, Roi, SquareTiming, Timing, Waveform
from protocols.waveforms import reset_test_edges, square_edges

LN2 = math.log(2.0)


def point(
    waveform: Waveform,
    polarity: Polarity,
    timing: Timing,
    *,
    lux: float = 10.0,
    contrast: float = LN2,
    pulses: int = 2,
) -> Point:
    return Point(0, "m", waveform, polarity, lux, contrast, pulses, timing, Roi(0, 0, 2, 2))


def test_square_wave() -> None:
    light = stimulus_of(point("square", "both", SquareTiming(frequency_hz=5.0, duty=0.25)))
    np.testing.assert_allclose(light.t_s, [0.0, 0.15, 0.20, 0.35, 0.40], atol=1e-15)
    np.testing.assert_allclose(light.lux, [10, 20, 10, 20, 10], rtol=1e-14)
    np.testing.assert_allclose(light.pulse_start_s, [0.15, 0.20, 0.35, 0.40], atol=1e-15)
    np.testing.assert_allclose(light.pulse_stop_s, [0.20, 0.35, 0.40, 0.55], atol=1e-15)
    np.testing.assert_array_equal(light.pulse_kind, [0, 1, 0, 1])
    assert light.duration_s == pytest.approx(0.55, abs=1e-15)


def test_reset_and_test_pulses_up() -> None:
    timing = ResetTestTiming(
        gap_s=0.1, reset_s=0.4, reset_log_contrast=math.log(1.5), reset_direction="up", test_s=0.2, window_s=0.25
    )
    light = stimulus_of(point("reset_test", "on", timing))
    np.testing.assert_allclose(light.t_s, [0, 0.1, 0.5, 0.6, 0.8, 0.9, 1.3, 1.4, 1.6], atol=1e-15)
    np.testing.assert_allclose(light.lux, [10, 15, 10, 20, 10, 15, 10, 20, 10], rtol=1e-14)
    np.testing.assert_allclose(light.pulse_start_s, [0.6, 1.4], atol=1e-15)
    np.testing.assert_allclose(light.pulse_stop_s, [0.85, 1.65], atol=1e-15)
    np.testing.assert_array_equal(light.pulse_kind, [0, 0])
    assert light.duration_s == pytest.approx(1.7, abs=1e-15)


def test_reset_and_test_pulses_down() -> None:
    timing = ResetTestTiming(0.1, 0.4, math.log(4.0), "down", 0.2, 0.2)
    light = stimulus_of(point("reset_test", "off", timing, pulses=1))
    np.testing.assert_allclose(light.lux, [10, 2.5, 10, 5, 10], rtol=1e-14)
    np.testing.assert_array_equal(light.pulse_kind, [1])


def test_a_reset_may_go_the_other_way() -> None:
    timing = ResetTestTiming(0.1, 0.4, math.log(4.0), "up", 0.2, 0.2)
    light = stimulus_of(point("reset_test", "off", timing, pulses=1))
    np.testing.assert_allclose(light.lux, [10, 40, 10, 5, 10], rtol=1e-14)


def test_constant_light() -> None:
    light = stimulus_of(point("constant", "both", ConstantTiming(5.0), lux=0.0, contrast=0.0, pulses=0))
    np.testing.assert_array_equal(light.t_s, [0.0])
    np.testing.assert_array_equal(light.lux, [0.0])
    assert light.duration_s == 5.0
    assert light.pulse_start_s.size == light.pulse_stop_s.size == light.pulse_kind.size == 0


@pytest.mark.parametrize(
    ("waveform", "timing"),
    [
        ("square", SquareTiming(5.0, 0.3)),
        ("reset_test", ResetTestTiming(0.04, 0.05, 0.5, "up", 0.03, 0.04)),
        ("constant", ConstantTiming(3.0)),
    ],
)
def test_light_is_well_formed(waveform: Waveform, timing: Timing) -> None:
    p = point(waveform, "on" if waveform == "reset_test" else "both", timing, pulses=1000)
    light = stimulus_of(p)
    assert light.t_s[0] == 0.0
    assert np.all(np.diff(light.t_s) > 0)
    assert light.t_s[-1] < light.duration_s
    assert light.t_s.shape == light.lux.shape
    assert light.t_s.flags.c_contiguous
    assert np.all(light.pulse_stop_s > light.pulse_start_s)
    assert np.all(light.pulse_stop_s <= light.duration_s)
    assert light.pulse_kind.dtype == np.uint8
    assert light.duration_s == pytest.approx(recording_s(p), rel=1e-12)


def test_late_edges_are_as_exact_as_early_ones() -> None:
    light = square_edges(period_s=0.1, duty=0.5, low_lux=1, high_lux=2, cycles=100_000, first_edge_s=0.05)
    assert light.t_s[-2] == pytest.approx(0.05 + 99_999 * 0.1, abs=2e-12)


def test_windows_of_a_square_wave_join() -> None:
    light = square_edges(period_s=0.0123, duty=0.37, low_lux=1, high_lux=2, cycles=50, first_edge_s=0.01)
    np.testing.assert_array_equal(light.pulse_start_s[1:], light.pulse_stop_s[:-1])
    np.testing.assert_array_equal(light.pulse_start_s, light.t_s[1:])


def test_recorded_reset_and_test_pulses_may_begin_late() -> None:
    light = reset_test_edges(
        baseline_lux=10,
        reset_lux=15,
        test_lux=5,
        gap_s=0.1,
        reset_s=0.4,
        test_s=0.2,
        cycles=1,
        first_edge_s=1.0,
    )
    np.testing.assert_allclose(light.t_s, [0, 1.0, 1.4, 1.5, 1.7], atol=1e-15)
    np.testing.assert_allclose(light.pulse_stop_s, [1.7], atol=1e-15)
    np.testing.assert_array_equal(light.pulse_kind, [1])
    assert light.duration_s == pytest.approx(1.8)
