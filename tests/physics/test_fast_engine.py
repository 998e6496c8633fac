"""The fast engine has the same distribution of events as the reference engine, and is as repeatable."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from drivers.events.types import EVENT_DTYPE
from protocols.points import Roi
from sim_backend.pixel import FastEngine, LightHistory, PixelModel, ReferenceEngine, build_chain
from sim_backend.pixel.effects import (
    DarkCurrent,
    Leak,
    LightFlicker,
    LightRiseTime,
    LowFrequencyNoise,
    PhotoreceptorBandwidth,
    ShotNoise,
    StrayLight,
    ThresholdMismatch,
    effect_from_dict,
    effects,
)
from sim_backend.pixel.engines.hazard import hazard_table, quasi_stationary
from sim_backend.pixel.engines.one_pole import OnePole
from sim_backend.pixel.engines.segments import LAST
from sim_backend.pixel.engines.stretches import UNIT

if TYPE_CHECKING:
    import numpy.typing as npt

    Events = npt.NDArray[np.void]

ROI = Roi(10, 20, 16, 16)
LUX = 10.0
HALF_S = 0.1
PERIODS = 25


def square(log_contrast: float, periods: int = PERIODS) -> LightHistory:
    """Return a square wave of 5 Hz."""
    t_s = np.arange(2 * periods, dtype=np.float64) * HALF_S
    return LightHistory(t_s, np.where(np.arange(2 * periods) % 2, LUX * math.exp(log_contrast), LUX))


def reset_test(log_contrast: float) -> LightHistory:
    """Return reset pulses and test pulses in turn; the test begins where the upper half of the square wave does."""
    lux = LUX * np.array([1.0, 1.5, 1.0, math.exp(log_contrast)])
    starts = (np.arange(PERIODS)[:, None] * 2.0 * HALF_S + np.array([0.0, 0.02, 0.06, HALF_S])).ravel()
    return LightHistory(starts, np.tile(lux, PERIODS))


def noisy(corner_hz: float, refractory_s: float, apart: float = 4.6, theta_off: float = 0.3) -> PixelModel:
    return PixelModel(noise_rms=0.3 / apart, corner_hz=corner_hz, refractory_s=refractory_s, theta_off=theta_off)


def take(engine: Any, model: PixelModel, light: LightHistory, roi: Roi = ROI, seed: int = 1) -> Events:
    chain = build_chain(model, roi, sensor_seed=3)
    parts = list(engine.events(chain, light, 2.0 * HALF_S * PERIODS, seed))
    return np.concatenate([np.empty(0, EVENT_DTYPE), *parts])


DEFAULT = (
    noisy(200.0, 3e-3)
    + DarkCurrent(mean_fa=20.0, spread=0.3)
    + StrayLight(illuminance_lux=1.0)
    + ThresholdMismatch(sigma_on=0.02, sigma_off=0.02)
)
SETTINGS = {
    "frozen differences": (DEFAULT, square(0.35)),
    "very noisy": (noisy(50.0, 1e-3, 2.5), LightHistory.constant(LUX)),
    "rising light": (DEFAULT + LightRiseTime(tau_s=1e-3), square(0.35)),
    "flicker": (DEFAULT + LightFlicker(depth=0.1, frequency_hz=100.0), square(0.35)),
    "leak": (DEFAULT + Leak(rate_per_s=0.5, spread=0.3), square(0.35)),
    "two poles": (
        DEFAULT + ShotNoise() + PhotoreceptorBandwidth(hz_per_fa=1.0, max_hz=1000.0) + LightRiseTime(tau_s=1e-3),
        square(0.5),
    ),
    "shot noise": (DEFAULT + ShotNoise(factor=0.5) + Leak(rate_per_s=0.5, spread=0.3), square(0.35)),
    "slow noise": (DEFAULT + LowFrequencyNoise(rms=0.03, tau_s=0.2), square(0.35)),
}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name == "two poles")) for name in SETTINGS]
)
def test_threads_and_the_window_change_nothing(name: str) -> None:
    model, light = SETTINGS[name]
    expected = take(FastEngine(), model, light)
    assert np.array_equal(expected, np.sort(expected, order=["t", "y", "x"]))
    assert np.array_equal(take(FastEngine(threads=1), model, light), expected)
    assert np.array_equal(take(FastEngine(threads=5), model, light), expected)
    few = Roi(12, 21, 3, 2)
    x, y = expected["x"], expected["y"]
    inside = (x >= few.x) & (x < few.x + few.width) & (y >= few.y) & (y < few.y + few.height)
    assert np.array_equal(take(FastEngine(), model, light, roi=few), expected[inside])
    assert not np.array_equal(take(FastEngine(), model, light, seed=2), expected)


@pytest.mark.parametrize("name", [name for name in SETTINGS if name not in ("two poles", "slow noise")])
def test_the_length_of_a_stretch_changes_nothing(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    model, light = SETTINGS[name]
    expected = take(FastEngine(), model, light)
    monkeypatch.setattr(OnePole, "_stretch_samples", lambda _: UNIT)
    assert np.array_equal(take(FastEngine(), model, light), expected)
    assert len(take(FastEngine(), model, light)) > 1000


@pytest.mark.parametrize("tau_s", [0.0, 1e-3])
@pytest.mark.parametrize("lux", [0.0, 1e-6])
def test_light_that_goes_out_ends_at_the_lowest_current(lux: float, tau_s: float) -> None:
    """Without a dark current the logarithm ends at 1e-4 fA, dozens of thresholds below, whoever computes."""
    model = noisy(200.0, 1e-3, 5.0) + LightRiseTime(tau_s=tau_s)
    light = LightHistory(np.array([0.0, 0.02]), np.array([LUX, lux]))
    expected, found = (take(engine, model, light) for engine in (ReferenceEngine(), FastEngine()))
    off, on = ([int(np.sum(e["p"] == p)) for e in (expected, found)] for p in (0, 1))
    assert off[0] > 3 * ROI.pixels
    for n, m in (off, on):
        assert abs(n - m) < 4.5 * math.sqrt(n + m)


def test_pixels_of_both_kinds_come_in_one_order() -> None:
    model = noisy(2000.0, 1e-3, 4.0) + ThresholdMismatch(sigma_on=0.03, sigma_off=0.03)
    light = square(0.3, 2)
    expected = take(FastEngine(), model, light)
    assert np.array_equal(expected, np.sort(expected, order=["t", "y", "x"]))
    alone = Roi(13, 22, 1, 1)
    own = expected[(expected["x"] == 13) & (expected["y"] == 22)]
    assert np.array_equal(take(FastEngine(), model, light, roi=alone), own)


def test_without_noise_the_events_are_those_of_the_reference_engine() -> None:
    model = dataclasses.replace(DEFAULT, noise_rms=0.0)
    light = square(0.5)
    expected = take(ReferenceEngine(), model, light)
    assert len(expected) > 100
    assert np.array_equal(take(FastEngine(), model, light, seed=9), expected)


def test_without_noise_no_answer_to_a_flash_is_missed() -> None:
    """The output of two low-passes goes up and down again within less than the time constant of the slower one."""
    model = PixelModel(noise_rms=0.0, corner_hz=50.0, theta_on=0.095, theta_off=0.095) + PhotoreceptorBandwidth(
        hz_per_fa=1e4, max_hz=400.0
    )
    light = LightHistory(np.array([0.0, 0.02, 0.02012]), LUX * np.exp([0.0, 4.0, 0.0]))
    roi = Roi(10, 20, 2, 2)
    expected = take(ReferenceEngine(), model, light, roi)
    assert len(expected) >= roi.pixels
    assert np.array_equal(take(FastEngine(), model, light, roi), expected)


@pytest.mark.parametrize("corner_hz", [200.0, 2000.0])
def test_the_hazards_of_both_sides_add_up(corner_hz: float) -> None:
    """Two barriers, solved as such, against the sum of the table's two."""
    from scipy.special import ndtr

    rho = math.exp(-2.0 * math.pi * corner_hz * 1e-5)
    table = hazard_table(rho)
    for high, low in ((4.0, -4.0), (3.0, -5.0), (2.0, -6.0)):
        x, mass = quasi_stationary(low, high, rho)
        s = math.sqrt(1.0 - rho * rho)
        leaves = float((ndtr((rho * x - high) / s) + ndtr((low - rho * x) / s)) @ mass)
        barriers = np.array([high, -low])
        hazards = np.exp(table.log_rate[np.rint(10.0 * (barriers - 1.0)).astype(int)] - 0.5 * barriers**2)
        assert -math.log1p(-leaves) == pytest.approx(hazards.sum(), rel=2e-3)


#: Effects whose pixels are left to the reference engine.
LEFT = {"high_pass"}
SIZES: dict[str, dict[str, float]] = {
    "hot_pixels": {"fraction": 1.0, "rate_hz": 5.0},
    "readout_saturation": {"max_rate_eps": 1e4, "fifo_events": 100.0},
    "event_rate_limit": {"max_rate_eps": 1e4, "period_s": 1e-3},
    "photoreceptor_bandwidth": {"hz_per_fa": 2.0, "max_hz": 1000.0},
}


@pytest.mark.parametrize("effect_id", sorted(effects()))
def test_what_the_fast_engine_cannot_walk_is_left_to_the_reference_engine(effect_id: str) -> None:
    cls = effects()[effect_id]
    effect = effect_from_dict(effect_id, SIZES[effect_id]) if effect_id in SIZES else cls()
    model = noisy(200.0, 1e-2) + effect
    light = dataclasses.replace(square(0.5), nd_od=3.0)
    fast, reference = (take(engine, model, light, Roi(10, 20, 4, 4)) for engine in (FastEngine(), ReferenceEngine()))
    assert len(reference) > 0
    assert np.array_equal(fast, reference) == (effect_id in LEFT)


def test_what_a_high_pass_takes_off_is_that_of_the_light() -> None:
    """The table of one dark current in two stretches, against the two filters of the textbook over all of it."""
    from scipy.signal import lfilter

    corner_hz, high_hz, dt_s, rms = 200.0, 20.0, 1e-4, 0.05
    rng = np.random.default_rng(5)
    starts = np.concatenate([[0], np.cumsum(rng.integers(300, 900, size=9))])
    light = LightHistory(starts * dt_s, LUX * np.exp(rng.normal(size=10)))
    model = dataclasses.replace(noisy(corner_hz, 1e-2), noise_rms=rms)
    chain = build_chain(model + effect_from_dict("high_pass", {"corner_hz": high_hz}), Roi(0, 0, 1, 1), 1)
    walk = OnePole(chain, light, dt_s, 1)
    samples = 2 * UNIT
    level = np.log(light.lux / light.lux[0]) / rms
    segment = np.searchsorted(starts, np.arange(samples), side="right") - 1
    rho, high = math.exp(-2.0 * math.pi * corner_hz * dt_s), math.exp(-2.0 * math.pi * high_hz * dt_s)
    passed = lfilter([1.0 - rho], [1.0, -rho], level[segment])
    expected = passed - lfilter([1.0 - high], [1.0, -high], passed)
    # The kernel forgets what was there at an edge, with the low-pass: what it held, less the settled level.
    for first, stop in ((1, UNIT), (UNIT, samples)):
        walk.prepare(first, stop)
        table, _, _, shift, _ = walk._moving.table
        for n in range(first, stop):
            k = segment[n]
            edge = starts[k] - 1 if k else 0
            left = (expected[edge] - level[k]) * rho ** (n - edge)
            assert level[k] + left + table[0, n - shift[k]] == pytest.approx(expected[n], abs=1e-9)


def test_an_injection_offset_moves_both_thresholds() -> None:
    light, roi = square(0.4), Roi(10, 20, 4, 4)
    model = noisy(200.0, 1e-2)
    moved = dataclasses.replace(model, theta_on=model.theta_on + 0.02, theta_off=model.theta_off - 0.02)
    offset = model + effect_from_dict("injection_offset", {"offset": 0.02})
    assert np.array_equal(take(FastEngine(), offset, light, roi), take(FastEngine(), moved, light, roi))


def test_an_event_of_the_far_future_is_still_a_number() -> None:
    """A pixel that hardly ever fires jumps to the end of its last segment: times the addresses, that is an event."""
    most_pixels = 1280 * 720
    assert LAST * most_pixels * 2 < np.iinfo(np.int64).max
    assert LAST * 1e-6 > 1e6  # s, at the finest grid: more than any recording
