"""Pixels that fire on their own, in events that were written down by hand."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bench.diagnosis.recorded.outlying import outlying_rate_hz

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
    """Two recordings of 5 s; pixels 3 and 40 send 20 and 30 events more in each, that is 5 a second on average."""
    rng = np.random.default_rng(1)
    taken = [recorded(point(i, 0.0), events(rng, {3: 20, 40: 30})) for i in range(2)]
    assert outlying_rate_hz(taken) == pytest.approx(5.0)


def test_pixels_that_fire_too_seldom_to_be_told_one_by_one_tell_their_rate_together(
    point: Callable[..., Any], recorded: Callable[..., Any]
) -> None:
    """Six pixels with two or three events each, 15 in all, and no others: 12 pairs, where chance has 1.8."""
    times = [(1000 * (10 * pixel + n), pixel, 1, 1) for pixel in range(6) for n in range(2 + pixel % 2)]
    found = outlying_rate_hz([recorded(point(0, 0.0), sorted(times))])
    pairs, events = 3 * 1 + 3 * 3, 15
    assert found == pytest.approx(2.0 * (pairs - 0.5 * events**2 / 64) / events / SECONDS)


def test_alike_pixels_tell_nothing(point: Callable[..., Any], recorded: Callable[..., Any]) -> None:
    rng = np.random.default_rng(2)
    taken = recorded(point(0, 0.0), events(rng, {3: 2}))
    assert outlying_rate_hz([taken]) is None
    assert outlying_rate_hz([point(0, 0.4)]) is None


def test_other_windows_are_not_mixed(point: Callable[..., Any], recorded: Callable[..., Any]) -> None:
    rng = np.random.default_rng(3)
    taken = [recorded(point(i, 0.0), events(rng, {3: 30})) for i in range(2)]
    one_off = replace(taken[1], masked=np.array([[0, 0]], np.uint16))
    assert outlying_rate_hz([taken[0], replace(one_off, masked=np.array([[40, 30]], np.uint16))]) is None
