"""Residuals against the independent variables, and what they scatter by chance."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bench.diagnosis.comparison import Residual
from bench.diagnosis.telling.by_axis import ALL_VIEWS, by_axis, worst_places

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt


def made(z: npt.NDArray[np.float64], view: str = "response", **places: npt.NDArray[np.float64]) -> list[Residual]:
    """Return residuals with these deviates; what is not named is alike in all."""
    values = {"baseline_lux": 1.0, "log_contrast": 0.3, "width_s": 0.1, "nd_od": 0.0}
    rows: list[dict[str, Any]] = [{**values, **{k: float(v[i]) for k, v in places.items()}} for i in range(len(z))]
    return [Residual(view, "on", i, **row, observed=0.5, predicted=0.5, sigma=0.1, z=float(z[i])) for i, row in
            enumerate(rows)]  # fmt: skip


def test_a_bin_holds_the_mean_and_the_mean_square_of_its_residuals() -> None:
    found = by_axis(made(np.array([1.0, 3.0, -2.0]), baseline_lux=np.array([1.0, 1.0, 10.0])))
    low, high = (b for b in found if b.axis == "illuminance" and b.view == ALL_VIEWS)
    assert (low.count, low.mean, low.square) == (2, 2.0, 5.0)
    assert (high.count, high.mean, high.square) == (1, -2.0, 4.0)
    assert (low.mean_sd, low.square_sd) == pytest.approx((math.sqrt(0.5), 1.0))
    assert [b.low for b in found if b.axis == "ND filter" and b.view == "response"] == [0.0]


def test_residuals_that_depend_on_each_other_scatter_more() -> None:
    """The mean of two that are one is no sharper than one."""
    residuals = made(np.zeros(2))
    same = next(iter(by_axis(residuals, np.ones((2, 2)))))
    apart = next(iter(by_axis(residuals)))
    assert (same.mean_sd, same.square_sd) == pytest.approx((1.0, math.sqrt(2.0)))
    assert (apart.mean_sd, apart.square_sd) == pytest.approx((math.sqrt(0.5), 1.0))


def test_the_scatter_that_is_told_is_the_one_that_is_found() -> None:
    rng = np.random.default_rng(5)
    mutual = 0.6 * np.ones((6, 6)) + 0.4 * np.eye(6)
    draws = rng.multivariate_normal(np.zeros(6), mutual, 400)
    bins = [next(iter(by_axis(made(z), mutual))) for z in draws]
    # 400 draws know a standard deviation to 3.5 %, that of a square (long tail) to 8 %: four of those
    assert np.std([b.mean for b in bins]) == pytest.approx(bins[0].mean_sd, rel=0.14)
    assert np.std([b.square for b in bins]) == pytest.approx(bins[0].square_sd, rel=0.32)


def test_many_values_are_taken_together_in_the_order_of_the_axis() -> None:
    contrast = np.linspace(0.1, 0.9, 30)
    bins = [
        b for b in by_axis(made(np.ones(30), log_contrast=contrast)) if b.axis == "contrast" and b.view == ALL_VIEWS
    ]
    assert len(bins) == 8
    assert sum(b.count for b in bins) == 30
    assert all(a.high < b.low for a, b in pairwise(bins))


def test_background_stands_on_no_contrast_axis_and_halves_on_their_own() -> None:
    silent = np.array([np.nan])
    bins = by_axis(made(np.ones(1), "background_halves", log_contrast=np.zeros(1), width_s=silent))
    assert {b.axis for b in bins} == {"anywhere", "illuminance", "polarity", "ND filter", "order", "halves"}


def test_a_failure_that_grows_as_the_light_falls_is_told_so(
    residuals_of: Callable[[float], tuple[Residual, ...]],
) -> None:
    places = worst_places(residuals_of(30.0))
    assert (places[0].worst.view, places[0].worst.part) == ("response", "on")
    (change,) = places[0].changes
    assert (change.axis, change.way, change.flat_above, change.flat_below) == ("illuminance", "falls", 10.0, None)


def test_chance_is_no_place() -> None:
    rng = np.random.default_rng(3)
    lux = np.repeat([0.1, 1.0, 10.0, 100.0], 10)
    assert worst_places(made(np.clip(rng.standard_normal(40), -3.0, 3.0), baseline_lux=lux)) == ()


def test_a_jump_at_one_point_in_the_middle_is_called_a_peak() -> None:
    z = np.array([0.1, -0.2, 20.0, 0.3, -0.1])
    (place,) = worst_places(made(z, baseline_lux=np.array([0.1, 1.0, 10.0, 100.0, 1000.0])))
    assert [(c.way, c.at) for c in place.changes] == [("peaks", 10.0)]


def test_drift_over_the_run_is_told_where_nothing_else_changes() -> None:
    (place,) = worst_places(made(np.linspace(-8.0, 8.0, 9)))
    assert [(c.axis, c.way) for c in place.changes] == [("order", "falls")]
