"""Background rates against both thresholds, and the pair that is quiet enough."""

from __future__ import annotations

import itertools
import math

import pytest

from bench.analysis.results import Estimate
from bench.bias_calibration.quiet import NoiseRate, Tuning, tune
from bench.station.bias_map import BiasCurve

ON = BiasCurve("theta_on", "bias_diff_on", "log", (-40, 0, 40), (0.2, 0.3, 0.45), True)
OFF = BiasCurve("theta_off", "bias_diff_off", "log", (-20, 0, 20), (0.2, 0.25, 0.3125), True)
RMS = 0.05


def true_rate(theta_on: float, theta_off: float) -> float:
    """Crossings of Gaussian noise: the logarithm is linear in the squares of the thresholds."""
    return 5e3 * math.exp(-(theta_on**2 + theta_off**2) / (4.0 * RMS**2))


def rates() -> list[NoiseRate]:
    found = []
    for on, off in itertools.product(ON.offsets, OFF.offsets):
        hz = true_rate(ON.value_at(on), OFF.value_at(off))
        found.append(NoiseRate(on, off, Estimate(hz, 0.9 * hz, 1.1 * hz, "Hz")))
    return found


def test_the_lowest_equal_thresholds_within_the_rate() -> None:
    target = true_rate(0.25, 0.25) * 1.01
    found = tune(target, rates(), ON, OFF)
    assert isinstance(found, Tuning)
    assert found.off_offset == 0
    assert found.theta_on == pytest.approx(0.25, rel=0.006)  # half a step of the ON bias is 0.5 %
    assert found.theta_off == 0.25
    assert found.rate.value == pytest.approx(true_rate(found.theta_on, found.theta_off), rel=1e-6)
    assert found.rate.value <= target
    assert found.rate.high == pytest.approx(1.1 * found.rate.value)
    # One step lower is too loud: the pair is the most sensitive one.
    lower = true_rate(ON.value_at(found.on_offset - 1), OFF.value_at(found.off_offset - 1))
    assert lower > target


def test_a_rate_that_no_pair_is_below_is_refused() -> None:
    found = tune(1e-9, rates(), ON, OFF)
    assert isinstance(found, str)
    assert "1e-09 Hz is not reached" in found
    assert "bias_diff_off 20" in found


def test_where_all_pairs_are_quiet_the_lowest_comes_with_a_word() -> None:
    found = tune(1e9, rates(), ON, OFF)
    assert isinstance(found, Tuning)
    assert (found.on_offset, found.off_offset) == (-40, -20)
    assert "lower ones may be quiet enough too" in found.note


def test_pairs_that_are_missing_or_outside_the_curves() -> None:
    assert "all combinations" in str(tune(1.0, rates()[:-1], ON, OFF))
    assert "two or more offsets" in str(tune(1.0, [], ON, OFF))
    short = BiasCurve("theta_on", "bias_diff_on", "log", (0, 10), (0.3, 0.33), True)
    assert "two or more offsets" in str(tune(1.0, rates(), short, OFF))


def test_no_events_count_as_their_upper_limit() -> None:
    silent = [NoiseRate(r.on_offset, r.off_offset, Estimate(0.0, 0.0, 0.02, "Hz")) for r in rates()]
    assert isinstance(tune(0.019, silent, ON, OFF), str)
    found = tune(0.021, silent, ON, OFF)
    assert isinstance(found, Tuning)
    assert found.rate.value == pytest.approx(0.02)
