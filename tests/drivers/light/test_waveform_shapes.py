"""Which waveforms are constant, which are square waves, and what is said of the others."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.interfaces import Waveform
from drivers.light.waveform_shapes import Constant, NoShape, SquareWave, shape_of
from protocols.waveforms import reset_test_edges, square_edges


def waveform(t_s: list[float], level: list[float], duration_s: float) -> Waveform:
    return Waveform(np.array(t_s, np.float64), np.array(level, np.float64), duration_s)


def square_of(cycles: int, period_s: float, duty: float, first_edge_s: float) -> Waveform:
    made = square_edges(
        period_s=period_s, duty=duty, low_lux=1.0, high_lux=3.0, cycles=cycles, first_edge_s=first_edge_s
    )
    return Waveform(made.t_s, made.lux, made.duration_s)


def test_one_level_is_constant_however_often_it_is_said() -> None:
    assert shape_of(waveform([0.0], [2.0], 1.5)) == Constant(2.0, 1.5)
    assert shape_of(waveform([0.0, 0.4, 0.5], [2.0, 2.0, 2.0], 1.5)) == Constant(2.0, 1.5)


def test_square_wave_as_protocols_make_it() -> None:
    shape = shape_of(square_of(30, 0.1, 0.25, 0.075))
    assert isinstance(shape, SquareWave)
    assert (shape.low, shape.high, shape.cycles, shape.ends_high) == (1.0, 3.0, 30, False)
    assert shape.first_edge_s == 0.075
    assert shape.period_s == pytest.approx(0.1, abs=1e-12)
    assert shape.duty == pytest.approx(0.25, abs=1e-9)
    assert shape.last_fall_s == pytest.approx(0.075 + 2.925, abs=1e-9)
    assert shape.duration_s == pytest.approx(3.075)


@given(
    cycles=st.integers(2, 200),
    period_us=st.integers(100, 10_000_000),
    duty=st.floats(0.05, 0.95),
    first_s=st.floats(1e-3, 10.0),
)
def test_square_waves_are_recognised_at_any_rate(cycles: int, period_us: int, duty: float, first_s: float) -> None:
    shape = shape_of(square_of(cycles, period_us * 1e-6, duty, first_s))
    assert isinstance(shape, SquareWave)
    assert shape.cycles == cycles
    assert shape.period_s == pytest.approx(period_us * 1e-6, abs=1e-9)
    assert shape.duty * shape.period_s == pytest.approx(duty * period_us * 1e-6, abs=1e-9)


def test_levels_that_are_said_twice_make_no_edge() -> None:
    shape = shape_of(waveform([0.0, 0.1, 0.2, 0.25, 0.3, 0.4], [1.0, 1.0, 3.0, 3.0, 1.0, 3.0], 0.5))
    assert isinstance(shape, SquareWave)
    assert (shape.cycles, shape.first_edge_s, shape.ends_high) == (2, 0.2, True)
    assert shape.period_s == pytest.approx(0.2)
    assert shape.duty == pytest.approx(0.5)


@pytest.mark.parametrize(("duration_s", "period_s"), [(0.5, 0.2), (0.4, 0.2), (0.3, 0.2), (0.35, 0.15)])
def test_single_pulse_gets_a_period_in_which_it_fits(duration_s: float, period_s: float) -> None:
    shape = shape_of(waveform([0.0, 0.2, 0.3], [1.0, 3.0, 1.0], duration_s))
    assert isinstance(shape, SquareWave)
    assert shape.cycles == 1
    assert shape.period_s == pytest.approx(period_s)
    assert shape.duty * shape.period_s == pytest.approx(0.1)


def test_reset_and_test_pulses_are_no_square_wave() -> None:
    made = reset_test_edges(
        baseline_lux=1.0, reset_lux=2.0, test_lux=1.2, gap_s=0.05, reset_s=0.02, test_s=0.02, cycles=3
    )
    assert shape_of(Waveform(made.t_s, made.lux, made.duration_s)) == NoShape(
        "it has 3 levels; a square wave has two"
    )


@pytest.mark.parametrize(
    ("t_s", "level", "duration_s", "reason"),
    [
        ([0.0, 0.1, 0.2], [3.0, 1.0, 3.0], 0.3, "begins with the higher"),
        ([0.0, 0.1, 0.2, 0.3, 0.45], [1.0, 3.0, 1.0, 3.0, 1.0], 0.6, "not of one length"),
        ([0.0, 0.1, 0.2, 0.3], [1.0, 3.0, 1.0, 3.0], 0.45, "not of one length"),
        ([0.0, 0.1, 0.2, 0.3, 0.4, 0.6, 0.7], [1.0, 3.0] * 3 + [1.0], 0.8, "not evenly spaced"),
        ([0.0, 0.1, 0.1], [1.0, 3.0, 1.0], 0.2, "not of one length"),
    ],
)
def test_what_is_not_square_is_told(t_s: list[float], level: list[float], duration_s: float, reason: str) -> None:
    shape = shape_of(waveform(t_s, level, duration_s))
    assert isinstance(shape, NoShape)
    assert reason in shape.reason


def test_a_microsecond_matters_and_a_nanosecond_does_not() -> None:
    def moved(by_s: float) -> object:
        return shape_of(waveform([0.0, 0.1, 0.2, 0.3, 0.4, 0.5 + by_s, 0.6 + by_s], [1.0, 3.0] * 3 + [1.0], 0.8))

    assert isinstance(moved(1e-9), SquareWave)
    assert isinstance(moved(3e-6), NoShape)


@pytest.mark.parametrize(
    ("t_s", "level", "duration_s"),
    [
        ([], [], 1.0),
        ([0.0, 0.1], [1.0], 1.0),
        ([0.1], [1.0], 1.0),
        ([0.0, 0.2, 0.1], [1.0, 2.0, 1.0], 1.0),
        ([0.0, 0.2], [1.0, 2.0], 0.1),
        ([0.0], [1.0], float("nan")),
        ([0.0], [1.0], float("inf")),
        ([0.0, float("nan")], [1.0, 2.0], 1.0),
    ],
)
def test_what_is_no_waveform_is_refused(t_s: list[float], level: list[float], duration_s: float) -> None:
    with pytest.raises(ValueError, match="waveform"):
        shape_of(waveform(t_s, level, duration_s))
