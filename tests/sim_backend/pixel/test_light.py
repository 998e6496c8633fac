"""The light on the chip at the samples of an engine."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sim_backend.pixel.light import LightHistory, LightSampler, first_sample_at


def test_an_edge_is_seen_by_the_first_sample_at_or_after_it() -> None:
    t_s = np.array([0.0, 0.3, 0.30000001, 0.6000049, 1.1])
    assert first_sample_at(t_s, 1e-5).tolist() == [0, 30000, 30001, 60001, 110000]


def test_steps_without_rise_time() -> None:
    light = LightSampler(LightHistory(np.array([0.0, 0.002, 0.004]), np.array([1.0, 3.0, 0.0])), 1e-3)
    assert light.lux(0, 6).tolist() == [1.0, 1.0, 3.0, 3.0, 0.0, 0.0]
    assert light.lux(3, 5).tolist() == [3.0, 0.0]


def test_the_rise_is_that_of_the_differential_equation() -> None:
    t_s, lux, tau_s = np.array([0.0, 0.0031, 0.00457]), np.array([2.0, 5.0, 0.5]), 1e-3
    sampler = LightSampler(LightHistory(t_s, lux, tau_s), 1e-4)
    value = 2.0
    expected: dict[int, float] = {}
    for start, stop, level in zip(t_s, [*t_s[1:], 0.01], lux, strict=True):
        inside = np.arange(101)[(np.arange(101) * 1e-4 >= start - 1e-12) & (np.arange(101) * 1e-4 < stop - 1e-12)]
        grid = np.concatenate([np.clip(inside * 1e-4, start, stop), [stop]])
        solved = solve_ivp(
            lambda _, e, level=level: (level - e) / tau_s, (start, stop), [value], t_eval=grid, rtol=1e-10, atol=1e-12
        )
        expected.update(zip(inside.tolist(), solved.y[0], strict=False))
        value = solved.y[0, -1]
    got = sampler.lux(0, 100)
    assert got == pytest.approx([expected[i] for i in range(100)], rel=1e-7)


def test_the_rise_ends() -> None:
    sampler = LightSampler(LightHistory(np.array([0.0, 0.001]), np.array([2.0, 5.0]), 1e-3), 1e-4)
    assert np.all(sampler.lux(400, 500) == 5.0)


def test_windows_agree() -> None:
    light = LightHistory(np.array([0.0, 0.00113, 0.0027]), np.array([2.0, 5.0, 1.0]), 3e-4)
    sampler = LightSampler(light, 1e-5)
    whole = sampler.lux(0, 500)
    parts = np.concatenate([sampler.lux(i, i + 50) for i in range(0, 500, 50)])
    assert np.array_equal(whole, parts)


@pytest.mark.parametrize(
    ("t_s", "lux", "rise", "message"),
    [
        ([], [], 0.0, "one or more"),
        ([0.0, 1.0], [1.0], 0.0, "as many"),
        ([0.1], [1.0], 0.0, "ascend from 0"),
        ([0.0, 2.0, 1.0], [1.0, 1.0, 1.0], 0.0, "ascend"),
        ([0.0], [-1.0], 0.0, "0 or more"),
        ([0.0], [np.nan], 0.0, "0 or more"),
        ([0.0], [1.0], -1e-3, "rise time"),
    ],
)
def test_nonsense_is_refused(t_s: list[float], lux: list[float], rise: float, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        LightHistory(np.array(t_s), np.array(lux), rise)
