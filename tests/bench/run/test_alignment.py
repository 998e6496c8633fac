"""Edges put onto the camera's time axis: triggers that are all there, lost, doubled, shifted, and none at all."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.run.alignment import align_to_triggers, moved_windows
from protocols.waveforms import reset_test_edges, square_edges

EDGES = np.array([0.0, *np.cumsum(np.random.default_rng(1).uniform(0.05, 0.2, 30))])


def _triggers(edges_s: np.ndarray, offset_s: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    t = np.rint((edges_s[1:] + offset_s) * 1e6).astype(np.int64)
    return t, (np.arange(len(t)) % 2 == 0).astype(np.uint8)


@pytest.mark.parametrize("offset_s", [0.0, 0.0123, 3.7, -0.02])
def test_all_triggers_are_there(offset_s: float) -> None:
    t, p = _triggers(EDGES, offset_s)
    found = align_to_triggers(EDGES, t, p)
    assert found is not None
    np.testing.assert_array_equal(found.trigger, [-1, *range(30)])
    np.testing.assert_allclose(found.t_s[1:], t / 1e6, rtol=1e-12)
    assert found.t_s[0] == 0.0
    assert found.offset_s == pytest.approx(offset_s, abs=1e-6)
    assert (found.lost, found.extra) == (0, 0)
    assert found.residual_s < 1e-6


@settings(max_examples=50, deadline=None)
@given(
    lost=st.sets(st.integers(0, 29), max_size=7),
    extra=st.lists(st.integers(20_000_000, 30_000_000), max_size=5),
    offset_us=st.integers(0, 10_000_000),
)
def test_lost_triggers_are_minus_one_and_the_others_stay(lost: set[int], extra: list[int], offset_us: int) -> None:
    t, _ = _triggers(EDGES, offset_us * 1e-6)
    kept = np.array([i for i in range(30) if i not in lost])
    seen = np.concatenate([t[kept], np.sort(np.array(extra, np.int64))])
    found = align_to_triggers(EDGES, seen, np.ones(len(seen), np.uint8))
    assert found is not None
    assert found.lost == len(lost)
    assert found.extra == len(extra)
    assert set(np.flatnonzero(found.trigger[1:] == -1)) == lost
    np.testing.assert_allclose(found.t_s[1:], EDGES[1:] + offset_us * 1e-6, atol=2e-6)


def test_pulses_whose_rising_edge_counts() -> None:
    """A source that sends a pulse of 1 ms for every edge of the light: twice as many trigger edges."""
    t, _ = _triggers(EDGES, 0.5)
    both = np.stack([t, t + 1000], axis=1).ravel()
    found = align_to_triggers(EDGES, both, np.tile(np.array([1, 0], np.uint8), 30))
    assert found is not None
    np.testing.assert_array_equal(found.trigger[1:], 2 * np.arange(30))
    assert (found.lost, found.extra) == (0, 0)


def test_a_clock_that_runs_at_another_rate() -> None:
    """50 ppm over half an hour are 90 ms: far more than the tolerance, but each edge has its own trigger."""
    edges = np.arange(0.0, 1800.0, 0.1)
    t, p = _triggers(edges * (1.0 + 50e-6))
    found = align_to_triggers(edges, t, p)
    assert found is not None
    np.testing.assert_allclose(found.t_s, edges * (1.0 + 50e-6), atol=1e-6)
    assert found.lost == 0
    assert found.rate_ppm == pytest.approx(50.0, abs=0.01)


def test_nothing_to_align() -> None:
    none = np.empty(0, np.int64), np.empty(0, np.uint8)
    assert align_to_triggers(EDGES, *none) is None
    assert align_to_triggers(np.zeros(1), *_triggers(EDGES)) is None


def test_windows_move_with_the_edge_at_which_they_begin() -> None:
    stimulus = square_edges(period_s=0.2, duty=0.5, low_lux=1.0, high_lux=2.0, cycles=3, first_edge_s=0.1)
    moved = stimulus.t_s + np.array([0.0, 0.001, 0.002, 0.003, 0.004, 0.005, 0.006])
    start, stop = moved_windows(stimulus, moved)
    np.testing.assert_allclose(start, moved[1:])
    np.testing.assert_allclose(stop - start, 0.1)
    stimulus = reset_test_edges(
        baseline_lux=1.0, reset_lux=2.0, test_lux=1.5, gap_s=0.1, reset_s=0.05, test_s=0.05, cycles=2
    )  # fmt: skip
    start, stop = moved_windows(stimulus, stimulus.t_s + np.arange(9) * 1e-3)
    np.testing.assert_allclose(start, stimulus.pulse_start_s + np.array([0.003, 0.007]))
    np.testing.assert_allclose(stop - start, 0.05)
