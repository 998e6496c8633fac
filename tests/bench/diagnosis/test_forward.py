"""Sensors that are simulated side by side show what each shows by itself, down to the last bit."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bench.diagnosis.expected import remembered
from bench.diagnosis.expected.forward import Forward, Task, _Pixels, _Taken, sensors_of
from bench.diagnosis.expected.remembered import Remembered
from bench.diagnosis.recorded.recording import Frame
from bench.diagnosis.views.registry import VIEWS
from sim_backend.pixel import PixelModel
from sim_backend.pixel.effects import Crosstalk, DarkCurrent, HotPixels, Leak, LightFlicker, ThresholdMismatch

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

PIXEL = PixelModel(noise_rms=0.045, corner_hz=150.0, theta_on=0.3, theta_off=0.25, refractory_s=8e-3)
MODELS = (
    PIXEL,
    PIXEL + DarkCurrent(3.0),
    PIXEL + Leak(0.3) + ThresholdMismatch(0.03, 0.03),
    PIXEL + HotPixels(fraction=0.2, rate_hz=30.0),
    PIXEL + Crosstalk(0.2),
)


@pytest.mark.parametrize("share", [0.25, 1.0])
def test_side_by_side_or_each_by_itself(point: Callable[..., Any], share: float) -> None:
    """Every view, of part of the pixels and of points of which some have the same law under some of the models."""
    points = (point(0, 0.3, lux=1.0), point(1, 0.3, lux=10.0), point(2, 0.0, lux=1.0), point(3, 0.0, lux=10.0))
    models = tuple((model,) * len(points) for model in MODELS)
    numbers = (0, 1, 0, 3, 0)  # the first and the last have the same pixels
    together = sensors_of(Task(points, models, numbers, 2e-5, seed=1, share=share))
    for model, number, beside in zip(models, numbers, together, strict=True):
        alone = sensors_of(Task(points, (model,), (number,), 2e-5, seed=1, share=share))[0]
        assert beside.share == alone.share == share
        for one, other in zip(alone.summaries, beside.summaries, strict=True):
            assert np.array_equal(one.top, other.top)
            assert np.array_equal(one.bottom, other.bottom)
            assert np.array_equal(one.products, other.products)


class Here:
    """Does tasks at once, and knows the sensors of each."""

    def __init__(self) -> None:
        self.taken: list[tuple[int, ...]] = []

    def map(self, function: Callable[[Task], Any], tasks: Sequence[Task], **_: Any) -> Iterator[tuple[int, Any]]:
        for number, task in enumerate(tasks):
            self.taken.append(task.sensors)
            yield number, function(task)


def test_what_was_simulated_is_not_simulated_again(point: Callable[..., Any]) -> None:
    """Other seeds, sensors, shares of the pixels, clocks and numbers of a model are others."""
    here: Any = Here()
    bench = Forward([point(0, 0.3), point(1, 0.0)], here, 2e-5)
    base, leaky = ((model,) * 2 for model in (PIXEL, PIXEL + Leak(0.3)))
    first, second = bench.run([base, leaky], 1, 2, 0.25)
    assert here.taken == [(0, 1, 0, 1)]
    again = bench.run([(replace(PIXEL),) * 2, leaky], 1, 3, 0.25)
    assert here.taken[1:] == [(2, 2)]
    assert [sensors[:2] for sensors in again] == [first, second]
    assert all(a is b for a, b in zip(again[0], first, strict=False))
    bench.later(19).run([base], 1, 1, 0.25)
    bench.with_shown().run([base], 1, 1, 0.25)
    bench.run([base], 2, 1, 0.25)
    bench.run([base], 1, 1, 0.5)
    bench.run([(PIXEL + Leak(0.3000000001),) * 2], 1, 1, 0.25)
    bench.run([(PIXEL, PIXEL + Leak(0.3))], 1, 1, 0.25)
    assert here.taken[2:] == [(0,)] * 6
    bench.run([base, leaky], 1, 3, 0.25)
    assert len(here.taken) == 8


def test_what_nobody_asked_for_the_longest_is_forgotten() -> None:
    last: Remembered[int] = Remembered(remembered._MOST // 2)
    for number in range(2):
        last.put(number, number)
    assert last.get(0) == 0
    last.put(2, 2)
    assert [last.get(number) for number in range(3)] == [0, None, 2]
    large: Remembered[int] = Remembered(remembered._MOST + 1)
    large.put(0, 0)
    assert large.get(0) is None


def test_part_of_the_pixels_says_nothing_about_the_array(point: Callable[..., Any]) -> None:
    asked = (point(0, 0.5),)
    part, whole = (sensors_of(Task(asked, ((PIXEL,),), (0,), 2e-5, seed=1, share=s))[0] for s in (0.25, 1.0))
    said = whole.summaries[0].bottom > 0.0
    missing = said & (part.summaries[0].bottom == 0.0)
    # Neighbours and bursts come last under pulses.
    assert [view.id for view in VIEWS if view.of_array] == ["neighbours", "burst"]
    assert missing[-2:].all()


def test_points_of_one_law_share_a_ripple_and_are_each_looked_at_beside_their_own(point: Callable[..., Any]) -> None:
    """At one phase of the ripple they send the same events; the phase that is seen in each run's point is its own."""
    model = PIXEL + LightFlicker(depth=0.1, frequency_hz=97.0, phase=1.0)
    asked = [point(i, 0.0, lux=lux) for i, lux in enumerate((1.0, 10.0))]
    seen = {"ripple_hz": 97.0, "ripple_off_rad": 0.0}
    points = tuple(
        replace(one, attributes={**one.attributes, **seen, "ripple_on_rad": turn})
        for one, turn in zip(asked, (0.0, 0.5 * math.pi), strict=True)
    )
    of_both = sensors_of(Task(points, ((model,) * 2,), (0,), 2e-5, seed=1))[0].summaries
    of_second = sensors_of(Task((points[0], points[0]), ((model,) * 2,), (0,), 2e-5, seed=1))[0].summaries
    assert np.array_equal(of_second[0].top, of_second[1].top)
    # A quarter of a turn: what goes across the one goes along with the other. ON is the last but for the quarter.
    different = np.flatnonzero(of_both[0].top != of_both[1].top)
    assert len(different) == 2
    along, across = different
    assert of_both[1].top[along] == pytest.approx(of_both[0].top[across])
    assert of_both[1].top[across] == pytest.approx(-of_both[0].top[along])


def test_events_come_late_as_a_whole(point: Callable[..., Any]) -> None:
    """All but what falls out of the recording is there, so much later; so it is with what comes early."""
    asked, model = point(0, 1.0), PIXEL + Leak(0.3)
    task = Task((asked,), ((model,),), (0,), 2e-5, seed=1)
    known = np.concatenate(list(_events(task)))
    for late_us in (19, -19):
        moved = np.concatenate(list(_events(replace(task, late_us=late_us))))
        expected = known[(known["t"] + late_us >= 0) & (known["t"] + late_us < round(1e6 * asked.duration_s))]
        assert np.array_equal(moved["t"], expected["t"] + late_us)
        assert np.array_equal(moved["p"], expected["p"])
    gone = round(1e6 * asked.duration_s)
    assert not list(_events(replace(task, late_us=gone)))


def _events(task: Task) -> list[Any]:
    return list(_Taken(task, task.models[0], 0).events(Frame(task.points[0]), 0, _Pixels([None])))
