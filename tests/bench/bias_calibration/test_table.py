"""The order of a table: what is dropped, what is said, what is kept."""

from __future__ import annotations

import math

import pytest

from bench.bias_calibration.table import BiasTable, Row, make_table
from bench.station.bias_map import BiasCurve


def table(*rows: tuple[int, float, float]) -> BiasTable:
    return make_table("theta_on", "bias_diff_on", [Row(*row) for row in rows])


def test_a_table_in_order_is_a_curve() -> None:
    found = table((20, 0.4, 0.01), (-10, 0.2, 0.01), (0, 0.3, 0.02))
    assert found.usable
    assert found.remarks == ()
    assert found.curve() == BiasCurve("theta_on", "bias_diff_on", "log", (-10, 0, 20), (0.2, 0.3, 0.4), True)


def test_falling_values_are_in_order_too() -> None:
    assert table((-10, 0.02, 0.01), (0, 0.005, 0.01), (20, 0.001, 0.01)).curve().values == (0.02, 0.005, 0.001)


def test_a_row_out_of_order_within_its_error_is_dropped_with_a_remark() -> None:
    found = table((-10, 0.2, 0.01), (0, 0.3, 0.01), (10, 0.295, 0.03), (20, 0.4, 0.01))
    assert [row.offset for row in found.rows] == [-10, 0, 20]
    assert [row.offset for row in found.dropped] == [10]
    assert found.usable
    assert found.remarks == (
        "theta_on at bias_diff_on 10 is 0.295 ln, out of order with 0.3 ln at 0 by no more than their errors: the "
        "row is dropped",
    )


def test_the_vague_row_goes_and_the_exact_one_stays() -> None:
    found = table((-10, 0.2, 0.01), (0, 0.31, 0.05), (10, 0.3, 0.005), (20, 0.4, 0.01))
    assert [row.offset for row in found.dropped] == [0]


@pytest.mark.parametrize(("value", "usable"), [(0.3 * math.exp(-0.0232), True), (0.3 * math.exp(-0.0234), False)])
def test_beyond_the_error_there_is_no_curve(value: float, usable: bool) -> None:
    """1.645 standard errors of the difference of two rows of 1 % are 2.33 %."""
    found = table((-10, 0.2, 0.01), (0, 0.3, 0.01), (10, value, 0.0101), (20, 0.4, 0.01))
    assert found.usable is usable
    assert bool(found.broken) is not usable
    assert ("by more than their errors: theta_on has no curve" in found.remarks[0]) is not usable


def test_equal_values_are_out_of_order() -> None:
    found = table((0, 0.300001, 0.01), (10, 0.300002, 0.02), (20, 0.4, 0.01))
    assert [row.value for row in found.rows] == [0.3, 0.4]
    assert [row.offset for row in found.dropped] == [10]


def test_one_row_is_no_curve() -> None:
    assert not table().usable
    found = table((0, 0.3, 0.01))
    assert not found.usable
    assert found.remarks == ("theta_on: one offset of bias_diff_on with a value; a curve needs two",)


def test_the_interval_is_symmetric_in_the_logarithm() -> None:
    estimate = Row(0, 0.3, 0.1).estimate("theta_on")
    assert estimate.high / 0.3 == pytest.approx(math.exp(0.1645), rel=1e-4)
    assert estimate.high * estimate.low == pytest.approx(0.09)
    assert estimate.unit == "ln"
