"""Edges put onto the camera's time axis: triggers that are all there, lost, doubled, shifted, and none at all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.alignment.triggers import align_to_triggers, moved_windows
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


@pytest.mark.parametrize("n_edges", [1, 2, 3, 30])
def test_a_stray_trigger_moves_nothing(n_edges: int) -> None:
    for stray_us in (1, 250_000, 5_000_000):
        found = align_to_triggers(EDGES[: n_edges + 1], np.array([stray_us]), np.ones(1, np.uint8))
        assert found is None


def test_half_of_the_edges_must_have_a_trigger() -> None:
    t, p = _triggers(EDGES, 0.5)
    half = align_to_triggers(EDGES, t[:15], p[:15])
    assert half is not None
    assert half.lost == 15
    assert align_to_triggers(EDGES, t[:14], p[:14]) is None


def test_a_window_before_the_first_edge_moves_with_it() -> None:
    """The window begins in the gap, 1 ms before the edge that is looked for; one of a background ends there."""
    stimulus = square_edges(period_s=0.2, duty=0.5, low_lux=1.0, high_lux=2.0, cycles=3, first_edge_s=0.1)
    early = replace(
        stimulus,
        pulse_start_s=np.array([0.0, 0.099, 0.15, 0.199, 0.61]),
        pulse_stop_s=np.array([0.05, 0.15, 0.18, 0.25, 0.65]),
        pulse_kind=np.zeros(5, np.uint8),
    )
    shift = np.array([0.0, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0])
    start, stop = moved_windows(early, early.t_s + shift)
    np.testing.assert_allclose(start - early.pulse_start_s, [0.5, 0.5, 0.5, 0.6, 1.0])
    np.testing.assert_allclose(stop - start, early.pulse_stop_s - early.pulse_start_s)


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
