"""Changes by coordinate, from what was simulated around a place."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from bench.diagnosis.expected.parameters import Free, time_offset
from bench.diagnosis.expected.problem import Slot
from bench.diagnosis.fitting import slopes as slopes_module
from bench.diagnosis.fitting.slopes import Around, Sample, slopes
from bench.diagnosis.fitting.steps import inside
from sim_backend.pixel import PixelModel

#: What can be measured changes evenly with both, but for a bend with the first.
_SLOPE = np.array([[3.0, -1.0], [2.0, 5.0], [0.0, 4.0]])
_BEND = np.array([200.0, -50.0, 80.0])
_SLOTS = (
    Slot(Free("noise_floor", "rms", "noise_rms", "ln", "linear", -1.0, 1.0, 0.1, 1.0, effect=False)),
    Slot(Free("reset_noise", "rms", "rms", "ln", "linear", 0.0, 1.0, 0.02)),
)


class Here:
    """What is expected at a place, if anything is."""

    def __init__(self, value: np.ndarray, *, said: bool = True) -> None:
        self.value, self.said = value, said

    def value_or(self, otherwise: float) -> np.ndarray:
        return self.value if self.said else np.full_like(self.value, otherwise)


def _expected(at: np.ndarray) -> np.ndarray:
    return np.asarray(_SLOPE @ at + _BEND * at[0] ** 2)


@pytest.mark.parametrize("second", [0.5, 0.001, 0.0])
def test_how_a_line_bends_is_no_slope_of_what_is_at_its_bound(second: float) -> None:
    at = np.array([0.0, second])
    directions = np.array([[0.1, 0.1], [0.02, -0.02]])
    places = [(inside(_SLOTS, at + sign * way), i) for i, way in enumerate(directions.T) for sign in (1.0, -1.0)]
    samples = [Sample(x, np.tile(_expected(x), (2, 1)), 100.0, pair) for x, pair in places]
    samples.append(Sample(at, np.tile(_expected(at), (2, 1)), 300.0))
    here = cast("Any", Here(_expected(at)))
    problem = cast("Any", SimpleNamespace(measured=SimpleNamespace(labels=())))
    found = slopes(problem, _SLOTS, at, here, samples, directions)
    np.testing.assert_allclose(found, np.tile(_SLOPE, (2, 1, 1)), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("unit", [1e-6, 1e-12])
def test_what_is_counted_in_another_unit_changes_as_much(unit: float) -> None:
    """One over a rate is known to 1e-9 s, the logarithm of a threshold to 1e-3."""
    at = np.array([0.1, 0.5 * unit])
    directions = np.array([[0.1, 0.1], [0.02 * unit, -0.02 * unit]])
    there = np.diag([1.0, 1.0 / unit])
    places = [(at + sign * way, i) for i, way in enumerate(directions.T) for sign in (1.0, -1.0)]
    samples = [Sample(x, np.tile(_SLOPE @ there @ x, (2, 1)), 100.0, pair) for x, pair in places]
    here = cast("Any", Here(_SLOPE @ there @ at))
    problem = cast("Any", SimpleNamespace(measured=SimpleNamespace(labels=())))
    found = slopes(problem, _SLOTS, at, here, samples, directions)
    np.testing.assert_allclose(found, np.tile(_SLOPE @ there, (2, 1, 1)), rtol=1e-6, atol=1e-6)


def test_a_sample_without_events_says_that_nothing_changes() -> None:
    """Of two statistics a side says nothing: the other side tells half of how they change, and no more is made up."""
    at = np.array([0.1, 0.5])
    directions = np.diag([0.02, 0.02])
    samples = []
    for i, way in enumerate(directions.T):
        for sign in (1.0, -1.0):
            halves = np.tile(_SLOPE @ (at + sign * way), (2, 1))
            if sign > 0.0:
                halves[:, 1:] = np.nan
            samples.append(Sample(at + sign * way, halves, 100.0, i))
    here = cast("Any", Here(_SLOPE @ at))
    problem = cast("Any", SimpleNamespace(measured=SimpleNamespace(labels=())))
    found = slopes(problem, _SLOTS, at, here, samples, directions)
    shares = np.array([1.0, 0.5, 0.5])[:, None]
    np.testing.assert_allclose(found, np.tile(shares * _SLOPE, (2, 1, 1)), rtol=1e-9, atol=1e-9)


def test_where_nothing_is_said_here_a_silent_side_is_as_the_others() -> None:
    """One side says -5; zero for the other would be a slope of -25."""
    at = np.array([0.1, 0.5])
    directions = np.diag([0.02, 0.02])
    samples = [
        Sample(at + sign * way, np.full((2, 3), -5.0 if sign < 0.0 else np.nan), 100.0, i)
        for i, way in enumerate(directions.T) for sign in (1.0, -1.0)
    ]  # fmt: skip
    here = cast("Any", Here(np.zeros(3), said=False))
    problem = cast("Any", SimpleNamespace(measured=SimpleNamespace(labels=())))
    found = slopes(problem, _SLOTS, at, here, samples, directions)
    np.testing.assert_allclose(found, np.zeros((2, 3, 2)), atol=1e-9)


def test_a_delay_does_to_latencies_what_the_clock_does_and_nothing_else() -> None:
    """What samples show of it besides is chance: it would tell a delay from the clock."""
    delay = Slot(Free("comparator_delay", "delay_s", "delay_s", "s", "linear", 0.0, 0.05, 2e-4))
    labels = [SimpleNamespace(view=view, group=0) for view in ("response", "latency", "background")]
    here = cast("Any", Here(np.array([0.5, np.log(1e-3), 2.0])))
    here.ratio = here.value
    slots, at = (delay, Slot(time_offset(1e-5))), np.array([8e-5, 0.0])
    directions = np.array([[5e-5], [0.0]])
    rng = np.random.default_rng(1)
    places = [at + sign * directions[:, 0] for sign in (1.0, -1.0)]
    samples = [Sample(x, here.value + 0.1 * rng.standard_normal((2, 3)), 100.0, 0) for x in places]
    problem = cast("Any", SimpleNamespace(measured=SimpleNamespace(labels=labels)))
    found = slopes(problem, slots, at, here, samples, directions)
    np.testing.assert_allclose(found, np.tile(np.array([[0.0, 0.0], [1e3, 1e3], [0.0, 0.0]]), (2, 1, 1)), rtol=1e-9)


def test_how_far_a_place_is_counts_by_how_far_was_looked() -> None:
    problem = cast("Any", None)
    around = Around(problem, _SLOTS, [], np.array([[2.0, 0.0], [0.0, -0.5]]), np.array([1.0, 1.0]))
    assert around.distance(np.array([1.0 + 0.3 * 2.0, 1.0 + 0.4 * 0.5])) == pytest.approx(0.5)
    assert around.distance(around.centre) == 0.0


def test_farther_along_one_direction_is_looked_at_to_both_sides(monkeypatch: pytest.MonkeyPatch) -> None:
    """What was looked at before counts on, as a pair of its own."""
    asked: list[Any] = []

    def around(*given: Any) -> list[Sample]:
        asked.append(given)
        return [Sample(np.full(2, end), np.zeros((2, 3)), 40.0, 0) for end in (7.0, 8.0)]

    monkeypatch.setattr(slopes_module, "samples_around", around)
    problem, before = cast("Any", None), [Sample(np.zeros(2), np.zeros((2, 3)), 10.0, pair) for pair in (0, 0, 1, 1)]
    first = Around(problem, _SLOTS, before, np.array([[2.0, 0.0], [0.0, 0.5]]), np.ones(2))
    found = first.farther(PixelModel(), 1, 3.0, 5, 4.0)
    assert [s.pair for s in found.samples] == [0, 0, 1, 1, 2, 2]
    np.testing.assert_array_equal(found.directions, [[2.0, 0.0], [0.0, 1.5]])
    np.testing.assert_array_equal(asked[0][5], [[0.0], [1.5]])
    assert (asked[0][4], asked[0][6]) == (5, 4.0)
    assert len(first.samples) == 4
