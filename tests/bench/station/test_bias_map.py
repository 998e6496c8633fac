"""Offsets to physical values, and back."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.station.bias_map import BiasCurve, BiasMap
from protocols.errors import InputError

LOG = BiasCurve("theta_on", "bias_a", "log", (-10, 0, 20), (0.1, 0.2, 0.8))
FALLING = BiasCurve("refractory_s", "bias_b", "log", (-20, 0, 100), (20e-3, 5e-3, 1e-4))
LINEAR = BiasCurve("bandwidth_hz", "bias_c", "linear", (0, 10), (100.0, 200.0))
MAP = BiasMap((LOG, FALLING, LINEAR))


def test_rows_are_exact() -> None:
    for curve in MAP.curves:
        for offset, value in zip(curve.offsets, curve.values, strict=True):
            assert curve.value_at(offset) == value
            assert curve.offset_for(value) == offset


def test_between_rows_the_logarithm_or_the_value_is_linear() -> None:
    assert LOG.value_at(10) == pytest.approx(0.4)  # geometric mean of 0.2 and 0.8
    assert LOG.value_at(-5) == pytest.approx(math.sqrt(0.02))
    assert FALLING.value_at(-10) == pytest.approx(10e-3)
    assert LINEAR.value_at(3) == pytest.approx(130.0)


@given(st.sampled_from(MAP.curves), st.floats(0.0, 1.0))
def test_inverse_is_the_nearest_whole_offset(curve: BiasCurve, share: float) -> None:
    low, high = min(curve.values), max(curve.values)
    value = min(max(low * (high / low) ** share, low), high)

    def distance(offset: int) -> float:
        there = curve.value_at(offset)
        return abs(math.log(there / value)) if curve.scale == "log" else abs(there - value)

    found = curve.offset_for(value)
    assert distance(found) <= min(map(distance, range(curve.offsets[0], curve.offsets[-1] + 1))) * (1 + 1e-9)


@given(st.sampled_from(MAP.curves), st.integers(-20, 100))
def test_there_and_back(curve: BiasCurve, offset: int) -> None:
    if curve.offsets[0] <= offset <= curve.offsets[-1]:
        assert curve.offset_for(curve.value_at(offset)) == offset


def test_outside_the_table_is_refused_with_value_range_and_unit() -> None:
    with pytest.raises(InputError, match=r"^theta_on 0.9 ln: bias_a reaches 0.1 to 0.8 ln$"):
        LOG.offset_for(0.9)
    with pytest.raises(InputError, match=r"^refractory_s 0.05 s: bias_b reaches 0.0001 to 0.02 s$"):
        FALLING.offset_for(0.05)
    with pytest.raises(InputError, match=r"^bias_a at offset 21: theta_on is known from offset -10 to 20$"):
        LOG.value_at(21)
    with pytest.raises(InputError, match="nan"):
        LOG.offset_for(math.nan)


def test_map_reads_both_ways() -> None:
    offsets = MAP.offsets_for({"theta_on": 0.4, "refractory_s": 10e-3})
    assert offsets == {"bias_a": 10, "bias_b": -10}
    settings = MAP.settings_at(offsets)
    assert settings == pytest.approx({"theta_on": 0.4, "refractory_s": 10e-3, "bandwidth_hz": 100.0})


def test_quantity_that_is_not_in_the_map_is_refused() -> None:
    with pytest.raises(InputError, match="theta_off: the station's bias map does not say which bias sets it"):
        MAP.offsets_for({"theta_off": 0.2})


def test_one_bias_cannot_be_at_two_offsets() -> None:
    shared = BiasMap((LOG, BiasCurve("theta_off", "bias_a", "log", (-5, 10), (0.1, 0.3))))
    assert shared.ranges == {"bias_a": (-5, 10)}
    assert shared.offsets_for({"theta_on": 0.2, "theta_off": shared.settings_at({})["theta_off"]}) == {"bias_a": 0}
    with pytest.raises(InputError, match=r"^theta_off 0.3 ln needs bias_a at offset 10, but theta_on needs it at 0"):
        shared.offsets_for({"theta_on": 0.2, "theta_off": 0.3})
