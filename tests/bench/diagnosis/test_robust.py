"""Least squares for small residuals, least absolute values for large ones."""

from __future__ import annotations

import numpy as np
import pytest

from bench.diagnosis.robust import loss, positive, solve

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
