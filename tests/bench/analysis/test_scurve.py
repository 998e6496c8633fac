"""S-curves: thresholds with honest intervals, steps, and curves from which nothing can be read."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom, norm

from bench.analysis.scurve import CurveCounts, CurveFit, fit_curve, rising_means


def _counts(x: np.ndarray, probability: np.ndarray, pixels: int, pulses: int, seed: int) -> CurveCounts:
    """Return binomial answers; `probability` is (n,) or (n, pixels)."""
    p = np.broadcast_to(probability if probability.ndim == 2 else probability[:, None], (x.size, pixels))
    answers = np.random.default_rng(seed).binomial(pulses, p)
    return CurveCounts(x, answers, np.full(answers.shape, pulses))


def _exact(x: list[float], share: list[float], pixels: int = 64, pulses: int = 100) -> CurveCounts:
    answers = np.round(np.array(share)[:, None] * pulses * np.ones(pixels)).astype(np.int64)
    return CurveCounts(np.array(x), answers, np.full(answers.shape, pulses))


@pytest.mark.slow
def test_intervals_cover_the_population_where_each_pixel_has_its_own_frozen_threshold() -> None:
    """The truth is that of all pixels there are; a binomial interval, that of these pulses, would be too narrow."""
    trials, pixels, pulses, mismatch, noise, floor, plateau = 300, 64, 40, 0.03, 0.03, 0.01, 0.99
    x = np.linspace(0.15, 0.45, 11)
    width = np.hypot(mismatch, noise)
    truth = {"half": 0.3, "intercept": 0.3 + width * norm.ppf(0.99), "floor": floor, "plateau": plateau}
    covered = dict.fromkeys(truth, 0)
    binomial = 0
    rng = np.random.default_rng(11)
    for trial in range(trials):
        own = 0.3 + mismatch * rng.standard_normal(pixels)
        p = floor + (plateau - floor) * norm.cdf((x[:, None] - own) / noise)
        fit = fit_curve(_counts(x, p, pixels, pulses, trial))
        for name, value in truth.items():
            estimate = getattr(fit, name)
            covered[name] += estimate.low <= value <= estimate.high
        # Error of the centre of a curve of known width from independent pulses: the inverse root of the information.
        mean = floor + (plateau - floor) * norm.cdf((x - 0.3) / width)
        slope = (plateau - floor) * norm.pdf((x - 0.3) / width) / width
        error = 1.0 / np.sqrt(np.sum(pixels * pulses * slope**2 / (mean * (1.0 - mean))))
        binomial += abs(fit.half.value - 0.3) <= 1.645 * error
    # The range 0.83 to 0.96 and what chance adds to it: four standard errors would be 0.07, so no more is given.
    assert {name: 0.83 <= n / trials <= 0.96 for name, n in covered.items()} == dict.fromkeys(truth, True), covered
    assert binomial / trials < 0.6


def test_a_noise_free_step_is_bracketed_and_never_has_a_fitted_width() -> None:
    x = 0.3 * (1.0 + 0.005 * np.arange(-3.5, 4.0))
    fit = fit_curve(_exact(list(x), [0.0] * 4 + [1.0] * 4))
    for estimate in (fit.half, fit.intercept):
        assert estimate.value == pytest.approx(0.3, abs=1e-12)
        assert (estimate.low, estimate.high) == (x[3], x[4])
    assert (fit.floor.value, fit.plateau.value) == (0.0, 1.0)
    assert fit.fit_probability.tolist() == [0.0, 0.0, 1.0, 1.0]
    assert np.all(np.diff(fit.fit_contrast) >= 0)


def test_a_step_with_a_floor_and_a_plateau_is_a_step_all_the_same() -> None:
    fit = fit_curve(_counts(np.linspace(0.1, 0.5, 9), np.array([0.02] * 4 + [0.97] * 5), 256, 50, 3))
    assert (fit.half.low, fit.half.high) == pytest.approx((0.25, 0.3))
    assert fit.floor.value == pytest.approx(0.02, abs=4 * np.sqrt(0.02 * 0.98 / (4 * 256 * 50)))
    assert fit.plateau.value == pytest.approx(0.97, abs=4 * np.sqrt(0.02 * 0.98 / (5 * 256 * 50)))


@pytest.mark.parametrize("share", [0.1, 0.4, 0.9])
def test_one_point_inside_leaves_open_what_the_contrasts_leave_open(share: float) -> None:
    fit = fit_curve(_exact([0.1, 0.2, 0.3, 0.4, 0.5], [0.0, 0.0, share, 1.0, 1.0]))
    half = (0.3, 0.4) if share < 0.5 else (0.2, 0.3)
    assert (fit.half.low, fit.half.high) == pytest.approx(half)
    assert (fit.intercept.low, fit.intercept.high) == pytest.approx((0.3, 0.4))
    assert fit.half.low <= fit.half.value <= fit.half.high
    assert fit.intercept.low <= fit.intercept.value <= fit.intercept.high
    assert "bracket" in fit.half.note


def test_two_points_inside_give_no_interval_narrower_than_their_distance() -> None:
    fit = fit_curve(_exact([0.1, 0.2, 0.25, 0.3, 0.4, 0.6], [0.01, 0.3, 0.9, 1.0, 1.0, 1.0]))
    assert (fit.half.low, fit.half.high) == pytest.approx((0.2, 0.25))
    assert fit.intercept.low <= 0.25
    assert fit.intercept.high >= 0.3


@pytest.mark.parametrize(
    ("x", "share", "why"),
    [
        ([0.1], [0.5], "1 contrasts"),
        ([0.1, 0.2, 0.3], [0.0, 0.5, 1.0], "3 contrasts"),
        ([], [], "0 contrasts"),
        ([0.1, 0.2, 0.3, 0.4, 0.5], [0.0] * 5, "flat"),
        ([0.1, 0.2, 0.3, 0.4, 0.5], [1.0] * 5, "flat"),
        ([0.1, 0.2, 0.3, 0.4, 0.5], [0.3] * 5, "flat"),
        ([0.1, 0.2, 0.3, 0.4, 0.5], [0.9, 0.7, 0.5, 0.3, 0.1], "flat"),
        ([0.1, 0.2, 0.3, 0.4, 0.5], [0.0, 0.0, 0.02, 0.1, 0.4], "plateau"),
        ([0.1, 0.2, 0.3, 0.4, 0.5], [0.0, 0.1, 0.3, 0.6, 0.9], "plateau"),
    ],
)
def test_what_cannot_be_read_is_nan_with_a_note(x: list[float], share: list[float], why: str) -> None:
    fit = fit_curve(_exact(x, share))
    for estimate in (fit.half, fit.intercept, fit.floor, fit.plateau):
        assert np.isnan([estimate.value, estimate.low, estimate.high]).all()
        assert why in estimate.note
    assert fit.warnings
    assert fit.probability.size == len(x)


def test_no_active_pixel_is_no_error() -> None:
    fit = fit_curve(CurveCounts(np.array([0.1, 0.2, 0.3, 0.4]), np.zeros((4, 9), int), np.zeros((4, 9), int)))
    assert np.isnan(fit.half.value)
    assert "no pixel" in fit.half.note


def test_a_curve_that_starts_inside_its_transition_keeps_its_upper_part() -> None:
    x = np.linspace(0.28, 0.6, 17)
    fit = fit_curve(_counts(x, norm.cdf((x - 0.3) / 0.05), 256, 50, 5))
    assert fit.half.low <= 0.3 <= fit.half.high
    assert fit.intercept.low <= 0.3 + 0.05 * norm.ppf(0.99) <= fit.intercept.high
    assert np.isnan(fit.floor.value)
    assert any("floor" in text for text in fit.warnings)


def _asymmetric(x: np.ndarray) -> np.ndarray:
    """At least one of ten independent levels is over the threshold: steep above, slow below."""
    return np.asarray(1.0 - binom.pmf(0, 10, norm.cdf((x - 0.35) / 0.06)))


def test_the_intercept_of_an_asymmetric_curve_is_not_biased() -> None:
    x = np.linspace(0.05, 0.6, 40)
    grid = np.linspace(0.05, 0.6, 100_001)
    truth = float(np.interp(0.99, _asymmetric(grid), grid))
    fits: list[CurveFit] = [fit_curve(_counts(x, 0.01 + 0.98 * _asymmetric(x), 256, 100, seed)) for seed in range(6)]
    values = np.array([fit.intercept.value for fit in fits])
    # A Gaussian puts it 2.6 % too high.
    assert values.mean() == pytest.approx(truth, rel=0.01)
    assert sum(fit.intercept.low <= truth <= fit.intercept.high for fit in fits) >= 3


def test_more_pixels_than_clusters_give_the_same_width() -> None:
    x = np.linspace(0.15, 0.45, 8)
    rng = np.random.default_rng(8)
    own = 0.3 + 0.03 * rng.standard_normal(6000)
    fit = fit_curve(_counts(x, norm.cdf((x[:, None] - own) / 0.03), 6000, 10, 1))
    error = np.hypot(0.03, 0.03 / np.sqrt(10)) / np.sqrt(
        6000
    )  # from the spread of thresholds and a lower bound of counting
    assert 0.9 * 3.29 * error < fit.half.high - fit.half.low < 2.0 * 3.29 * error


def test_the_same_data_give_the_same_intervals() -> None:
    x = np.linspace(0.15, 0.45, 9)
    counts = _counts(x, norm.cdf((x - 0.3) / 0.04), 64, 20, 2)
    assert fit_curve(counts).intercept == fit_curve(counts).intercept


def test_rising_means() -> None:
    found = rising_means(np.array([0.0, 0.2, 0.1, 0.5, 0.4, 0.3]), np.array([1.0, 1.0, 3.0, 1.0, 1.0, 2.0]))
    assert found == pytest.approx([0.0, 0.125, 0.125, 0.375, 0.375, 0.375])
