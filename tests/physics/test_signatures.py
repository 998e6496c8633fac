"""Signatures of effects in what can be measured, where the closed forms elsewhere do not show them."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING

import numpy as np
import pytest

from protocols.points import Roi
from sim_backend.pixel import LightHistory, PixelModel
from sim_backend.pixel.effects import (
    DarkCurrent,
    HotPixels,
    Leak,
    LightDrift,
    LightFlicker,
    LightRiseTime,
    LowFrequencyNoise,
    ParasiticPhotocurrent,
    RefractoryMismatch,
    ResetNoise,
    ShotNoise,
    StrayLight,
)

if TYPE_CHECKING:
    import numpy.typing as npt

    from sim_backend.pixel.effects import Effect
    from tests.physics.conftest import Record

DT_S = 1e-5
THETA = 0.3
FAST = PixelModel(noise_rms=0.0, corner_hz=5e4, theta_on=THETA, theta_off=THETA, refractory_s=0.0)
ROI = Roi(0, 0, 32, 16)
SMALL = Roi(0, 0, 16, 8)


def step(log_contrast: float, lux: float = 10.0, at_s: float = 0.01) -> LightHistory:
    return LightHistory(np.array([0.0, at_s]), lux * np.exp([0.0, log_contrast]))


def pixels_of(events: npt.NDArray[np.void], roi: Roi = ROI) -> npt.NDArray[np.int64]:
    """Return the number of the pixel of each event."""
    return np.asarray(events["y"].astype(np.int64) * roi.width + events["x"])


def counts(events: npt.NDArray[np.void]) -> npt.NDArray[np.int64]:
    """Return the events of each pixel of `ROI`."""
    return np.bincount(pixels_of(events), minlength=ROI.pixels)


def share(events: npt.NDArray[np.void], polarity: int) -> float:
    """Return the share of pixels with an event of the polarity."""
    return float(np.mean(counts(events[events["p"] == polarity]) > 0))


def answers_of(events: npt.NDArray[np.void], sign: int) -> int:
    """Return how many events of the tested polarity one pixel sent."""
    return int(np.sum(events["p"] == (1 if sign > 0 else 0)))


@pytest.mark.effect("light_rise_time", shows="signature")
@pytest.mark.effect("light_rise_time", shows="closed_form")
def test_a_rise_time_delays_all_lights_alike_and_small_contrasts_more(record: Record) -> None:
    """The threshold is passed when ``e^theta = 1 + (e^c - 1)(1 - exp(-t / tau))``."""
    tau_s = 1e-3
    grown: dict[float, list[float]] = {}
    for contrast in (0.35, 1.0):
        for lux in (0.1, 10.0, 1000.0):
            without, risen = (record(m, step(contrast, lux), 0.05) for m in (FAST, FAST + LightRiseTime(tau_s=tau_s)))
            grown.setdefault(contrast, []).append((int(risen["t"][0]) - int(without["t"][0])) * 1e-6)
    for contrast, growth_s in grown.items():
        expected_s = -tau_s * math.log(1.0 - (math.exp(THETA) - 1.0) / (math.exp(contrast) - 1.0))
        assert growth_s == pytest.approx([expected_s] * 3, abs=2.0 * DT_S)
    assert min(grown[0.35]) > 3.0 * max(grown[1.0])


@pytest.mark.effect("light_drift", shows="signature")
def test_with_a_drift_early_and_late_pulses_differ_only_near_the_dark_limit(record: Record) -> None:
    """A reset before each pulse leaves the drift no time; the pulse needs what the light of its moment asks for."""
    model = dataclasses.replace(FAST, refractory_s=1e-3) + DarkCurrent(mean_fa=5.0) + LightDrift(rate_per_s=1.0)
    dark_lux = 5.0 / model.photoconversion.gain_fa_per_lux
    parts_s, periods = np.array([0.0, 0.01, 0.02, 0.03]), 25
    starts_s = (0.04 * np.arange(periods)[:, None] + parts_s).ravel()
    for lux, differs in ((0.1, True), (100.0, False)):
        needed = [math.log(math.exp(THETA) + dark_lux / e * (math.exp(THETA) - 1.0)) for e in (lux, 2.0 * lux)]
        contrast = 0.5 * (needed[0] + needed[1]) if differs else needed[0] + 0.02
        light = LightHistory(starts_s, lux * np.tile([1.0, 20.0, 1.0, math.exp(contrast)], periods))
        events = record(model, light, 0.04 * periods)
        on_us = events["t"][events["p"] == 1]
        answered = [bool(np.any((on_us >= s) & (on_us < s + 10_000))) for s in np.rint(starts_s[3::4] * 1e6)]
        assert answered[-5:] == [True] * 5
        assert answered[:5] == [not differs] * 5


@pytest.mark.effect("shot_noise", shows="signature")
@pytest.mark.parametrize("sign", [1, -1])
def test_shot_noise_broadens_both_curves_as_the_light_falls(record: Record, sign: int) -> None:
    """A step a fifth below the threshold: hardly ever answered in bright light, more and more often as it falls."""
    model = PixelModel(noise_rms=0.0, corner_hz=200.0, refractory_s=5e-3) + ShotNoise()
    polarity = 1 if sign > 0 else 0
    shares = [
        share(record(model, step(sign * 0.8 * THETA, lux), 0.05, roi=ROI), polarity) for lux in (200.0, 10.0, 3.0)
    ]
    error = 4.0 * math.sqrt(0.25 * 2.0 / ROI.pixels)
    assert shares[0] == 0.0
    assert shares[1] > 0.1
    assert shares[2] > shares[1] + error


@pytest.mark.effect("low_frequency_noise", shows="signature")
def test_slow_noise_repeats_polarities_and_fast_noise_alternates(record: Record) -> None:
    """A slow walk forgets from which side it came; fast noise returns to its mean, through the other threshold."""
    shares = []
    for model in (
        dataclasses.replace(FAST, noise_rms=0.08, corner_hz=2000.0),
        FAST + LowFrequencyNoise(rms=1.0, tau_s=1.0),
    ):
        events = record(model, 10.0, 2.0, roi=SMALL)
        pixel = pixels_of(events, SMALL)
        order = np.lexsort((events["t"], pixel))
        same = np.diff(events["p"][order].astype(np.int64))[np.diff(pixel[order]) == 0] == 0
        assert len(same) > 500
        shares.append(float(np.mean(same)))
    assert shares[0] < 0.1
    assert shares[1] > 0.3


@pytest.mark.effect("parasitic_photocurrent", shows="signature")
@pytest.mark.effect("leak", shows="signature")
@pytest.mark.parametrize(
    ("effect", "lux", "rate_per_s"),
    [
        (Leak(rate_per_s=2.0), 1.0, 2.0),
        (Leak(rate_per_s=2.0), 100.0, 2.0),
        (ParasiticPhotocurrent(rate_per_s_per_lux=0.1), 10.0, 1.0),
        (ParasiticPhotocurrent(rate_per_s_per_lux=0.1), 20.0, 2.0),
    ],
)
def test_leaks_move_on_curves_left_and_off_curves_right(
    record: Record, effect: Effect, lux: float, rate_per_s: float
) -> None:
    """After 0.05 s the way to ON is shorter, and to OFF longer, by what has leaked."""
    for sign in (1, -1):
        needed = THETA - sign * 0.05 * rate_per_s
        answers = [
            answers_of(record(FAST + effect, step(sign * f * needed, lux, 0.05), 0.0502), sign) for f in (0.99, 1.01)
        ]
        assert answers == [0, 1]


@pytest.mark.effect("reset_noise", shows="signature")
def test_reset_noise_broadens_the_curve_of_a_slow_pixel_too(record: Record) -> None:
    """A pixel of 50 Hz that has settled answers with ``Phi((c - theta) / rms)``: 0.16 and 0.84 at one rms off."""
    model = dataclasses.replace(FAST, corner_hz=50.0, refractory_s=0.1) + ResetNoise(rms=0.03)
    for c, expected in ((0.27, 0.1587), (0.33, 0.8413)):
        found = share(record(model, step(c, at_s=1e-3), 0.06, roi=ROI), 1)
        assert found == pytest.approx(expected, abs=4.0 * math.sqrt(0.1587 * 0.8413 / ROI.pixels))


@pytest.mark.effect("refractory_mismatch", shows="signature")
def test_with_unequal_dead_times_pixels_answer_a_large_step_unequally_often(record: Record) -> None:
    """Behind 20 Hz a step of 2.5 is climbed in several events; who is blind for longer sends fewer."""
    model = dataclasses.replace(FAST, corner_hz=20.0, refractory_s=2e-3)
    alike, unequal = (record(m, step(2.5), 0.1, roi=ROI) for m in (model, model + RefractoryMismatch(spread=0.5)))
    assert np.ptp(counts(alike)) == 0
    found = counts(unequal)
    assert np.ptp(found) > 2
    times_us = [unequal["t"][pixels_of(unequal) == i] for i in range(ROI.pixels)]
    shortest_us = np.array([np.diff(t_us).min() for t_us in times_us])
    assert np.corrcoef(shortest_us, found)[0, 1] < -0.7  # the longer the interval, the fewer events


@pytest.mark.effect("dark_current", "stray_light", shows="signature")
def test_stray_light_and_its_dark_current_are_the_same_at_the_pixel(record: Record) -> None:
    model = PixelModel(noise_rms=0.06, corner_hz=500.0)
    stray_lux = 0.1
    dark_fa = stray_lux * model.photoconversion.gain_fa_per_lux
    light = step(0.8, 0.1)
    stray, dark = (
        record(model + e, light, 0.1, roi=ROI)
        for e in (StrayLight(illuminance_lux=stray_lux), DarkCurrent(mean_fa=dark_fa))
    )
    assert len(stray) > ROI.pixels / 2
    assert np.array_equal(stray, dark)


@pytest.mark.parametrize(
    "effect",
    [
        LightFlicker(depth=0.0, frequency_hz=100.0),
        DarkCurrent(mean_fa=0.0, spread=0.4),
        LowFrequencyNoise(rms=0.0, tau_s=0.3),
        Leak(rate_per_s=0.0, spread=0.4),
        HotPixels(fraction=0.0, rate_hz=100.0),
        HotPixels(fraction=0.5, rate_hz=0.0),
    ],
    ids=lambda e: e.id,
)
def test_the_strength_alone_at_its_null_value_changes_no_event(record: Record, effect: Effect) -> None:
    """Whatever the other parameters are."""
    model = PixelModel(noise_rms=0.08, corner_hz=500.0)
    expected = record(model, step(0.5), 0.2, roi=ROI)
    assert len(expected) > ROI.pixels
    assert np.array_equal(record(model + effect, step(0.5), 0.2, roi=ROI), expected)
