"""First passage behind a slow photoreceptor: against the table for fast steps, and against paths drawn by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bench.analysis.first_passage import grid_shift, survival_table
from bench.characterize import slow_step
from bench.characterize.slow_step import SlowStep


@pytest.mark.parametrize("time", [3.0, 12.0, 25.0])
def test_a_fast_photoreceptor_gives_the_universal_table(time: float) -> None:
    table, step = survival_table(), np.array([2.0, 5.0, 8.0, 12.0])
    slow = SlowStep(step, np.full(4, 1e-6), 25.0)
    known, found = table.from_steps(time, step), slow.from_steps(time, step)
    # 0.02 in a chance is 0.05 sigma of the barrier where the curve is steepest.
    assert np.abs(found - known)[:, np.abs(table.barrier - 1.0) < 5.0].max() < 0.02


def test_paths_drawn_by_hand_are_answered_as_often() -> None:
    rng = np.random.default_rng(7)
    lag, step, end, dt, paths = 6.0, 9.0, 20.0, 0.01, 8000
    barrier = np.array([-1.0, 0.0, 1.0])
    rho, kick = math.exp(-dt), math.sqrt(1.0 - math.exp(-2.0 * dt))
    noise, slow, mean = rng.normal(size=paths), 0.0, 0.0
    highest = np.full(paths, -np.inf)
    for k in range(round(end / dt)):
        noise = rho * noise + kick * rng.normal(size=paths)
        slow = 1.0 - math.exp(-(k + 0.5) * dt / lag)
        mean = rho * mean + (1.0 - rho) * slow
        highest = np.maximum(highest, noise + step * mean)
    # The paths are looked at now and then: their barriers act as higher ones.
    left = np.array([np.mean(highest < step + b) for b in barrier])
    places = [int(np.argmin(np.abs(survival_table().barrier - b))) for b in barrier]
    shifted = SlowStep(np.array([step]), np.array([lag]), end)
    chance = np.interp(
        barrier + grid_shift(dt), survival_table().barrier, shifted.from_steps(end, np.array([step]))[0]
    )
    error = np.sqrt(chance * (1.0 - chance) / paths)
    assert np.all(np.abs(left - chance) < 4.0 * error + 0.02)
    assert np.all(np.diff(shifted.from_steps(end, np.array([step]))[0][places]) > 0.0)


@pytest.mark.parametrize(("end", "lag"), [(20.0, 0.3), (60.0, 5.0), (400.0, 20.0)])
def test_steps_of_time_are_short_enough(monkeypatch: pytest.MonkeyPatch, end: float, lag: float) -> None:
    step, lags = np.array([3.0, 8.0, 14.0]), np.full(3, lag)
    found = SlowStep(step, lags, end).from_steps(end, step)
    for name, value in (("_LONGEST", 0.1), ("_MOVED", 0.05), ("_EARLY", math.inf)):
        monkeypatch.setattr(slow_step, name, value)
    fine = SlowStep(step, lags, end).from_steps(end, step)
    # What a threshold that is off by 0.005 of the noise would change, where the curve is steepest: 0.002.
    assert np.abs(found - fine).max() < 0.005


def test_a_slower_photoreceptor_leaves_more_unanswered() -> None:
    step = np.array([8.0])
    chances = [SlowStep(step, np.array([lag]), 20.0).from_steps(20.0, step)[0, 50] for lag in (0.5, 3.0, 10.0, 30.0)]
    assert np.all(np.diff(chances) > 0.0)
