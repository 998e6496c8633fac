"""What is left of the reset pulse, against closed forms and paths; shot noise, against the simulator."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from bench.analysis.whole import analyze
from bench.characterize.family_model import Family, expected
from bench.characterize.levels import Reset, levels_of
from bench.characterize.rearming import Lags, left_of_reset
from benchmarks.dark_light import runs
from benchmarks.dark_light.settings import SETTINGS, plan_of

_FAST_S = 1e-6
_LITTLE_NOISE = 1e-9


def test_one_low_pass_leaves_an_exponential() -> None:
    """Without noise a pixel fires when the signal has fallen by 0.25, and memorises one dead time later."""
    timing, lag_s = Reset(math.nan, gap_s=0.1, dead_s=0.02), 0.01
    found = left_of_reset(0.4, 0.25, _LITTLE_NOISE, Lags(_FAST_S, lag_s), timing)
    assert found == pytest.approx((0.4 - 0.25) * math.exp(-0.02 / lag_s), rel=0.01)


def test_a_pixel_fires_again_while_more_than_a_threshold_is_left() -> None:
    timing, lag_s = Reset(math.nan, gap_s=0.2, dead_s=0.005), 0.01
    first = (1.0 - 0.25) * math.exp(-0.5)
    assert first > 0.25
    second = (first - 0.25) * math.exp(-0.5)
    assert second < 0.25
    found = left_of_reset(1.0, 0.25, _LITTLE_NOISE, Lags(_FAST_S, lag_s), timing)
    assert found == pytest.approx(second, rel=0.01)


def test_a_fast_photoreceptor_leaves_nothing() -> None:
    found = left_of_reset(0.5, 0.25, 0.04, Lags(8e-4, 1e-5), Reset(math.nan, gap_s=0.03, dead_s=0.01))
    assert abs(found) < 1e-4


def test_noise_lets_a_pixel_fire_early() -> None:
    """Paths of the two low-passes with noise: the median of what they memorise."""
    rng = np.random.default_rng(3)
    tau_s, lag_s, noise, reset, opposite, dead_s, dt_s = 8e-4, 13e-3, 0.04, 0.47, 0.25, 0.02, 2e-5
    keep = math.exp(-dt_s / tau_s)
    start = noise * rng.normal(size=2000)
    now, smooth, fired = start.copy(), reset, np.full(start.size, math.nan)
    for k in range(1, round(0.06 / dt_s)):
        smooth += (1.0 - keep) * (reset * math.exp(-k * dt_s / lag_s) - smooth)
        now = keep * now + noise * math.sqrt(1.0 - keep**2) * rng.normal(size=now.size)
        fired = np.where(np.isnan(fired) & (smooth + now < reset - opposite), k * dt_s, fired)
    left = reset * np.exp(-(fired + dead_s - tau_s) / lag_s)
    found = left_of_reset(reset, opposite, noise, Lags(tau_s, lag_s), Reset(math.nan, gap_s=0.1, dead_s=dead_s))
    quiet = left_of_reset(reset, opposite, _LITTLE_NOISE, Lags(tau_s, lag_s), Reset(math.nan, 0.1, dead_s))
    assert found > 1.1 * quiet
    # The paths are looked at now and then, and crossings are not quite independent: a hundredth of the dead time.
    assert found == pytest.approx(float(np.median(left)), rel=0.06)


def test_shot_noise_that_falls_with_the_step_is_what_the_simulator_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    """At 1 fA and 76 mlux: a law that has the noise at the threshold for every contrast would be off by 0.015."""
    setting = next(s for s in SETTINGS if s.name == "noise-1fA")
    low = [replace(plan, pulses=120) for plan in plan_of(setting)[:10:3]]
    monkeypatch.setattr(runs, "plan_of", lambda _: low)
    run = runs.simulate(setting, 5)
    rows = [r for r in analyze(run, pixel_maps=False, theta_fit=lambda _: None).responses if r.key.polarity == "on"]
    (level,) = levels_of(rows, run.taken)
    level = replace(level, grid_s=1e-5)  # of the engine: four contrasts have too few answers to tell
    tau_s, fa_per_lux = 1.0 / (2.0 * math.pi * 200.0), setting.dark_fa / setting.dark_lux
    shot = 0.02 * 1.602176634e-4 / fa_per_lux / (2.0 * tau_s)
    truth = Family(0.30, 0.05, 0.0, math.log(tau_s), 0.0, setting.dark_lux, 0.0, shot, 0.0, 0.0)
    share = expected(level, truth, 0.25 / 0.30).share
    share *= level.mean[-1] / share[-1]  # noise events before the pulse blind a pixel
    error = np.sqrt(share * (1.0 - share) / (level.pulses * level.share.shape[0]))
    # Three standard errors, and 1 % of the noise for the law (of the normal density, 0.38 at such shares).
    assert 0.3 < share[0] < 0.5
    assert abs(level.mean[0] - share[0]) < 3.0 * error[0] + 0.01 * 0.38
    quiet = expected(level, replace(truth, shot_lux=0.0), 0.25 / 0.30).share
    assert abs(level.mean[0] - quiet[0]) > 0.05
