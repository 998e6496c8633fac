"""The parts of an alignment by events: counts, preamble, fronts and latencies."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.alignment.counts import EventCounts
from bench.alignment.front import find_front, fold
from bench.alignment.latency import Answered, Answering, light_began
from bench.alignment.places import light_edges
from protocols.errors import InputError


@given(st.lists(st.tuples(st.integers(0, 10_000_000), st.integers(0, 1)), max_size=50), st.integers(1, 7))
@settings(max_examples=60, deadline=None)
def test_events_are_counted_in_their_bins(events: list[tuple[int, int]], factor: int) -> None:
    counts = EventCounts()
    for t, p in events:  # one by one, in any order
        counts.add(np.array([t], np.int64), np.array([p], np.uint8))
    binned = counts.binned(factor)
    assert binned.sum() == len(events)
    for t, p in events:
        expected = sum(1 for u, q in events if q == p and u // (50 * factor) == t // (50 * factor))
        assert binned[p, t // (50 * factor)] == expected


def test_an_event_before_the_beginning_is_refused() -> None:
    with pytest.raises(InputError, match="-1 us"):
        EventCounts.of(np.array([-1]), np.array([0], np.uint8))


def test_edges_of_a_kind_go_between_the_same_levels() -> None:
    edges = light_edges(np.arange(6.0), np.array([1.0, 2.0, 1.0, 2.0, 2.0, 0.0]))
    np.testing.assert_array_equal(edges.t_s, [1.0, 2.0, 3.0, 5.0])  # at 4 s nothing changes
    np.testing.assert_array_equal(edges.up, [True, False, True, False])
    assert edges.kind[0] == edges.kind[2] != edges.kind[1] != edges.kind[3]
    np.testing.assert_allclose(edges.contrast[:3], np.log(2.0))
    assert edges.contrast[3] == pytest.approx(np.log(1000.0))  # darkness is a large step, not an infinite one
    assert not len(light_edges(np.array([0.0, 1.0]), np.array([0.0, 0.0])).t_s)


@pytest.mark.parametrize(("delay_s", "background"), [(0.0, 0.0), (3.2e-4, 0.05), (-7e-4, 0.3)])
def test_the_front_is_where_the_rate_begins_to_rise(delay_s: float, background: float) -> None:
    rng = np.random.default_rng(4)
    at_s = np.asarray(0.5 + 0.1 * np.arange(40), np.float64)
    answers = (at_s[:, None] + delay_s + 3e-4 * np.sqrt(rng.random((40, 60)))).ravel()
    noise = rng.uniform(0.0, 5.0, int(background * 1e5))
    counts = EventCounts.of(
        (1e6 * np.concatenate([answers, noise])).astype(np.int64), np.ones(2400 + len(noise), np.uint8)
    )
    front = find_front(fold(counts.binned()[1], at_s, 0.1, 0.1, 2e-3))
    assert front is not None
    assert front.t_s == pytest.approx(delay_s, abs=5e-5)


def test_too_few_answers_have_no_front() -> None:
    counts = EventCounts.of(np.array([500_100, 600_100]), np.ones(2, np.uint8))
    assert find_front(fold(counts.binned(1, 1.0)[1], np.array([0.5, 0.6]), 0.1, 0.1, 2e-3)) is None


def test_fast_answers_to_a_large_step_leave_a_small_bound() -> None:
    known = Answering(rise_tau_s=1e-5, bandwidth_hz=5000.0)
    large = light_began([Answered(True, 2.3, 1e-4, 1e-5)], known)
    small = light_began([Answered(True, 0.4, 1e-3, 1e-5)], Answering())
    assert 0.0 < 1e-4 - large.t_s < 1e-4
    assert large.bound_s < 1e-4 < 3e-4 < small.bound_s


def test_no_answer_is_due_but_there_is_one() -> None:
    began = light_began([Answered(False, 0.01, 2e-3, 1e-5)], Answering())
    assert began.bound_s >= 1e-3
    assert began.t_s < 2e-3


def test_what_comes_much_later_is_no_answer_and_changes_nothing() -> None:
    """Below the threshold there are no answers, but events of other edges some way off."""
    clear = [Answered(True, 1.6, 1.5e-4, 2e-5), Answered(False, 1.6, 4.5e-4, 2e-5)]
    stray = [Answered(True, 0.2, 2.2e-2, 2e-4), Answered(False, 0.2, 2e-3, 9e-4)]
    assert light_began([*clear, *stray], Answering(1e-3)) == light_began(clear, Answering(1e-3))


@pytest.mark.parametrize("wrong", [{"rise_tau_s": -1.0}, {"bandwidth_hz": 0.0}, {"theta_on": float("nan")}])
def test_what_cannot_be_known_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(InputError, match=next(iter(wrong))):
        Answering(**wrong)
