"""A ripple shows in background events, and in answers to pulses of several periods; chance does not look like one."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bench.diagnosis.recorded.ripple import ripple_hz
from bench.diagnosis.recorded.stimulus_bins import bins_of, counts_of

SECONDS = 10.0


def steady(rng: np.random.Generator, depth: float, hz: float = 0.0, events: int = 3000) -> Any:
    """Return a point at constant light with events at random times, more of them at some phase of a ripple."""
    t = rng.uniform(0.0, SECONDS, 4 * events)
    kept = rng.random(t.size) < 0.25 * (1.0 + depth * np.sin(2.0 * np.pi * hz * t + rng.uniform(0.0, 6.0)))
    stamps = np.zeros(int(kept.sum()), dtype=[("t", np.int64), ("p", np.uint8)])
    stamps["t"] = np.sort(t[kept] * 1e6)
    stamps["p"] = rng.integers(0, 2, stamps.size)
    return SimpleNamespace(events=lambda: iter([stamps]), duration_s=SECONDS, pulse_start_s=np.zeros(0))


def test_the_frequency_of_a_ripple_is_found() -> None:
    rng = np.random.default_rng(2)
    # A spectrum of 10 s tells frequencies 0.1 Hz apart.
    assert ripple_hz([steady(rng, 0.3, 123.4) for _ in range(3)]) == pytest.approx(123.4, abs=0.1)


def test_chance_is_no_ripple() -> None:
    """Forty runs without a ripple: with a chance of 1e-3 each, one alarm is seen in 4 % of cases, two in 0.1 %."""
    rng = np.random.default_rng(4)
    found = [ripple_hz([steady(rng, 0.0) for _ in range(3)]) for _ in range(40)]
    assert sum(f is not None for f in found) <= 1


def answers(
    rng: np.random.Generator,
    depth: float,
    hz: float,
    period_s: float,
    seconds: float = SECONDS,
    settling: float = 0.0,
) -> Any:
    """Return a point with pulses that are answered sooner and more often at some phase of a ripple.

    Of the first ones more are answered, too, up to 100 times `settling`.
    """
    edges = np.arange(0.1, seconds, 0.5 * period_s)
    phase = 2.0 * np.pi * hz * edges + rng.uniform(0.0, 6.0)
    parts = []
    for edge, ripple in zip(edges, depth * np.sin(phase), strict=True):
        answered = int(rng.binomial(200, 0.5 * (1.0 + ripple)) + 100 * settling * np.exp(-edge / 0.2))
        parts.append(edge + 5e-3 * (1.0 - 0.3 * ripple) + 1e-3 * rng.standard_normal(answered))
    stamps = np.zeros(sum(len(p) for p in parts), dtype=[("t", np.int64), ("p", np.uint8)])
    stamps["t"] = np.sort(np.concatenate(parts) * 1e6)
    return SimpleNamespace(events=lambda: iter([stamps]), duration_s=seconds, pulse_start_s=edges)


def test_pulses_of_several_periods_agree_on_the_ripple() -> None:
    rng = np.random.default_rng(6)
    taken = [answers(rng, 0.5, 123.4, period_s) for period_s in (0.161, 0.1, 0.071)]
    assert ripple_hz(taken) == pytest.approx(123.4, abs=0.1)
    assert ripple_hz([answers(rng, 0.0, 123.4, period_s) for period_s in (0.161, 0.1, 0.071)]) is None


def test_a_ripple_that_is_slow_from_pulse_to_pulse_keeps_its_frequency() -> None:
    """It turns by 0.4 Hz beside the pulses, eight tenths of a turn in a recording: trend takes most of it."""
    rng = np.random.default_rng(8)
    hz = 9.0 / 0.161 - 0.41
    taken = [answers(rng, 0.1, hz, period_s, seconds=2.1) for period_s in 6 * [0.161] + [0.041]]
    # 1 / (pi seconds signal/noise), 0.02 Hz for a wave of ten standard errors; highest in spectra is 153.1 Hz.
    assert ripple_hz(taken) == pytest.approx(hz, abs=3.0 * 0.02)


def test_recordings_that_settle_from_pulse_to_pulse_are_no_ripple() -> None:
    """Once mean and trend are taken out that is a slow wave beside the pulses, in a few recordings strong."""
    rng = np.random.default_rng(9)
    pulsed = [answers(rng, 0.1, 178.2, 0.161, seconds=2.1) for _ in range(12)]
    pulsed += [answers(rng, 0.1, 178.2, 0.041, seconds=0.9, settling=3.0 * (i < 6)) for i in range(12)]
    assert ripple_hz(pulsed) == pytest.approx(178.2, abs=3.0 * 0.02)


def test_pulses_of_one_period_do_not_tell() -> None:
    rng = np.random.default_rng(6)
    assert ripple_hz([answers(rng, 0.5, 123.4, 0.161) for _ in range(3)]) is None


def test_hardly_any_events_say_nothing() -> None:
    assert ripple_hz([steady(np.random.default_rng(6), 0.9, 123.4, events=50)]) is None


def written(per_pulse: Any, period_s: float, seconds: float = 2.0, late: float = 0.0) -> Any:
    """Return a point with pulses from `late` on, each answered by as many events as `per_pulse` says, at once."""
    edges = np.arange(0.1, seconds, 0.5 * period_s)
    times = np.repeat(np.round(1e6 * (edges + late)), [per_pulse(i) for i in range(len(edges))])
    stamps = np.zeros(len(times), dtype=[("t", np.int64), ("p", np.uint8)])
    stamps["t"] = times
    return SimpleNamespace(events=lambda: iter([stamps]), duration_s=seconds, pulse_start_s=edges)


def test_what_is_the_same_in_all_periods_leaves_nothing() -> None:
    """All pixels answer each pulse at once: what rounding leaves of that was a line of 1000 Hz."""
    assert ripple_hz([written(lambda _: 256, period_s) for period_s in (0.161, 0.041)]) is None


@pytest.mark.parametrize("late_us", [500, 750])
def test_stamps_on_the_edge_of_a_bin_are_in_one_bin(late_us: int) -> None:
    """Bins are a quarter of a millisecond; where one begins rounding told, and not in all periods alike."""
    point = written(lambda _: 256, 0.041, late=1e-6 * late_us)
    bins = bins_of(point, 1.0 / 4000.0)
    assert bins is not None
    assert not np.any(bins.beyond_stimulus(counts_of(point, bins)))


def test_what_few_recordings_settle_to_at_first_is_no_ripple() -> None:
    """Pulses between two thresholds are answered until the level has settled between them, in one of five."""
    rng = np.random.default_rng(3)

    def settling(i: int) -> int:
        return int(rng.binomial(256, 0.1 + 0.9 * math.exp(-i / 6.0)))

    periods = (0.161, 0.041)
    taken = [written(settling, period_s) for period_s in periods]
    taken += [written(lambda _: int(rng.binomial(256, 0.5)), period_s) for period_s in 4 * periods]
    assert ripple_hz(taken) is None
