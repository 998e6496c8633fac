"""Without noise: where the response curve steps, and when the event comes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest

from sim_backend.pixel import LightHistory, Photoconversion, PixelModel
from sim_backend.pixel.effects import DarkCurrent, StrayLight

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    from sim_backend.pixel.effects import Effect
    from tests.physics.conftest import Record

    Floats = npt.NDArray[np.float64]
    Stimulus = Callable[[float, int], tuple[LightHistory, Floats, float]]

THETA = 0.3
BASELINE_LUX = 10.0
# Contrasts half a per cent apart, with the threshold in the middle of the middle gap.
CONTRASTS = THETA * (1.0 + 0.005 * np.arange(-3.5, 4.0))
PERIODS = 5


def periodic(parts: list[tuple[float, float]], periods: int) -> tuple[LightHistory, Floats, float]:
    """Return a light made of (seconds, lux) parts, when its last part starts, and the whole duration."""
    length_s = sum(s for s, _ in parts)
    starts = np.cumsum([0.0] + [s for s, _ in parts[:-1]])
    t_s = (np.arange(periods)[:, None] * length_s + starts).ravel()
    lux = np.tile([level for _, level in parts], periods)
    return LightHistory(t_s, lux), np.arange(periods) * length_s + starts[-1], periods * length_s


def square(log_contrast: float, sign: int) -> tuple[LightHistory, Floats, float]:
    """5 Hz, half of the period each; the tested step has the sign of `sign`."""
    return periodic([(0.1, BASELINE_LUX), (0.1, BASELINE_LUX * math.exp(sign * log_contrast))], PERIODS)


def reset_test(log_contrast: float, sign: int) -> tuple[LightHistory, Floats, float]:
    """Reset of 50 % for 0.4 s in the direction of the test pulse of 0.2 s, and gaps of 0.1 s before each."""
    reset = BASELINE_LUX * 1.5**sign
    test = BASELINE_LUX * math.exp(sign * log_contrast)
    return periodic([(0.1, BASELINE_LUX), (0.4, reset), (0.1, BASELINE_LUX), (0.2, test)], PERIODS)


def responses(events: npt.NDArray[np.void], starts_s: Floats, window_s: float, sign: int) -> npt.NDArray[np.bool_]:
    """Return for each window whether it has an event of the tested polarity."""
    t_s = events["t"][events["p"] == (1 if sign > 0 else 0)] * 1e-6
    return np.array([np.any((t_s >= s) & (t_s < s + window_s)) for s in starts_s])


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("stimulus", "window_s"), [(square, 0.1), (reset_test, 0.2)])
@pytest.mark.parametrize(("corner_hz", "refractory_s"), [(2000.0, 1e-2), (200.0, 1e-2), (50.0, 2e-2)])
def test_the_curve_steps_at_the_threshold(
    record: Record, stimulus: Stimulus, window_s: float, corner_hz: float, refractory_s: float, sign: int
) -> None:
    model = PixelModel(noise_rms=0.0, corner_hz=corner_hz, theta_on=THETA, theta_off=THETA, refractory_s=refractory_s)
    for contrast in CONTRASTS:
        light, starts_s, duration_s = stimulus(contrast, sign)
        answered = responses(record(model, light, duration_s), starts_s, window_s, sign)
        assert np.all(answered == (contrast > THETA)), contrast


def test_a_square_wave_shows_only_the_less_sensitive_threshold(record: Record) -> None:
    model = PixelModel(noise_rms=0.0, corner_hz=2000.0, theta_on=0.25, theta_off=0.35, refractory_s=1e-2)
    for sign in (1, -1):
        for contrast, expected in ((0.30, False), (0.349, False), (0.352, True)):
            light, starts_s, duration_s = square(contrast, sign)
            answered = responses(record(model, light, duration_s), starts_s, 0.1, sign)
            # The very first step finds the pixel armed at its level, whatever came before in later periods.
            assert np.all(answered[1:] == expected), (sign, contrast)


@pytest.mark.parametrize("corner_hz", [20.0, 200.0, 2000.0])
@pytest.mark.parametrize("sign", [1, -1])
def test_latency_of_a_step(record: Record, corner_hz: float, sign: int) -> None:
    """The low-pass passes theta at ``t = tau ln(c / (c - theta))``; the event is at a sample, so 10 us either way."""
    tau_s = 1.0 / (2.0 * math.pi * corner_hz)
    model = PixelModel(noise_rms=0.0, corner_hz=corner_hz, theta_on=THETA, theta_off=THETA, refractory_s=1.0)
    for contrast in (0.302, 0.35, 0.5, 1.0, 2.3):
        light = LightHistory(np.array([0.0, 0.01]), BASELINE_LUX * np.exp([0.0, sign * contrast]))
        events = record(model, light, 0.2)
        assert len(events) == 1
        assert events["p"][0] == (sign > 0)
        expected_s = tau_s * math.log(contrast / (contrast - THETA))
        assert events["t"][0] * 1e-6 - 0.01 == pytest.approx(expected_s, abs=1.01e-5)


@pytest.mark.parametrize("rise_tau_s", [3e-4, 5e-3])
def test_latency_behind_a_rising_light(record: Record, rise_tau_s: float) -> None:
    """With a fast pixel the event comes when the light has risen: ``e^theta = 1 + (r - 1)(1 - e^(-t/tau))``."""
    model = PixelModel(noise_rms=0.0, corner_hz=1e5, theta_on=THETA, theta_off=THETA, refractory_s=1.0)
    for ratio in (1.5, 3.0):
        light = LightHistory(np.array([0.0, 0.01]), BASELINE_LUX * np.array([1.0, ratio]), rise_tau_s)
        events = record(model, light, 0.1)
        expected_s = -rise_tau_s * math.log(1.0 - (math.exp(THETA) - 1.0) / (ratio - 1.0))
        # The pole of the pixel itself adds 1.6 us.
        assert events["t"][0] * 1e-6 - 0.01 == pytest.approx(expected_s + 1.6e-6, abs=1.1e-5)


E_D_LUX = 0.14626
GAIN = Photoconversion().gain_fa_per_lux
IN_THE_DARK = [DarkCurrent(mean_fa=E_D_LUX * GAIN), StrayLight(illuminance_lux=E_D_LUX)]


def answers(record: Record, effect: Effect, first_lux: float, then_lux: float, polarity: int) -> bool:
    """Return whether a step has an event of the polarity."""
    model = PixelModel(noise_rms=0.0, corner_hz=1000.0, theta_on=0.35, theta_off=0.35) + effect
    light = LightHistory(np.array([0.0, 0.01]), np.array([first_lux, then_lux]))
    return bool(np.any(record(model, light, 0.1)["p"] == polarity))


@pytest.mark.effect("dark_current", "stray_light", shows="signature")
@pytest.mark.effect("dark_current", "stray_light", shows="closed_form")
@pytest.mark.parametrize("effect", IN_THE_DARK, ids=lambda e: e.id)
@pytest.mark.parametrize(
    ("lux", "log_contrast"),
    [
        (0.076, 0.800),
        (0.100, 0.709),
        (0.152, 0.600),
        (0.200, 0.545),
        (0.304, 0.483),
        (0.600, 0.420),
        (3.0, 0.364),
        (30.0, 0.351),
    ],
)
def test_dark_current_raises_the_contrast_that_is_needed(
    record: Record, effect: Effect, lux: float, log_contrast: float
) -> None:
    """``c = ln(e^theta + (E_d / E)(e^theta - 1))`` at theta = 0.35; the table is to three decimals."""
    assert not answers(record, effect, lux, lux * math.exp(log_contrast - 1e-3), 1)
    assert answers(record, effect, lux, lux * math.exp(log_contrast + 1e-3), 1)


@pytest.mark.effect("dark_current", "stray_light", shows="closed_form")
@pytest.mark.parametrize("effect", IN_THE_DARK, ids=lambda e: e.id)
def test_near_the_dark_limit_no_off_event_is_possible(record: Record, effect: Effect) -> None:
    """From below ``E_d (e^theta - 1)`` = 61.3 mlux even darkness is no OFF event."""
    limit_lux = E_D_LUX * (math.exp(0.35) - 1.0)
    assert limit_lux == pytest.approx(0.0613, abs=5e-5)
    assert not answers(record, effect, 0.999 * limit_lux, 0.0, 0)
    assert answers(record, effect, 1.001 * limit_lux, 0.0, 0)
