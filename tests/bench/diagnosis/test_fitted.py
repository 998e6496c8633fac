"""Intervals of fitted numbers: as wide as chance says, and as points disagree."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.diagnosis.expected.parameters import base_parameters
from bench.diagnosis.expected.problem import Slot
from bench.diagnosis.fitting.fitted import Fit, solve
from sim_backend.pixel import PixelModel

POINTS, EACH = 25, 8
N = POINTS * EACH
WHERE = [slice(i * EACH, (i + 1) * EACH) for i in range(POINTS)]


def mean_of(residual: np.ndarray[tuple[int], np.dtype[np.float64]]) -> Fit:
    """Return the fit of one number, known from nothing else, that all statistics are equal to."""
    free = replace(base_parameters(refractory_known=True)[0], prior_sd=np.inf)
    ones = np.ones((N, 1))
    return Fit(
        model=PixelModel(), slots=(Slot(free),), x=np.zeros(1), start=np.zeros(1), value=np.zeros(N),
        ratio=np.zeros(N), roots=(np.eye(EACH),) * POINTS, deviation=np.ones(N), jacobian=np.stack([ones, ones]),
        scale=1.0, residual=residual,
    )  # fmt: skip


def test_where_points_agree_the_interval_is_that_of_chance() -> None:
    within = np.tile(np.array([1.0, -1.0] * (EACH // 2)), POINTS)
    assert mean_of(within).covariance(WHERE)[0, 0] == pytest.approx(1.0 / N)


def test_where_points_disagree_it_is_as_wide_as_they_do() -> None:
    """The jackknife of a mean is the variance between points over their number."""
    away = np.random.default_rng(3).normal(scale=2.0, size=POINTS)
    away -= away.mean()
    expected = float(away.var(ddof=1)) / POINTS
    assert expected > 2.0 / N
    assert mean_of(np.repeat(away, EACH)).covariance(WHERE)[0, 0] == pytest.approx(expected)


def _of_columns(halves: np.ndarray[tuple[int, int, int], np.dtype[np.float64]]) -> Fit:
    """Return a fit that leaves nothing over, of numbers of which nothing is known beforehand."""
    k = halves.shape[2]
    free = replace(base_parameters(refractory_known=True)[0], prior_sd=np.inf)
    return replace(
        mean_of(np.zeros(N)), slots=(Slot(free),) * k, x=np.zeros(k), start=np.zeros(k), jacobian=halves
    )  # fmt: skip


def test_chance_in_the_changes_hardly_moves_the_interval_of_what_is_badly_known() -> None:
    """Two numbers that do nearly the same; what tells them apart is hardly more than the chance in it."""
    rng = np.random.default_rng(5)
    both, apart = rng.normal(size=(2, N))
    changes = np.stack([5.0 * both + 0.4 * apart, 5.0 * both - 0.4 * apart], axis=1)
    truth = np.sqrt(np.diag(np.linalg.inv(changes.T @ changes)))
    for _ in range(50):
        halves = changes + rng.normal(scale=0.5, size=(2, N, 2))
        found = np.sqrt(np.diag(_of_columns(halves).covariance(WHERE)))
        assert np.all((found > truth / 2.0) & (found < truth * 2.0)), (found, truth)


def test_fits_end_as_far_off_as_chance_in_the_changes_leads_them() -> None:
    """Half of what is seen is chance: fits end 1.4 times as far off as the residuals alone tell."""
    rng = np.random.default_rng(6)
    changes = rng.normal(size=(N, 2))
    ends, told, alone = [], [], []
    for _ in range(200):
        halves = changes + rng.normal(scale=np.sqrt(2.0), size=(2, N, 2))
        one, residual = _of_columns(halves), rng.normal(size=N)
        columns = halves.mean(axis=0)
        ends.append(np.linalg.solve(columns.T @ changes, columns.T @ residual))  # where they see nothing any more
        told.append(np.diag(one.scatter(WHERE)))
        alone.append(np.diag(one.covariance(WHERE)))
    found, squares = np.mean(np.sqrt(told)), np.sqrt(np.mean(np.square(ends)))
    assert found == pytest.approx(squares, rel=4.0 / np.sqrt(2.0 * 400))
    assert np.mean(np.sqrt(alone)) < 0.8 * squares


def test_what_is_hardly_seen_of_a_valley_is_not_taken_for_more_than_it_is() -> None:
    """Of a twentieth that is no chance an interval was half as long as it is."""
    n, signal = 5000, np.sqrt(0.5 / 19.0)
    rng = np.random.default_rng(9)
    where = [slice(i, i + EACH) for i in range(0, n, EACH)]
    changes = np.full((n, 1), signal)
    for _ in range(20):
        halves = changes + rng.normal(size=(2, n, 1))
        one = replace(_of_columns(halves), residual=np.zeros(n), roots=(np.eye(EACH),) * len(where))
        assert np.sqrt(one.covariance(where)[0, 0]) < 0.6 / (signal * np.sqrt(n))
        assert np.sqrt(one.scatter(where)[0, 0]) > 0.8 / (signal * np.sqrt(n))


def test_of_a_number_that_changes_nothing_nothing_is_known() -> None:
    halves = np.ones((2, N, 2))
    halves[:, :, 1] = 0.0
    found = np.diag(_of_columns(halves).covariance(WHERE))
    assert found[0] == pytest.approx(1.0 / N)
    assert np.isinf(found[1])


@pytest.mark.parametrize("unit", [1e-6, 1e-9])
def test_intervals_do_not_depend_on_the_unit_in_which_another_number_is_counted(unit: float) -> None:
    """Neither by chance nor by how points disagree."""
    rng = np.random.default_rng(7)
    one = _of_columns(np.tile(rng.normal(size=(N, 3)), (2, 1, 1)))
    one = replace(one, residual=rng.normal(size=N) + np.repeat(rng.normal(scale=2.0, size=POINTS), EACH))
    before = one.covariance(WHERE)
    units = np.array([1.0, unit, 1.0])
    after = replace(one, jacobian=one.jacobian / units).covariance(WHERE)
    np.testing.assert_allclose(after, before * np.outer(units, units), rtol=1e-6)


def test_a_solution_does_not_depend_on_the_units_either() -> None:
    rng = np.random.default_rng(8)
    columns, residual, units = rng.normal(size=(N, 3)), rng.normal(size=N), np.array([1e3, 1e-9, 1.0])
    before = solve(columns, residual, np.array([0.0, 2.0, 5.0]))
    after = solve(columns / units, residual, np.array([0.0, 2.0, 5.0]) / units**2)
    np.testing.assert_allclose(after, before * units, rtol=1e-9)
