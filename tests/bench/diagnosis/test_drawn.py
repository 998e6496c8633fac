"""How much sensors of one kind differ is known from the number of their pixels."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
import pytest

from bench.diagnosis.expected.catalogue import details_of, free_of
from bench.diagnosis.expected.parameters import base_parameters
from bench.diagnosis.expected.problem import Slot
from bench.diagnosis.fitting.drawn import drawn_variance, is_share, share_interval
from sim_backend.pixel.effects.registry import effects

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]

PIXELS, SENSORS = 256, 4000
#: A sample variance of so many sensors is known to 2.2 %, of nearly normal numbers.
REL: Final = 4.0 * np.sqrt(2.0 / SENSORS)

KNOWN = {
    "hot_pixels.fraction": 0.04,
    "hot_pixels.rate_hz": 3.0,
    "threshold_mismatch.sigma_on": 0.03,
    "threshold_mismatch.sigma_off": 0.05,
    "refractory_mismatch.spread": 0.3,
    "dark_current.mean_fa": 5.0,
    "dark_current.spread": 0.2,
    "leak.rate_per_s": 0.1,
    "leak.spread": 0.4,
    "thresholds.on": 0.25,
    "thresholds.off": 0.3,
    "noise_floor.rms": 0.03,
    "source_follower_bandwidth.corner_hz": 100.0,
    "refractory_period.period_s": 2e-3,
}


def numbers(*ids: str) -> tuple[list[Slot], Floats]:
    free = [*base_parameters(refractory_known=True), *(f for i in ids for f in free_of(effects()[i]))]
    free += [f for i in ids for f, _ in details_of(effects()[i])]
    return [Slot(f) for f in free], np.array([f.coordinate(KNOWN[f.key]) for f in free])


def spread_on(rng: np.random.Generator) -> Floats:
    return np.asarray(np.std(0.03 * rng.standard_normal((SENSORS, PIXELS)), axis=1, ddof=1))


def mean_off(rng: np.random.Generator) -> Floats:
    return np.asarray(np.mean(0.3 + 0.05 * rng.standard_normal((SENSORS, PIXELS)), axis=1))


def dead_time_s(rng: np.random.Generator) -> Floats:
    return np.asarray(2e-3 * np.exp(np.mean(0.3 * rng.standard_normal((SENSORS, PIXELS)), axis=1)))


def dark_current_fa(rng: np.random.Generator) -> Floats:
    return np.asarray(np.mean(5.0 * np.exp(0.2 * rng.standard_normal((SENSORS, PIXELS)) - 0.02), axis=1))


def median_leak(rng: np.random.Generator) -> Floats:
    return np.asarray(0.1 * np.exp(np.mean(0.4 * rng.standard_normal((SENSORS, PIXELS)), axis=1)))


def spread_of_leak(rng: np.random.Generator) -> Floats:
    return np.asarray(np.std(0.4 * rng.standard_normal((SENSORS, PIXELS)), axis=1, ddof=1))


@pytest.mark.parametrize(
    ("key", "drawn"),
    [
        ("threshold_mismatch.sigma_on", spread_on),
        ("thresholds.off", mean_off),
        ("refractory_period.period_s", dead_time_s),
        ("dark_current.mean_fa", dark_current_fa),
        ("leak.rate_per_s", median_leak),
        ("leak.spread", spread_of_leak),
    ],
)
def test_it_is_what_drawn_sensors_show(key: str, drawn: Callable[[np.random.Generator], Floats]) -> None:
    slots, x = numbers("hot_pixels", "threshold_mismatch", "refractory_mismatch", "dark_current", "leak")
    free = next(s.free for s in slots if s.free.key == key)
    shown = [free.coordinate(float(v)) for v in drawn(np.random.default_rng(1))]
    found = dict(zip((s.free.key for s in slots), drawn_variance(slots, x, PIXELS), strict=True))
    assert found[key] == pytest.approx(np.var(shown), rel=REL)


def test_what_is_the_same_in_all_pixels_is_the_same_in_all_sensors() -> None:
    slots, x = numbers()
    assert not drawn_variance(slots, x, PIXELS).any()
    slots, x = numbers("hot_pixels")
    found = dict(zip((s.free.key for s in slots), drawn_variance(slots, x, PIXELS), strict=True))
    assert not any(found.values())  # a share is no normal number: see below


def test_a_share_lies_within_its_interval_as_often_as_it_says() -> None:
    """Nine of ten sensors, of whatever share: the law of Wilson's intervals, which is discrete."""
    rng = np.random.default_rng(4)
    for law, sd in ((0.01, 0.0), (0.04, 0.0), (0.04, 0.01)):
        own = np.mean(rng.random((SENSORS, PIXELS)) < law, axis=1) + sd * rng.standard_normal(SENSORS)
        ends = [share_interval(max(float(one), 0.0), sd, PIXELS, 1.6449) for one in own]
        inside = np.mean([low <= law <= high for low, high in ends])
        assert 0.87 < inside < 0.96


def test_one_hot_pixel_may_stand_for_five() -> None:
    """Of 256 pixels one is hot: Wilson's 90 % interval, by hand."""
    low, high = share_interval(1 / 256, 0.0, 256, 1.6449)
    z2 = 1.6449**2 / 256
    middle, half = (1 / 256 + z2 / 2) / (1 + z2), np.sqrt(z2 * (1 / 256 * 255 / 256 + z2 / 4)) / (1 + z2)
    assert (low, high) == pytest.approx((middle - half, middle + half))
    assert 4.0 < 256 * high < 5.0
    slots, _ = numbers("hot_pixels")
    assert [s.free.key for s in slots if is_share(s.free)] == ["hot_pixels.fraction"]
