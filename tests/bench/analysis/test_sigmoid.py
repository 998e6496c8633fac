"""Curves and their fit."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from bench.analysis.sigmoid import NORMAL, SINH_ARCSINH, Family, fit_counts, floor_and_plateau

X = np.linspace(0.1, 0.6, 25)
PARAMETERS = {
    "normal": np.array([[0.3, np.log(0.05), 0.1, 1.45]]),
    "sinh-arcsinh": np.array([[0.3, np.log(0.05), 0.3, -0.2, 0.1, 1.45]]),
}


@pytest.mark.parametrize("family", [NORMAL, SINH_ARCSINH], ids=lambda f: f.name)
def test_slopes_are_the_derivatives(family: Family) -> None:
    q = PARAMETERS[family.name]
    _, slopes = family.shape(q, X)
    for i in range(slopes.shape[2]):
        step = np.zeros_like(q)
        step[0, i] = 1e-6
        numeric = (family.shape(q + step, X)[0] - family.shape(q - step, X)[0]) / 2e-6
        assert slopes[0, :, i] == pytest.approx(numeric[0], abs=1e-6)


@pytest.mark.parametrize("family", [NORMAL, SINH_ARCSINH], ids=lambda f: f.name)
@pytest.mark.parametrize("level", [0.01, 0.5, 0.99])
def test_the_quantile_is_the_inverse(family: Family, level: float) -> None:
    q = PARAMETERS[family.name]
    assert family.shape(q, family.quantile(q, level))[0][0, 0] == pytest.approx(level, abs=1e-12)


@pytest.mark.parametrize("family", [NORMAL, SINH_ARCSINH], ids=lambda f: f.name)
def test_a_fit_of_exact_shares_returns_the_curve(family: Family) -> None:
    truth = PARAMETERS[family.name]
    floor, plateau = floor_and_plateau(truth)
    shares = floor[:, None] + (plateau - floor)[:, None] * family.shape(truth, X)[0]
    start = np.array([[0.35, np.log(0.08), *[0.0] * family.extra, 0.05, 1.5]])
    fit = fit_counts(family, start, X, shares, np.full(shares.shape, 1e6), iterations=200)
    assert fit.quantile(0.99)[0] == pytest.approx(family.quantile(truth, 0.99)[0], abs=2e-4)
    assert fit.probability(X)[0] == pytest.approx(shares[0], abs=2e-4)
    assert floor_and_plateau(fit.parameters)[1][0] == pytest.approx(plateau[0], abs=2e-4)


def test_many_fits_at_once_are_the_same_as_one_by_one() -> None:
    rng = np.random.default_rng(4)
    shares = rng.binomial(200, 0.02 + 0.96 * norm.cdf((X - 0.3) / 0.05), size=(5, X.size)) / 200.0
    trials = np.full(shares.shape, 200.0)
    start = np.repeat([[0.33, np.log(0.07), 0.1, 1.4]], 5, axis=0)
    together = fit_counts(NORMAL, start, X, shares, trials).parameters
    for i in range(5):
        alone = fit_counts(NORMAL, start[i : i + 1], X, shares[i : i + 1], trials[i : i + 1]).parameters
        assert together[i] == pytest.approx(alone[0], abs=1e-9)
