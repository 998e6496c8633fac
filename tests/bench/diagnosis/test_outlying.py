"""Pixels that fire on their own, in events that were written down by hand."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from scipy.optimize import brentq

from bench.diagnosis.recorded.outlying import outlying_in, outlying_pixels

if TYPE_CHECKING:
    from collections.abc import Callable

SECONDS = 5.0


def events(rng: np.random.Generator, hot: dict[int, int]) -> list[tuple[int, int, int, int]]:
    """Return one ON event of each pixel, and so many more of some; times are random."""
    pixels = [*range(64), *(pixel for pixel, more in hot.items() for _ in range(more))]
    times = np.sort(rng.integers(0, int(SECONDS * 1e6), len(pixels)))
    return [(int(t), pixel % 8, pixel // 8, 1) for t, pixel in zip(times, rng.permutation(pixels), strict=True)]


def test_pixels_that_fire_on_their_own_tell_their_rate(
    point: Callable[..., Any], recorded: Callable[..., Any]
) -> None:
    """Two recordings of 5 s; pixels 3 and 40 send 22 and 28 events more in each, that is 5 a second on average."""
    rng = np.random.default_rng(1)
    taken = [recorded(point(i, 0.0), events(rng, {3: 22, 40: 28})) for i in range(2)]
    found = outlying_pixels(taken)
    assert found is not None
    assert found.rate_hz == pytest.approx(5.0, rel=0.01)
    assert found.fraction == pytest.approx(2 / 64, rel=0.01)  # there is no doubt of either
    assert found.fraction_sd == pytest.approx(0.25 / 64, rel=0.01)
    assert found.log_rate_sd == pytest.approx(1.0 / np.sqrt(100.0), rel=0.1)  # as many events


def test_pixels_that_fire_too_seldom_to_be_told_one_by_one_tell_their_rate_together(
    point: Callable[..., Any], recorded: Callable[..., Any]
) -> None:
    """Six pixels with two or three events each, 15 in all, and no others: hot ones that sent nothing are not seen.

    The mean m of a Poisson number that is 2.5 where it is not zero: m / (1 - exp(-m)) = 2.5.
    """
    times = [(1000 * (10 * pixel + n), pixel, 1, 1) for pixel in range(6) for n in range(2 + pixel % 2)]
    found = outlying_pixels([recorded(point(0, 0.0), sorted(times))])
    assert found is not None
    mean = brentq(lambda m: m / (1.0 - np.exp(-m)) - 2.5, 0.1, 10.0)
    assert found.rate_hz == pytest.approx(mean / SECONDS, rel=0.01)
    assert found.fraction == pytest.approx(2.5 / mean * 6 / 64, rel=0.01)


def test_what_is_counted_is_known_as_well_as_it_says() -> None:
    """Of 200 sensors of 256 pixels: their own share, and the rate, within 1.645 standard errors in nine of ten."""
    rng = np.random.default_rng(3)
    within = []
    for _ in range(200):
        share, rate_hz = rng.uniform(0.01, 0.05), rng.uniform(0.1, 1.2)
        usual, spread = rng.choice([0.05, 0.5, 2.0, 6.0]), rng.choice([0.0, 0.3])
        hot = rng.random(256) < share
        each = rng.poisson(usual * np.exp(spread * rng.standard_normal(256)))
        counts = (each + rng.poisson(24.0 * rate_hz * hot)).astype(np.float64)
        found = outlying_in(counts, 24.0)
        if found is not None and np.isfinite(found.fraction_sd):
            of_share = (found.fraction - hot.mean()) / found.fraction_sd
            of_rate = np.log(found.rate_hz / rate_hz) / found.log_rate_sd
            within.append(np.abs([of_share, of_rate]) < 1.645)
    n = len(within)
    assert n > 120  # the others cannot be told from fellows that differ
    lowest = 0.9 - 3.0 * np.sqrt(0.9 * 0.1 / n)
    assert np.all(np.mean(within, axis=0) > lowest)


def test_fellows_that_differ_much_are_no_other_kind() -> None:
    """Rates that are log-normal with a spread of 0.6: some are far out, and nothing is known of a second kind."""
    rng = np.random.default_rng(5)
    for _ in range(20):
        found = outlying_in(rng.poisson(3.0 * np.exp(0.6 * rng.standard_normal(256))).astype(np.float64), 24.0)
        assert found is None or not np.isfinite(found.fraction_sd)


def test_alike_pixels_tell_nothing(point: Callable[..., Any], recorded: Callable[..., Any]) -> None:
    rng = np.random.default_rng(2)
    taken = recorded(point(0, 0.0), events(rng, {3: 2}))
    assert outlying_pixels([taken]) is None
    assert outlying_pixels([point(0, 0.4)]) is None


def test_other_windows_are_not_mixed(point: Callable[..., Any], recorded: Callable[..., Any]) -> None:
    rng = np.random.default_rng(3)
    taken = [recorded(point(i, 0.0), events(rng, {3: 30})) for i in range(2)]
    one_off = replace(taken[1], masked=np.array([[0, 0]], np.uint16))
    assert outlying_pixels([taken[0], replace(one_off, masked=np.array([[40, 30]], np.uint16))]) is None
