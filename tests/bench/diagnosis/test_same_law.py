"""Points that differ by a factor of the light are simulated once, where the pixel does not know the difference."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bench.diagnosis.expected.forward import Task, sensors_of
from bench.diagnosis.expected.same_law import representatives
from sim_backend.pixel import PixelModel
from sim_backend.pixel.effects.dark_current import DarkCurrent
from sim_backend.pixel.effects.leak import Leak
from sim_backend.pixel.effects.registry import effects

if TYPE_CHECKING:
    from collections.abc import Callable

PIXEL = PixelModel(noise_rms=0.045, corner_hz=150.0, theta_on=0.3, theta_off=0.25, refractory_s=8e-3)


def test_a_pixel_without_dark_current_does_not_know_how_much_light_there_is(point: Callable[..., Any]) -> None:
    points = [point(0, 0.3, lux=1.0), point(1, 0.3, lux=10.0), point(2, 0.4, lux=10.0), point(3, 0.0, lux=0.1)]
    assert representatives(points, [PIXEL + Leak(0.1)] * 4) == [0, 0, 2, 3]
    assert representatives(points, [PIXEL + DarkCurrent(3.0)] * 4) == [0, 1, 2, 3]
    other = replace(PIXEL, theta_on=0.31)
    assert representatives(points, [PIXEL, other, PIXEL, PIXEL]) == [0, 1, 2, 3]


def test_a_different_recording_is_not_the_same(point: Callable[..., Any]) -> None:
    one = point(0, 0.3)
    for changes in (
        {"duration_s": 2.0},
        {"pulse_valid": np.zeros(20, np.bool_)},
        {"gaps_s": np.array([[0.1, 0.2]])},
        {"masked": np.array([[40, 30]], np.uint16)},
        {"stimulus_lux": one.stimulus_lux * np.linspace(1.0, 1.1, one.stimulus_lux.size)},
    ):
        assert representatives([one, replace(one, index=1, **changes)], [PIXEL, PIXEL]) == [0, 1], changes


def test_what_is_simulated_once_stands_for_all(point: Callable[..., Any]) -> None:
    points = (point(0, 0.3, lux=1.0), point(1, 0.3, lux=10.0))
    seen = sensors_of(Task(points, ((PIXEL, PIXEL),), (0,), 2e-5, seed=1))[0]
    first, second = seen.summaries
    assert np.array_equal(first.top, second.top)
    assert np.array_equal(first.products, second.products)


@pytest.mark.parametrize("effect_id", sorted(i for i, e in effects().items() if not e.knows_light))
def test_effects_that_do_not_know_the_light_give_the_same_events_in_ten_times_as_much(
    effect_id: str, point: Callable[..., Any]
) -> None:
    """The same random numbers: an effect that knew the light would show in the very events."""
    model = PIXEL + effects()[effect_id]()
    seen = [
        sensors_of(Task((point(0, 0.35, lux=lux, periods=4),), ((model,),), (0,), 2e-5, seed=1))[0].summaries[0]
        for lux in (1.0, 10.0)
    ]
    assert seen[0].top[0] > 0.0
    # A logarithm of another number is rounded differently: an event may move by a sample.
    assert np.allclose(seen[0].top, seen[1].top, rtol=0.02, atol=1.5)
