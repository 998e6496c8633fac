"""Lux per level and transmissions from readings of a meter."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest

from bench.photometry.meter import Reading, calibrate
from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence


def readings(pairs: Sequence[tuple[float, float]], name: str = "clear", first_line: int = 2) -> list[Reading]:
    return [Reading(first_line + i, level, lux, 1e-9, name) for i, (level, lux) in enumerate(pairs)]


def test_slope_and_error_are_those_of_the_ratios() -> None:
    found = calibrate(readings([(10.0, 5.1), (100.0, 49.0), (1000.0, 500.0)]), "r.csv")
    ratios = np.array([0.51, 0.49, 0.5])
    assert found.lux_per_level.value == pytest.approx(0.5)
    assert found.lux_per_level.sd == pytest.approx(ratios.std(ddof=1) / math.sqrt(3))
    # the weighted least squares, written out
    levels, lux = np.array([10.0, 100.0, 1000.0]), np.array([5.1, 49.0, 500.0])
    weights = levels**-2
    assert found.clear.slope.value == pytest.approx(np.sum(weights * levels * lux) / np.sum(weights * levels**2))
    assert (found.clear.ambient, found.clear.odd, found.filters) == (None, (), ())


def test_the_meters_own_error_goes_into_the_slope_and_not_into_the_transmission() -> None:
    taken = [*readings([(100.0, 50.0), (200.0, 101.0)]), *readings([(100.0, 5.0), (200.0, 10.1)], "nd10", 4)]
    without, with_own = (calibrate(taken, "r.csv", meter_uncertainty=u) for u in (None, 0.03))
    scatter = without.lux_per_level.sd / without.lux_per_level.value
    total = with_own.lux_per_level.sd / with_own.lux_per_level.value
    assert total == pytest.approx(math.hypot(scatter, 0.03))
    (line,) = with_own.filters
    transmission = with_own.transmission(line)
    assert transmission.value == pytest.approx(0.1)
    assert transmission.sd / transmission.value == pytest.approx(math.sqrt(2.0) * scatter, rel=1e-4)
    assert transmission == without.transmission(without.filters[0])


def test_the_light_of_the_room_is_subtracted_where_it_was_read() -> None:
    lit = [(100.0, 51.0), (200.0, 101.0), (400.0, 201.0)]
    found = calibrate(readings([(0.0, 0.9), (0.0, 1.1), *lit]), "r.csv")
    assert found.clear.ambient is not None
    assert [found.clear.ambient.value, found.clear.ambient.sd] == pytest.approx([1.0, 0.1])
    assert found.clear.slope.value == pytest.approx(0.5)
    assert found.clear.slope.sd == pytest.approx(0.1 * np.mean([1 / 100, 1 / 200, 1 / 400]))
    assert found.clear.readings == 3


def test_saturated_readings_are_pointed_out_and_left_out_only_if_named() -> None:
    levels = [500.0, 1000.0, 1500.0, 2000.0, 3000.0, 4000.0, 6000.0, 8000.0]
    scatter = [1.002, 0.999, 1.001, 0.998, 1.0, 1.001, 0.9, 0.85]
    taken = readings([(level, 0.05 * level * s) for level, s in zip(levels, scatter, strict=True)])
    found = calibrate(taken, "r.csv")
    assert [odd.reading.line for odd in found.clear.odd] == [8, 9]
    assert [odd.off for odd in found.clear.odd] == pytest.approx([-0.1, -0.15], abs=2e-3)
    assert found.clear.slope.value < 0.0495
    without = calibrate(taken, "r.csv", leave_out=(9, 8))
    assert without.clear.slope.value == pytest.approx(0.05, rel=1e-3)
    assert (without.clear.odd, without.left_out, without.clear.readings) == ((), (8, 9), 6)


def test_the_rounding_of_the_display_is_nothing_odd() -> None:
    taken = [Reading(i, 100.0, lux, 0.5, "clear") for i, lux in enumerate([50.0, 50.0, 50.0, 50.0, 50.4])]
    assert calibrate(taken, "r.csv").clear.odd == ()
    taken[-1] = Reading(4, 100.0, 52.0, 0.5, "clear")
    assert [odd.reading.line for odd in calibrate(taken, "r.csv").clear.odd] == [4]


def test_sound_readings_are_seldom_called_odd() -> None:
    random = np.random.default_rng(3)
    alarms = 0
    for _ in range(200):
        pairs = [(level, 0.05 * level * (1.0 + 0.01 * random.standard_normal())) for level in range(100, 1100, 100)]
        alarms += bool(calibrate(readings(pairs), "r.csv").clear.odd)
    assert alarms <= 10  # 2 are expected; with probability 1e-4 more than 9


@pytest.mark.parametrize(
    ("taken", "leave_out", "message"),
    [
        (readings([(100.0, 50.0)]), (), "expected 2 lit readings or more without a filter .*, found 1"),
        (readings([(0.0, 0.1)]), (), "found 0"),
        (readings([(1.0, 2.0), (2.0, 4.0)], "nd10"), (), "without a filter"),
        ([*readings([(1.0, 2.0), (2.0, 4.0)]), *readings([(1.0, 0.2)], "nd10", 4)], (), "behind nd10 .*, found 1"),
        (readings([(1.0, 2.0), (2.0, 4.0)]), (9,), "r.csv: line 9 holds no reading"),
        (readings([(0.0, 3.0), (1.0, 2.0), (2.0, 4.0)]), (), "r.csv:3:1: lux: 2 at level 1 is not above"),
        (readings([(1.0, 0.0), (2.0, 4.0)]), (), "r.csv:2:1: lux: 0 at level 1 is not above"),
    ],
)
def test_readings_that_tell_nothing_are_refused(
    taken: list[Reading], leave_out: tuple[int, ...], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        calibrate(taken, "r.csv", leave_out=leave_out)
