"""First passage of the noise: against closed forms and a simulation that shares no code with it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import erf, ndtr

from bench.analysis.first_passage import ArmedPixel, grid_shift, survival_table

if TYPE_CHECKING:
    import numpy.typing as npt


def row(values: npt.NDArray[np.float64], barrier: float) -> npt.NDArray[np.float64]:
    """Return the survival at a barrier that is in the table."""
    at = np.flatnonzero(np.isclose(survival_table().barrier, barrier))
    assert at.size == 1
    return np.asarray(values[..., at[0]])


@pytest.mark.parametrize("barrier", [3.0, 4.0, 5.0])
def test_hazard_over_a_far_barrier_is_the_inverse_exit_time(barrier: float) -> None:
    # T_exit is the time to leave -a..a from the middle; one side alone is left half as often.
    exit_time = quad(lambda y: math.exp(y * y / 2) * math.sqrt(math.pi / 2) * erf(y / math.sqrt(2)), 0, barrier)[0]
    start = np.zeros(1)
    table = survival_table()
    lost = np.log(row(table.from_steps(200.0, start), barrier) / row(table.from_steps(300.0, start), barrier))
    expected = 100.0 / (2.0 * exit_time)
    # One side and two differ by the time to come back from the other side, of order one in 2 T_exit. The cells are
    # made for barriers at which a step is answered, below 4, and less good for those beyond.
    assert float(lost[0]) == pytest.approx(expected, rel=0.004 + 1.0 / exit_time + 0.001 * math.exp(barrier - 3.0))


@pytest.mark.parametrize("barrier", [0.0, 1.0, 2.0, 3.0])
def test_mean_first_passage_time_from_the_stationary_law(barrier: float) -> None:
    table = survival_table()
    # Siegert's formula: the mean time from x to H is sqrt(2 pi) times the integral of exp(y^2/2) Phi(y) from x to H;
    # averaged over x ~ N(0, 1) below H, the order of the integrals is exchanged.
    mean = (
        quad(lambda y: math.exp(y * y / 2) * ndtr(y) ** 2, -12, barrier)[0] * math.sqrt(2 * math.pi) / ndtr(barrier)
    )
    late = np.geomspace(40.0, 4000.0, 400)[1:]
    time = np.concatenate((table.time, late))
    survival = np.array([row(table.at(t)[:, 0], barrier) for t in time])
    assert np.trapezoid(survival, time) == pytest.approx(mean, rel=0.005)


@pytest.mark.parametrize(("step", "barrier"), [(18.0, -9.0), (14.4, -6.0), (18.0, -3.0)])
def test_without_much_noise_the_level_is_crossed_when_the_low_pass_says(step: float, barrier: float) -> None:
    table = survival_table()
    survival = row(table.over_time(np.array([step]))[0].T, barrier)
    median = float(np.interp(-0.5, -survival, table.time))
    # The output crosses at ln(C / |H|), and noise of 1 at a slope of |H| moves that by 1 / |H| either way; the first
    # of its crossings is earlier by a part of 1 / H^2.
    assert median == pytest.approx(math.log(step / -barrier), abs=1.2 / barrier**2)


def test_deeper_starts_than_the_table_has_come_later() -> None:
    table = survival_table()
    deepest = float(table.step[-1])
    deeper = table.from_steps(2.0 + math.log(1.5), np.array([1.5 * deepest]))[0]
    assert np.allclose(deeper, table.from_steps(2.0, np.array([deepest]))[0], atol=1e-12)
    # The same, without leaving the table: far from the barrier only the time at which the mean arrives counts.
    one = table.from_steps(2.0 + math.log(18.0 / 14.4), np.array([18.0]))[0]
    other = table.from_steps(2.0, np.array([14.4]))[0]
    near = table.barrier > -6.0
    assert np.allclose(one[near], other[near], atol=2e-3)


def simulated_survival(
    barrier: float, step: float, times: list[float], dt: float, paths: int, seed: int
) -> list[float]:
    """Return the share of paths that have stayed below the barrier, looked at every dt."""
    rng = np.random.default_rng(seed)
    y = rng.standard_normal(paths) - step
    alive = y < barrier
    alive_at_start = alive.copy()
    keep, noise, shares = math.exp(-dt), math.sqrt(1.0 - math.exp(-2.0 * dt)), []
    for k in range(1, round(max(times) / dt) + 1):
        y = keep * y + noise * rng.standard_normal(paths)
        alive &= y < barrier
        if any(abs(k * dt - t) < dt / 2 for t in times):
            shares.append(float(alive.sum() / alive_at_start.sum()))
    return shares


@pytest.mark.parametrize(
    ("barrier", "step"), [(-2.0, 8.0), (0.0, 4.0), (1.0, 0.8), (2.0, 8.0), (2.5, 2.0), (3.0, 6.0)]
)
def test_survival_agrees_with_simulated_paths(barrier: float, step: float) -> None:
    dt, paths, times = 0.01, 10_000, [0.5, 2.0, 10.0]
    # Paths that are looked at every dt see a barrier that is higher by the shift; so look for it that much lower.
    seen = simulated_survival(
        barrier - grid_shift(dt), step, times, dt, paths, seed=round(1000 + 100 * barrier + step)
    )
    table = survival_table()
    for time, share in zip(times, seen, strict=True):
        expected = float(row(table.from_steps(time, np.array([step]))[0], barrier))
        error = math.sqrt(max(expected * (1 - expected), 1 / paths) / paths)
        # The shift is the first term of a series in sqrt(dt); the next is a few per cent of it.
        assert share == pytest.approx(expected, abs=4.0 * error + 0.003)


def test_answers_averaged_over_the_reference_do_not_depend_on_where_the_table_ends() -> None:
    # 14 sigma below a threshold of 18 sigma nothing is answered, 14 above everything.
    table = survival_table()
    pixel = ArmedPixel(wait=20.0, other=18.0)
    step = np.array([4.0, 15.0, 16.0, 32.0])
    missed = pixel.unanswered(np.array([18.0]), step, table.from_steps(40.0, step))[0]
    assert missed[0] == pytest.approx(1.0, abs=1e-6)
    assert missed[-1] == pytest.approx(0.0, abs=1e-6)
    assert 0.01 < missed[2] < missed[1] < 0.99


def test_references_near_the_other_threshold_are_gone() -> None:
    table = survival_table()
    step = np.array([6.5])
    survival = table.from_steps(40.0, step)
    missed = [
        float(ArmedPixel(20.0, other).unanswered(np.array([6.0]), step, survival)[0, 0]) for other in (3.5, 4.5, 9.0)
    ]
    # Those that need the largest step lie nearest to it, so more pulses are answered than without it.
    assert missed[0] < 0.5 * missed[1] < 0.5 * missed[2]
