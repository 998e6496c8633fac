"""Least squares for small residuals, least absolute values for large ones."""

from __future__ import annotations

import numpy as np
import pytest

from bench.diagnosis.fitting.robust import loss, positive, solve, without

RNG = np.random.default_rng(11)
OPEN = np.full(2, 1e9)


def test_small_residuals_are_least_squares() -> None:
    columns, residual = RNG.standard_normal((500, 2)), 0.01 * RNG.standard_normal(500)
    found, fall = solve(columns, residual, np.zeros(2), np.zeros(2), -OPEN, OPEN)
    true, rest, *_ = np.linalg.lstsq(columns, residual, rcond=None)
    assert found == pytest.approx(true, rel=1e-3)
    assert fall == pytest.approx(float(residual @ residual - rest[0]), rel=1e-3)


def test_a_few_points_that_are_far_off_do_not_decide() -> None:
    columns = np.ones((500, 1))
    residual = RNG.standard_normal(500)
    residual[:100] += 300.0  # a mean would be 60
    found, _ = solve(columns, residual, np.zeros(1), np.zeros(1), -OPEN[:1], OPEN[:1])
    # Each of the far ones pulls by 4: 400 of them against 400 near ones that pull by their distance.
    assert abs(found[0] - 1.0) < 4.0 / np.sqrt(400) + 0.2


def test_bounds_hold_and_the_others_follow() -> None:
    base = RNG.standard_normal(300)
    columns = np.stack([base, base + 0.3 * RNG.standard_normal(300)], axis=1)
    residual = columns @ np.array([0.5, -0.4])
    low = np.array([-1e9, 0.0])
    found, _ = solve(columns, residual, np.zeros(2), np.zeros(2), low, OPEN)
    alone = solve(columns[:, :1], residual, np.zeros(1), np.zeros(1), -OPEN[:1], OPEN[:1])[0]
    assert found[1] == 0.0
    assert found[0] == pytest.approx(alone[0], rel=1e-2)


def test_at_the_bounds_no_coefficient_wants_to_come_back() -> None:
    """Many columns that are much alike, tight bounds: where it is not zero the gradient points out of the bounds."""
    for _ in range(50):
        columns = RNG.standard_normal((100, 1)) + 0.1 * RNG.standard_normal((100, 6))
        residual = 1e-2 * columns @ RNG.standard_normal(6) + 1e-3 * RNG.standard_normal(100)
        low, high = (
            np.array([-0.7, -0.3, -0.1, 0.0, 0.0, -1e-9]) * 1e-2,
            np.array([0.7, 0.3, 0.1, 2.0, 2.0, 1e-9]) * 1e-2,
        )
        found, _ = solve(columns, residual, np.zeros(6), np.zeros(6), low, high)
        downhill = columns.T @ (residual - columns @ found)
        width = high - low
        inside = (found > low + 1e-6 * width) & (found < high - 1e-6 * width)
        steepest = np.abs(columns.T @ residual).max()
        assert np.abs(downhill[inside]).max(initial=0.0) < 1e-3 * steepest
        assert np.all(downhill[found >= high - 1e-6 * width] > -1e-3 * steepest)
        assert np.all(downhill[found <= low + 1e-6 * width] < 1e-3 * steepest)


def test_chance_in_the_columns_that_is_known_makes_no_step_shorter() -> None:
    n = 4000
    true = RNG.standard_normal((n, 2))
    chance = np.diag([0.5, 1.0])
    seen = true + RNG.standard_normal((n, 2)) @ np.sqrt(chance)
    residual = 0.02 * true @ np.array([1.0, -1.0])
    shorter, _ = solve(seen, residual, np.zeros(2), np.zeros(2), -OPEN, OPEN)
    found, _ = solve(seen, residual, np.zeros(2), np.zeros(2), -OPEN, OPEN, chance=lambda w: float(w.sum()) * chance)
    # Of independent columns of unit variance a share of 1 / (1 + variance of chance) is left.
    assert shorter == pytest.approx(0.02 * np.array([1.0 / 1.5, -1.0 / 2.0]), rel=0.1)
    assert found == pytest.approx(0.02 * np.array([1.0, -1.0]), rel=0.15)


def test_the_loss_is_square_for_small_and_straight_for_large_residuals() -> None:
    assert loss(np.array([0.1])) == pytest.approx(0.01, rel=1e-3)
    assert loss(np.array([2000.0])) / loss(np.array([1000.0])) == pytest.approx(2.0, rel=0.01)


def test_negative_information_is_none() -> None:
    found = positive(np.array([[1.0, 0.0], [0.0, -1e-3]]))
    assert found == pytest.approx(np.array([[1.0, 0.0], [0.0, 0.0]]))


def test_in_no_direction_all_is_taken_for_chance() -> None:
    products = np.diag([4.0, 9.0, 1e-6])
    found = without(products, np.diag([1.0, 8.9, 1e-6]))
    assert found == pytest.approx(np.diag([3.0, 0.2 * 9.0, 0.2e-6]))
    # Whatever the directions are: what is left is a share between 0.2 and 1 of the products.
    turn = np.linalg.qr(RNG.standard_normal((3, 3)))[0]
    turned = without(13.0 * np.eye(3), turn @ np.diag([1.0, 5.0, 20.0]) @ turn.T)
    assert turned == pytest.approx(turn @ np.diag([12.0, 8.0, 0.2 * 13.0]) @ turn.T)
