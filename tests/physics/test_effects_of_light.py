"""Effects of the light, the photocurrent and the photoreceptor: their signature, and closed forms."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest

from protocols.points import Roi
from sim_backend.pixel import LightHistory, PixelModel, build_chain
from sim_backend.pixel.effects import (
    ContrastError,
    DarkCurrent,
    LightDrift,
    LightFlicker,
    NdError,
    PhotoreceptorBandwidth,
    ShotNoise,
)
from sim_backend.pixel.light_path import ChipLight

if TYPE_CHECKING:
    import numpy.typing as npt

    from tests.physics.conftest import Record

DT_S = 1e-5
FAST = PixelModel(noise_rms=0.0, corner_hz=5e4, theta_on=0.3, theta_off=0.3, refractory_s=0.0)
Q_FA_S = 1.602176634e-4  # elementary charge
ROI = Roi(0, 0, 16, 8)


def step(log_contrast: float, lux: float = 10.0, at_s: float = 0.01, nd_od: float = 0.0) -> LightHistory:
    return LightHistory(np.array([0.0, at_s]), lux * np.exp([0.0, log_contrast]), nd_od=nd_od)


def times_s(events: npt.NDArray[np.void], polarity: int = 1) -> npt.NDArray[np.float64]:
    return np.asarray(events["t"][events["p"] == polarity] * 1e-6)


# light_flicker


@pytest.mark.effect("light_flicker", shows="closed_form")
def test_flicker_fires_where_the_ripple_crosses_the_threshold(record: Record) -> None:
    """From phase 0 the level is memorised at u = 0: ON where ``ln(1 + depth sin x) = theta``."""
    model = FAST + LightFlicker(depth=0.5, frequency_hz=100.0, phase=0.0)
    expected_s = math.asin((math.exp(0.3) - 1.0) / 0.5) / (2.0 * math.pi * 100.0)
    events = record(model, 10.0, 0.1)
    assert events["p"][0] == 1
    assert events["t"][0] * 1e-6 == pytest.approx(expected_s, abs=2.0 * DT_S)
    later = record(FAST + LightFlicker(depth=0.5, frequency_hz=100.0, phase=math.pi / 2.0), 10.0, 0.1)
    assert later["p"][0] == 0  # from the crest it goes down


@pytest.mark.effect("light_flicker", shows="closed_form")
@pytest.mark.parametrize(("settled_hz", "memorised"), [(100.0, -0.5), (1e6, 0.0), (1e-3, 0.0)])
def test_pixels_had_settled_to_a_ripple_behind_a_low_pass(
    record: Record, settled_hz: float, memorised: float
) -> None:
    """Of sin(0) a low-pass of the ripple's frequency leaves ``cos(45 deg) sin(-45 deg)``; ON from there on."""
    model = FAST + LightFlicker(depth=0.5, frequency_hz=100.0, phase=0.0, settled_hz=settled_hz)
    crossing = (1.0 + 0.5 * memorised) * math.exp(0.3) - 1.0
    expected_s = math.asin(crossing / 0.5) / (2.0 * math.pi * 100.0)
    assert record(model, 10.0, 0.1)["t"][0] * 1e-6 == pytest.approx(expected_s, abs=3.0 * DT_S)


@pytest.mark.effect("light_flicker", shows="closed_form")
def test_a_ripple_that_went_on_before_makes_no_events_when_the_recording_begins() -> None:
    """The follower's output is a wave from the first sample on; settled to the light of t = 0 it has to get there."""
    corner_hz, at = 200.0, DT_S * np.arange(1, 2001)
    pixel = PixelModel(noise_rms=0.0, corner_hz=corner_hz)
    ends = []
    for settled_hz in (corner_hz, None):
        ripple = LightFlicker(depth=0.01, frequency_hz=100.0, phase=math.pi / 2.0, settled_hz=settled_hz)
        lux = ChipLight(build_chain(pixel + ripple, Roi(0, 0, 1, 1), 0), LightHistory.constant(10.0), DT_S, 1)
        light = np.log(lux.lux(0, 2001))
        v = [light[0]]
        for u in light[1:]:
            v.append(u + (v[-1] - u) * math.exp(-2.0 * math.pi * corner_hz * DT_S))
        lag = math.atan(0.5)
        wave = math.log(10.0) + 0.01 * math.cos(lag) * np.cos(2.0 * math.pi * 100.0 * at - lag)
        ends.append(np.max(np.abs(np.array(v[1:]) - wave)))
    # Half of the square of the depth is what the logarithm bends, and a sample of the wave's slope.
    assert ends[0] < 0.5e-4 + 0.01 * 2.0 * math.pi * 100.0 * DT_S
    assert ends[1] > 1e-3


@pytest.mark.effect("light_flicker", shows="signature")
def test_events_are_locked_to_the_flicker_and_each_recording_has_its_own_phase(record: Record) -> None:
    noisy = PixelModel(noise_rms=0.05, corner_hz=1000.0, refractory_s=1e-3)
    phases = []
    for seed in (1, 2, 3):
        t_s = times_s(record(noisy + LightFlicker(depth=0.15), 10.0, 0.5, wait_s=0.1, roi=ROI, seed=seed))
        locked = np.mean(np.exp(2j * math.pi * 100.0 * t_s))
        assert len(t_s) > 500
        assert abs(locked) > 0.5  # 0 without a preferred phase
        phases.append(float(np.angle(locked)))
    assert np.ptp(phases) > 0.1
    still = times_s(record(PixelModel(noise_rms=0.075, corner_hz=1000.0), 10.0, 0.5, wait_s=0.1, roi=ROI))
    assert abs(np.mean(np.exp(2j * math.pi * 100.0 * still))) < 4.0 / math.sqrt(len(still))


# light_drift


@pytest.mark.effect("light_drift", shows="signature")
@pytest.mark.effect("light_drift", shows="closed_form")
@pytest.mark.parametrize(("rate_per_s", "polarity"), [(0.8, 1), (-0.5, 0)])
def test_drift_gives_events_of_one_polarity_at_equal_ratios(record: Record, rate_per_s: float, polarity: int) -> None:
    """``ln(1 + rate t)`` passes a multiple of theta at each event."""
    events = record(FAST + LightDrift(rate_per_s=rate_per_s), 10.0, 1.5)
    sign = 1 if polarity else -1
    expected_s = [(math.exp(sign * 0.3 * k) - 1.0) / rate_per_s for k in range(1, len(events) + 1)]
    assert len(events) == math.floor(sign * math.log(1.0 + rate_per_s * 1.5) / 0.3)
    assert np.all(events["p"] == polarity)
    assert events["t"] * 1e-6 == pytest.approx(expected_s, abs=1e-4)
    dark = FAST + LightDrift(rate_per_s=rate_per_s) + DarkCurrent(mean_fa=5000.0)
    assert len(record(dark, 10.0, 1.5)) == 0


# nd_error


@pytest.mark.effect("nd_error", shows="signature")
@pytest.mark.effect("nd_error", shows="closed_form")
@pytest.mark.parametrize(("nd_od", "error"), [(3.0, 0.1), (3.0, -0.1), (0.0, 0.1)])
def test_an_nd_error_moves_low_light_curves_only_where_a_filter_is_in(
    record: Record, nd_od: float, error: float
) -> None:
    """ON needs ``ln(e^theta + (E_d / E) (e^theta - 1))``; E is what the filter really lets through."""
    model = FAST + DarkCurrent(mean_fa=5.0) + NdError(delta_od=error)
    lux = 0.2
    true_lux = lux * (10.0**-error if nd_od > 0.0 else 1.0)
    dark_lux = 5.0 / model.photoconversion.gain_fa_per_lux
    needed = math.log(math.exp(0.3) + dark_lux / true_lux * (math.exp(0.3) - 1.0))
    answers = [len(record(model, step(f * needed, lux, nd_od=nd_od), 0.02)) for f in (0.995, 1.005)]
    assert answers == [0, 1]


@pytest.mark.effect("nd_error", shows="signature")
def test_an_nd_error_is_invisible_on_an_ideal_pixel(record: Record) -> None:
    light = step(0.7, 0.2, nd_od=3.0)
    assert np.array_equal(record(FAST + NdError(delta_od=0.3), light, 0.02), record(FAST, light, 0.02))


# contrast_error


@pytest.mark.effect("contrast_error", shows="signature")
@pytest.mark.effect("contrast_error", shows="closed_form")
@pytest.mark.parametrize("gain_error", [0.25, -0.2])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_contrast_error_scales_the_log_contrast(record: Record, gain_error: float, sign: int) -> None:
    model = FAST + ContrastError(gain_error=gain_error)
    for lux in (0.1, 1000.0):
        answers = [len(record(model, step(sign * f * 0.3 / (1.0 + gain_error), lux), 0.02)) for f in (0.995, 1.005)]
        assert answers == [0, 1]


# shot_noise


@pytest.mark.effect("shot_noise", shows="closed_form")
def test_shot_noise_has_the_rms_of_its_closed_form(record: Record) -> None:
    """Behind one low-pass ``rms^2 = factor q / (2 I tau)``: as many events as with light-independent noise of it."""
    base = PixelModel(noise_rms=0.0, corner_hz=500.0, refractory_s=5e-3)
    tau_s = 1.0 / (2.0 * math.pi * 500.0)
    lux, factor = 0.5, 0.28
    current_fa = base.photoconversion.gain_fa_per_lux * lux
    rms = math.sqrt(factor * Q_FA_S / (2.0 * current_fa * tau_s))
    assert 3.0 < 0.3 / rms < 5.0
    shot = record(base + ShotNoise(factor=factor), lux, 4.0, wait_s=0.5, roi=ROI)
    counts = {}
    for f in (0.97, 1.03):
        floor = PixelModel(noise_rms=f * rms, corner_hz=500.0, refractory_s=5e-3)
        counts[f] = len(record(floor, lux, 4.0, wait_s=0.5, roi=ROI, seed=2))
    error = 2.0 * math.sqrt(len(shot))
    assert counts[0.97] + error < len(shot) < counts[1.03] - error
    on = int(np.sum(shot["p"] == 1))
    assert on == pytest.approx(len(shot) / 2, abs=2.0 * math.sqrt(len(shot)))


@pytest.mark.effect("shot_noise", shows="signature")
def test_shot_noise_grows_as_the_light_falls(record: Record) -> None:
    model = PixelModel(noise_rms=0.0, corner_hz=500.0, refractory_s=1e-3) + ShotNoise()
    counts = [len(record(model, lux, 0.5, roi=ROI)) for lux in (10.0, 2.0, 1.2, 0.8)]
    assert counts[0] == 0
    assert 3 * counts[1] < counts[2]
    assert 3 * counts[2] < counts[3]


@pytest.mark.effect("photoreceptor_bandwidth", shows="signature")
def test_behind_the_photoreceptor_shot_noise_is_alike_at_every_light(record: Record) -> None:
    """With the corner c I the rms is sqrt(factor pi c q), and only the rate of events scales with the light."""
    model = PixelModel(noise_rms=0.0, corner_hz=4e4, refractory_s=0.0)
    hz_per_fa = (0.3 / 3.5) ** 2 / (math.pi * Q_FA_S)
    model += ShotNoise()
    model += PhotoreceptorBandwidth(hz_per_fa=hz_per_fa, max_hz=math.inf)
    lux = np.array([50.0, 100.0]) / hz_per_fa / model.photoconversion.gain_fa_per_lux
    slow, fast = (len(record(model, e, d, roi=ROI)) for e, d in zip(lux, (2.0, 1.0), strict=True))
    assert slow > 500
    # The grid of 10 us makes the barriers higher by 0.58 sigma sqrt(2 dt / tau), the fast one's more.
    assert fast == pytest.approx(0.93 * slow, rel=0.12)


# photoreceptor_bandwidth


@pytest.mark.effect("photoreceptor_bandwidth", shows="signature")
@pytest.mark.effect("photoreceptor_bandwidth", shows="closed_form")
@pytest.mark.parametrize("lux", [0.2, 1.0, 5.0])
def test_the_latency_falls_as_one_over_the_light(record: Record, lux: float) -> None:
    """A step of ``theta / (1 - 1/e)`` is answered after one time constant, ``1 / (2 pi hz_per_fa I)``."""
    model = FAST + PhotoreceptorBandwidth(hz_per_fa=2.0, max_hz=1e5)
    contrast = 0.3 / (1.0 - math.exp(-1.0))
    current_fa = model.photoconversion.gain_fa_per_lux * lux * math.exp(contrast)
    events = record(model, step(contrast, lux), 0.3)
    expected_s = 1.0 / (2.0 * math.pi * 2.0 * current_fa)
    assert events["t"][0] * 1e-6 - 0.01 == pytest.approx(expected_s, abs=3.0 * DT_S)


@pytest.mark.effect("photoreceptor_bandwidth", shows="closed_form")
def test_the_corner_is_limited_and_counts_the_dark_current(record: Record) -> None:
    contrast = 0.3 / (1.0 - math.exp(-1.0))
    bright = FAST + PhotoreceptorBandwidth(hz_per_fa=2.0, max_hz=100.0)
    assert record(bright, step(contrast, 1e4), 0.1)["t"][0] * 1e-6 - 0.01 == pytest.approx(
        1.0 / (2.0 * math.pi * 100.0), abs=3.0 * DT_S
    )
    lit_fa = FAST.photoconversion.gain_fa_per_lux * 0.1
    total_fa = math.exp(contrast) * (lit_fa + 20.0)  # the step that makes the log of the total rise by `contrast`
    light = LightHistory(np.array([0.0, 0.01]), 0.1 * np.array([1.0, (total_fa - 20.0) / lit_fa]))
    dark = FAST + DarkCurrent(mean_fa=20.0) + PhotoreceptorBandwidth(hz_per_fa=2.0, max_hz=1e5)
    expected_s = 1.0 / (2.0 * math.pi * 2.0 * total_fa)
    assert record(dark, light, 0.1)["t"][0] * 1e-6 - 0.01 == pytest.approx(expected_s, abs=3.0 * DT_S)


@pytest.mark.effect("photoreceptor_bandwidth", shows="signature")
@pytest.mark.effect("photoreceptor_bandwidth", shows="closed_form")
@pytest.mark.parametrize("pulse_s", [0.005, 0.02])
def test_a_short_pulse_needs_more_contrast(record: Record, pulse_s: float) -> None:
    """With a corner that does not move, ``theta / (1 - exp(-2 pi f T))``."""
    model = FAST + PhotoreceptorBandwidth(hz_per_fa=1e4, max_hz=20.0)
    needed = 0.3 / (1.0 - math.exp(-2.0 * math.pi * 20.0 * pulse_s))
    answers = []
    for f in (0.99, 1.01):
        light = LightHistory(np.array([0.0, 0.01, 0.01 + pulse_s]), 10.0 * np.exp([0.0, f * needed, 0.0]))
        answers.append(int(np.sum(record(model, light, 0.2)["p"] == 1)))
    assert answers == [0, 1]
