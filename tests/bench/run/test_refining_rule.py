"""Where the next contrast goes, and when a curve is known well enough."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.run.refining_rule import Known, Step, halved, standing_of, steps_of
from protocols.refine import Until

GAP = Until(gap=0.1)


def same(contrast: float) -> float:
    return contrast


def curve(contrast: list[float], probability: list[float], error: float = math.nan) -> Known:
    return Known(np.array(contrast), np.array(probability), error)


def test_the_widest_step_is_halved_first() -> None:
    steps = steps_of([0.1, 0.2, 0.4, 0.5], [curve([0.1, 0.2, 0.4, 0.5], [0.0, 0.1, 0.9, 1.0])], GAP)
    assert [step.rise for step in steps] == pytest.approx([0.1, 0.8, 0.1])
    assert [step.middle for step in halved(steps, 3, 0.0, same)] == pytest.approx([0.3, 0.25, 0.35])


def test_no_more_than_needed() -> None:
    steps = [Step(0.1, 0.2, 0.05), Step(0.2, 0.3, 0.12)]
    assert halved(steps, 3, 0.1, same) == [Step(0.2, 0.3, 0.12)]
    assert halved(steps, 3, 0.2, same) == []


def test_a_light_with_steps_is_asked_for_nothing_between_two_of_them() -> None:
    def by_hundredths(contrast: float) -> float:
        return round(contrast, 2)

    steps = [Step(0.10, 0.11, 0.9), Step(0.2, 0.24, 0.1)]
    assert [step.middle for step in halved(steps, 3, 0.0, by_hundredths)] == pytest.approx([0.22, 0.21, 0.23])
    assert halved(steps[:1], 3, 0.0, by_hundredths) == []
    assert halved(steps, 3, 0.0, lambda _: None) == []


def test_a_contrast_without_data_is_not_tried_again() -> None:
    known = curve([0.1, 0.3], [0.0, 1.0])
    steps = steps_of([0.1, 0.2, 0.3, math.inf], [known], GAP)
    assert [(step.low, step.high, step.rise) for step in steps] == [(0.1, 0.2, 0.5), (0.2, 0.3, 0.5)]


def test_a_flat_curve_has_no_steps() -> None:
    assert steps_of([0.1, 0.2, 0.3], [curve([0.1, 0.2, 0.3], [0.30, 0.31, 0.32])], GAP) == []
    assert steps_of([0.1, 0.2], [], GAP) == []
    assert steps_of([0.1], [curve([0.1], [0.5])], GAP) == []


def test_of_two_responses_the_steeper_one_counts_and_a_flat_one_does_not() -> None:
    x = [0.1, 0.2, 0.3]
    on, off, flat = curve(x, [0.0, 0.6, 0.7], 0.01), curve(x, [0.0, 0.1, 0.9], 0.03), curve(x, [0, 0.0, 0.01])
    steps = steps_of(x, [on, off, flat], GAP)
    assert [step.rise for step in steps] == pytest.approx([0.6, 0.8])
    assert not standing_of(Until(half_se=0.02), [on, off, flat], steps).enough
    assert standing_of(Until(half_se=0.03), [on, off, flat], steps).enough


def test_until_the_gap_is_closed() -> None:
    assert standing_of(GAP, [], [Step(0, 1, 0.1)]).enough
    found = standing_of(GAP, [], [Step(0, 1, 0.11), Step(1, 2, 0.02)])
    assert (found.enough, found.text) == (False, "its largest gap is 0.11")


def test_an_unknown_error_is_not_enough() -> None:
    found = standing_of(Until(theta_se=1.0), [curve([0.1, 0.2], [0.0, 1.0])], [Step(0.1, 0.2, 1.0)])
    assert (found.enough, found.text) == (False, "its theta_se cannot be told yet")


@given(
    rises=st.lists(st.floats(0, 1), min_size=1, max_size=8),
    most=st.integers(1, 20),
    enough=st.floats(0, 0.5),
    grid=st.sampled_from([None, 0.001, 0.03]),
)
def test_whatever_the_curve(rises: list[float], most: int, enough: float, grid: float | None) -> None:
    def as_set(contrast: float) -> float:
        return contrast if grid is None else round(contrast / grid) * grid

    ends = [as_set(0.1 + 0.1 * i) for i in range(len(rises) + 1)]
    steps = [Step(a, b, rise) for (a, b), rise in zip(pairwise(ends), rises, strict=True)]
    found = [as_set(step.middle) for step in halved(steps, most, enough, as_set)]
    assert len(found) <= most
    assert len(set(found) | set(ends)) == len(found) + len(ends)  # none twice, none that is there already
    assert all(ends[0] < contrast < ends[-1] for contrast in found)
    if grid is None and max(rises) > enough:
        assert found
