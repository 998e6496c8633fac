"""What repeats in a waveform is stored once, and what is played is the waveform."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.interfaces import Waveform
from drivers.light.led_program import CannotPlay, Program, program_of
from protocols.waveforms import reset_test_edges, square_edges
from tests.drivers.light.led_waveforms import waveform


def program(wave: Waveform, tick_us: int = 1, max_edges: int = 4096) -> Program:
    return program_of(wave, tick_us=tick_us, max_edges=max_edges, shortest_us=20)


def expanded(stored: Program) -> tuple[list[int], list[int]]:
    """Return times and levels as the device plays them."""
    stop = stored.loop_from + stored.loop_edges
    edges = stored.stored[: stored.loop_from] + stored.stored[stored.loop_from : stop] * stored.loops
    edges += stored.stored[stop:]
    times = np.cumsum([0, *(delta_us for delta_us, _ in edges)])
    return times.tolist(), [stored.begin, *(level for _, level in edges)]


def reset_test(cycles: int, gap_s: float = 0.05) -> Waveform:
    found = reset_test_edges(
        baseline_lux=100, reset_lux=400, test_lux=130, gap_s=gap_s, reset_s=0.02, test_s=0.03, cycles=cycles
    )
    return Waveform(found.t_s, found.lux, found.duration_s)


def square(hz: float, cycles: int, duty: float = 0.5) -> Waveform:
    period_s = 1.0 / hz
    found = square_edges(
        period_s=period_s, duty=duty, low_lux=50, high_lux=90, cycles=cycles, first_edge_s=(1 - duty) * period_s
    )
    return Waveform(found.t_s, found.lux, found.duration_s)


@pytest.mark.parametrize(
    ("wave", "most"),
    [
        (reset_test(5000), 8),
        (square(10.0, 3000), 4),
        (square(1000.0, 3000, duty=0.25), 4),
        (square(30.0, 3000), 12),
        (square(7.0, 3000), 28),
    ],
)
def test_thousands_of_cycles_fit(wave: Waveform, most: int) -> None:
    stored = program(wave)
    times, levels = expanded(stored)
    assert len(stored.stored) <= most
    np.testing.assert_allclose(np.array(times) / 1e6, wave.t_s, atol=0.5e-6 + 1e-12)
    assert levels == wave.level.tolist()
    assert times == stored.t_us.tolist()
    assert stored.duration_us == round(wave.duration_s * 1e6)
    assert stored.end_us == stored.duration_us - times[-1]


def test_a_square_wave_after_a_pause_is_known() -> None:
    assert program(square(10.0, 300)).square == (50, 90, 100_000, 50_000, 300, 50_000)
    assert program(square(10.0, 300, duty=0.2)).square == (50, 90, 100_000, 20_000, 300, 80_000)
    assert program(reset_test(10)).square is None
    assert program(square(30.0, 300)).square is None
    assert program(waveform([0], [5], 100)).square is None


pairs = st.lists(st.tuples(st.integers(20, 24), st.integers(1, 3)), max_size=5)


@given(pairs, pairs, st.integers(1, 6), pairs, st.integers(0, 50))
def test_every_waveform_is_played_as_it_is(
    head: list[tuple[int, int]], block: list[tuple[int, int]], times: int, tail: list[tuple[int, int]], end_us: int
) -> None:
    edges = head + block * times + tail
    t_us = np.cumsum([0, *(delta_us for delta_us, _ in edges)])
    wave = waveform(t_us.tolist(), [1, *(level for _, level in edges)], int(t_us[-1]) + end_us)
    stored = program(wave)
    assert expanded(stored) == (t_us.tolist(), wave.level.tolist())
    assert stored.duration_us == t_us[-1] + end_us
    assert len(stored.stored) <= len(head) + len(block) + len(tail)
    if stored.square is not None:
        low, high, period_us, bright_us, count, preamble_us = stored.square
        again = [(preamble_us, high), (bright_us, low), *([(period_us - bright_us, high), (bright_us, low)] * count)]
        assert edges == again[: 2 * count]
        assert stored.end_us == period_us - bright_us


def test_times_go_to_the_ticks_of_the_device() -> None:
    stored = program(waveform([0, 101.3, 250], [1, 2, 1], 399), tick_us=4)
    assert stored.t_us.tolist() == [0, 100, 248]
    assert stored.duration_us == 400


def test_what_does_not_fit_is_told_with_numbers() -> None:
    rng = np.random.default_rng(1)
    t_us = np.cumsum(rng.integers(20, 1_000_000, 5000))
    wave = waveform([0, *t_us.tolist()], [1, *([2, 1] * 2500)], int(t_us[-1]) + 1)
    with pytest.raises(CannotPlay, match=r"its 5000 edges do not repeat .* (4\d\d\d|5000) would .* room for 4096"):
        program(wave)
    assert len(program(wave, max_edges=5000).t_us) == 5001


@pytest.mark.parametrize(
    ("wave", "why"),
    [
        (waveform([0, 10], [1, 2], 100), "two edges are 10 us apart at 0 s; 20 us is the least"),
        (waveform([0, 50, 50], [1, 2, 3], 100), "two edges are 0 us apart at 5e-05 s"),
        (waveform([0], [1], 2.1e9), "2100 s pass without an edge; 2000 s is the most"),
        (waveform([0, 1.9e9, 3.8e9], [1, 2, 1], 4.4e9), r"it lasts 4400 s; 4294\.\d+ s is the most"),
        (waveform([5], [1], 100), "do not ascend from 0 s"),
        (waveform([0, 60, 30], [1, 2, 3], 100), "do not ascend from 0 s"),
        (waveform([0, 60], [1, 2], 50), "ends at 5e-05 s, and has its last edge at 6e-05 s"),
        (waveform([0, 60], [1], 100), "2 times and 1 levels"),
        (waveform([], [], 100), "0 times and 0 levels"),
        (waveform([0, float("nan")], [1, 2], 100), "do not ascend"),
        (waveform([0], [1], float("inf")), "ends at inf s"),
    ],
)
def test_what_cannot_be_timed_is_told(wave: Waveform, why: str) -> None:
    with pytest.raises(CannotPlay, match=why):
        program(wave)
