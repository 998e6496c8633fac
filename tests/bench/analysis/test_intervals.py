"""Intervals: exact where a closed form exists, and honest coverage where pixels differ."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from bench.analysis.intervals import poisson_interval, rate_interval, share_interval

_TRIALS = 2000
#: Four standard errors of a coverage of 0.9 from so many trials.
_SLACK = 4.0 * np.sqrt(0.9 * 0.1 / _TRIALS)


def test_poisson_interval_is_the_exact_one() -> None:
    for n in (1, 3, 17):
        low, high = poisson_interval(n)
        assert stats.poisson.sf(n - 1, low) == pytest.approx(0.05)
        assert stats.poisson.cdf(n, high) == pytest.approx(0.05)
    assert poisson_interval(0)[0] == 0.0
    assert poisson_interval(0)[1] == pytest.approx(-np.log(0.05))


def test_no_events_give_an_upper_limit() -> None:
    rate, low, high = rate_interval(np.zeros(256, np.int64), 20.0)
    assert (rate, low) == (0.0, 0.0)
    assert high == pytest.approx(-np.log(0.05) / (256 * 20.0))


def test_few_single_events_give_the_exact_poisson_interval() -> None:
    events = np.zeros(1000, np.int64)
    events[[3, 77, 500]] = 1
    rate, low, high = rate_interval(events, 10.0)
    # The variance between pixels of single events is that of Poisson counts, to one part in the number of pixels.
    exact = np.array([3, *poisson_interval(3)]) / 1e4
    assert [rate, low, high] == pytest.approx(exact, rel=5e-3)


def test_rate_interval_covers_poisson_pixels_and_hot_pixels() -> None:
    rng = np.random.default_rng(1)
    plain, naive_hot, hot = 0, 0, 0
    for _ in range(_TRIALS):
        _, low, high = rate_interval(rng.poisson(0.05, 256), 1.0)
        plain += low <= 0.05 <= high
        # A twentieth of the pixels is hot: twenty events instead of 0.05.
        events = rng.poisson(np.where(rng.random(256) < 0.05, 20.0, 0.05))
        mean = 0.05 * 20.0 + 0.95 * 0.05
        _, low, high = rate_interval(events, 1.0)
        hot += low <= mean <= high
        low, high = (bound / 256.0 for bound in poisson_interval(int(events.sum())))
        naive_hot += low <= mean <= high
    assert plain / _TRIALS > 0.9 - _SLACK, "the exact interval covers at least 90 %"
    assert 0.83 < hot / _TRIALS < 0.96
    assert naive_hot / _TRIALS < 0.5, "counting events as independent is far too narrow"


def test_share_interval_covers_pixels_with_frozen_thresholds_and_a_binomial_one_does_not() -> None:
    rng = np.random.default_rng(2)
    pixels, pulses = 100, 50
    frozen, binomial = 0, 0
    for _ in range(_TRIALS):
        own = stats.norm.cdf(rng.normal(0.0, 1.0, pixels))  # uniform: the mean is one half
        answers = rng.binomial(pulses, own)
        _, low, high = share_interval(answers, np.full(pixels, pulses))
        frozen += low <= 0.5 <= high
        share, error = answers.mean() / pulses, 1.645 * np.sqrt(0.25 / (pixels * pulses))
        binomial += abs(share - 0.5) <= error
    assert abs(frozen / _TRIALS - 0.9) < _SLACK + 0.005
    assert binomial / _TRIALS < 0.5


def test_where_none_answered_each_pixel_is_one_trial() -> None:
    trials = np.full(40, 100)
    share, low, high = share_interval(np.zeros(40, np.int64), trials)
    assert (share, low) == (0.0, 0.0)
    assert 0.02 < high < 0.1
    share, low, high = share_interval(trials, trials)
    assert (share, high) == (1.0, 1.0)
    assert 0.9 < low < 0.98


@pytest.mark.parametrize("pixels", [0, 1])
def test_one_pixel_tells_nothing_of_the_others(pixels: int) -> None:
    share, low, high = share_interval(np.full(pixels, 5), np.full(pixels, 10))
    assert (low, high) == (0.0, 1.0)
    assert share == 0.5 if pixels else np.isnan(share)
