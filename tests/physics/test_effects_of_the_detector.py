"""Effects behind the photoreceptor, up to the readout: their signature, and closed forms."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.special import ndtr

from protocols.points import Roi
from sim_backend.pixel import LightHistory, PixelModel
from sim_backend.pixel.effects import (
    ComparatorDelay,
    Crosstalk,
    EventRateLimit,
    HighPass,
    HotPixels,
    InjectionOffset,
    Leak,
    LightDrift,
    LowFrequencyNoise,
    ParasiticPhotocurrent,
    ReadoutSaturation,
    RefractoryMismatch,
    ResetNoise,
    ThresholdMismatch,
    TimestampJitter,
    TrailFilter,
)

if TYPE_CHECKING:
    import numpy.typing as npt

    from sim_backend.pixel.effects import Effect
    from tests.physics.conftest import Record

    Floats = npt.NDArray[np.float64]

DT_S = 1e-5
FAST = PixelModel(noise_rms=0.0, corner_hz=5e4, theta_on=0.3, theta_off=0.3, refractory_s=0.0)
ROI = Roi(0, 0, 16, 8)
MANY = Roi(0, 0, 64, 32)


def step(log_contrast: float, lux: float = 10.0, at_s: float = 0.01) -> LightHistory:
    return LightHistory(np.array([0.0, at_s]), lux * np.exp([0.0, log_contrast]))


def by_pixel(events: npt.NDArray[np.void], roi: Roi) -> list[Floats]:
    """Return the times (s) of the events of each pixel."""
    pixel = events["y"].astype(int) * roi.width + events["x"]
    return [events["t"][pixel == i] * 1e-6 for i in range(roi.pixels)]


# low_frequency_noise


@pytest.mark.effect("low_frequency_noise", shows="closed_form")
@pytest.mark.slow
def test_slow_noise_has_its_rms_and_correlation(record: Record) -> None:
    """A pixel with tiny thresholds follows it: ``mean (w(t + s) - w(t))^2 = 2 rms^2 (1 - exp(-s / tau))``."""
    rms, tau_s, theta = 0.2, 0.05, 0.02
    model = dataclasses.replace(FAST, theta_on=theta, theta_off=theta) + LowFrequencyNoise(rms=rms, tau_s=tau_s)
    events = record(model, 10.0, 1.5, roi=MANY)
    stride = theta + 0.58 * rms * math.sqrt(2.0 * DT_S / tau_s)  # an event comes a part of a sample's step late
    grid_s = np.arange(0.1, 1.5, 0.005)
    pixel = events["y"].astype(int) * MANY.width + events["x"]
    bins = np.digitize(events["t"] * 1e-6, grid_s)
    steps = np.zeros((MANY.pixels, len(grid_s) + 1))
    np.add.at(steps, (pixel, bins), stride * (2.0 * events["p"] - 1.0))
    w = np.cumsum(steps, axis=1)
    for lag in (5, 10, 30):
        per_pixel = np.mean((w[:, lag:] - w[:, :-lag]) ** 2, axis=1)
        expected = 2.0 * rms**2 * (1.0 - math.exp(-lag * 0.005 / tau_s))
        error = per_pixel.std() / math.sqrt(MANY.pixels)
        assert error < 0.02 * expected
        assert per_pixel.mean() == pytest.approx(expected, rel=0.03 + 4.0 * error / expected)


@pytest.mark.effect("low_frequency_noise", shows="signature")
def test_slow_noise_makes_no_bursts(record: Record) -> None:
    """Fast noise crosses again right after a dead time; slow noise has to go a whole threshold first."""
    shares = []
    for model in (
        dataclasses.replace(FAST, noise_rms=0.08, corner_hz=2000.0, refractory_s=1e-4),
        dataclasses.replace(FAST, refractory_s=1e-4) + LowFrequencyNoise(rms=0.5, tau_s=1.0),
    ):
        events = record(model, 10.0, 2.0, roi=ROI)
        gaps = np.concatenate([np.diff(t_s) for t_s in by_pixel(events, ROI)])
        assert len(gaps) > 100
        shares.append(np.mean(gaps < 5e-4))
    assert shares[1] < 0.05 < shares[0]


# high_pass


@pytest.mark.effect("high_pass", shows="closed_form")
def test_the_response_fades_as_an_exponential(record: Record) -> None:
    """After a step c the signal is ``c exp(-w t)``; memorised after the dead time, it falls by theta_off at t."""
    c, w, theta_off, dead_s = 0.6, 2.0 * math.pi * 2.0, 0.2, 1e-2
    model = dataclasses.replace(FAST, theta_off=theta_off, refractory_s=dead_s) + HighPass(corner_hz=2.0)
    events = record(model, step(c), 0.4)
    assert events["p"].tolist()[:2] == [1, 0]
    expected_s = -math.log(math.exp(-w * dead_s) - theta_off / c) / w
    assert events["t"][1] * 1e-6 - 0.01 == pytest.approx(expected_s, abs=5e-4)
    assert record(dataclasses.replace(model, effects=()), step(c), 0.4)["p"].tolist() == [1]


@pytest.mark.effect("high_pass", shows="signature")
def test_a_slow_change_is_not_seen_behind_the_high_pass(record: Record) -> None:
    ramp = FAST + LightDrift(rate_per_s=0.5)
    assert len(record(ramp, 10.0, 1.5)) == 1
    assert len(record(ramp + HighPass(corner_hz=2.0), 10.0, 1.5)) == 0


# leak and parasitic_photocurrent


@pytest.mark.effect("leak", "parasitic_photocurrent", shows="signature")
@pytest.mark.effect("leak", "parasitic_photocurrent", shows="closed_form")
@pytest.mark.parametrize(
    ("effect", "lux", "rate_per_s"),
    [
        (Leak(rate_per_s=5.0), 10.0, 5.0),
        (Leak(rate_per_s=5.0), 1.0, 5.0),
        (ParasiticPhotocurrent(rate_per_s_per_lux=0.5), 10.0, 5.0),
        (ParasiticPhotocurrent(rate_per_s_per_lux=0.5), 20.0, 10.0),
    ],
)
def test_a_leak_fires_on_events_like_a_clock(record: Record, effect: Effect, lux: float, rate_per_s: float) -> None:
    model = dataclasses.replace(FAST, refractory_s=2e-3)
    events = record(model + effect, lux, 1.0)
    assert np.all(events["p"] == 1)
    intervals_s = np.diff(events["t"] * 1e-6)
    assert len(intervals_s) > 10
    assert intervals_s == pytest.approx(0.3 / rate_per_s + 2e-3, abs=1.5 * DT_S)


@pytest.mark.effect("leak", shows="closed_form")
def test_leaks_are_log_normal_over_the_pixels(record: Record) -> None:
    events = record(FAST + Leak(rate_per_s=30.0, spread=0.3), 10.0, 0.3, roi=MANY)
    rates = np.array([0.3 / t_s[0] for t_s in by_pixel(events, MANY)])
    error = 0.3 / math.sqrt(MANY.pixels)
    assert np.median(rates) == pytest.approx(30.0, rel=4.0 * 1.26 * error)
    assert np.std(np.log(rates)) == pytest.approx(0.3, rel=4.0 / math.sqrt(2 * MANY.pixels))


@pytest.mark.effect("light_drift", shows="signature")
def test_a_drift_is_like_a_leak_of_its_rate(record: Record) -> None:
    drift, leak = (record(FAST + effect, 10.0, 0.5) for effect in (LightDrift(rate_per_s=1.0), Leak(rate_per_s=1.0)))
    assert np.all(drift["p"] == 1)
    assert len(drift) == len(leak) == 1
    assert drift["t"][0] == pytest.approx(leak["t"][0], rel=0.2)


# reset_noise, injection_offset, threshold_mismatch


@pytest.mark.effect("reset_noise", "threshold_mismatch", shows="signature")
@pytest.mark.effect("reset_noise", "threshold_mismatch", "injection_offset", shows="closed_form")
@pytest.mark.parametrize(
    ("effects", "width"),
    [
        ((ResetNoise(rms=0.03),), 0.03),
        ((ThresholdMismatch(sigma_on=0.03, sigma_off=0.03),), 0.03),
        ((ResetNoise(rms=0.03), ThresholdMismatch(sigma_on=0.04, sigma_off=0.04)), 0.05),
        ((InjectionOffset(offset=0.05), ResetNoise(rms=0.03)), 0.03),
    ],
)
@pytest.mark.parametrize("sign", [1, -1])
def test_curves_are_normal_and_widths_add_in_quadrature(
    record: Record, effects: tuple[Effect, ...], width: float, sign: int
) -> None:
    """An injected offset moves the ON curve to the right and the OFF curve to the left."""
    model = dataclasses.replace(FAST, refractory_s=0.1, effects=effects)
    offset = sum(e.offset for e in effects if isinstance(e, InjectionOffset))
    for lux in (0.1, 100.0):
        for contrast in (0.26, 0.3, 0.32):
            events = record(model, step(sign * contrast, lux, 0.001), 0.004, roi=MANY)
            expected = ndtr((contrast - 0.3 - sign * offset) / width)
            error = math.sqrt(expected * (1.0 - expected) / MANY.pixels)
            assert len(events) / MANY.pixels == pytest.approx(expected, abs=4.0 * error + 1e-3)
            assert np.all(events["p"] == (1 if sign > 0 else 0))


@pytest.mark.effect("reset_noise", "threshold_mismatch", shows="signature")
def test_reset_noise_differs_from_pulse_to_pulse_and_mismatch_does_not(record: Record) -> None:
    """Ten pulses at the threshold: with mismatch half of the pixels answer to each, with noise hardly any does."""
    edges_s = np.arange(0.0, 0.2, 0.01)
    light = LightHistory(edges_s, 10.0 * np.exp(0.3001 * (np.arange(len(edges_s)) % 2)))
    always = []
    for effect in (ThresholdMismatch(sigma_on=0.03, sigma_off=0.0), ResetNoise(rms=0.03)):
        model = dataclasses.replace(FAST, theta_off=0.2, refractory_s=1e-3) + effect
        events = record(model, light, 0.2, roi=MANY)
        counts = np.array([len(t_s) for t_s in by_pixel(events[events["p"] == 1], MANY)])
        always.append(float(np.mean(counts == 10)))
    assert always == pytest.approx([0.5, 0.0], abs=4.0 * 0.5 / math.sqrt(MANY.pixels))


@pytest.mark.effect("reset_noise", shows="signature")
def test_reset_noise_makes_few_noise_events(record: Record) -> None:
    assert len(record(FAST + ResetNoise(rms=0.05), 10.0, 0.5, roi=ROI)) == 0


@pytest.mark.effect("injection_offset", shows="signature")
@pytest.mark.parametrize("sign", [1, -1])
def test_an_injected_offset_moves_the_thresholds_in_opposite_directions(record: Record, sign: int) -> None:
    model = FAST + InjectionOffset(offset=0.05)
    needed = 0.3 + sign * 0.05
    answers = [len(record(model, step(sign * f * needed), 0.02)) for f in (0.995, 1.005)]
    assert answers == [0, 1]


# comparator_delay, refractory_mismatch


@pytest.mark.effect("comparator_delay", shows="signature")
@pytest.mark.effect("comparator_delay", shows="closed_form")
def test_a_delay_moves_every_event_by_the_same_time(record: Record) -> None:
    model = dataclasses.replace(FAST, corner_hz=100.0)
    for contrast in (0.4, 1.0):
        early = record(model, step(contrast), 0.1)
        late = record(model + ComparatorDelay(delay_s=1.23e-4), step(contrast), 0.1)
        assert late["t"][0] - early["t"][0] == 123
    # The pixel is reset later too, at the next sample: a clock of leak events gets slower by the delay.
    clock = record(FAST + Leak(rate_per_s=5.0) + ComparatorDelay(delay_s=1e-2), 10.0, 1.0)
    assert np.diff(clock["t"]) == pytest.approx(0.3 / 5.0 * 1e6 + 1e4, abs=15.0)


@pytest.mark.effect("refractory_mismatch", shows="closed_form")
def test_dead_times_are_log_normal_over_the_pixels(record: Record) -> None:
    """With a leak the interval is theta / rate plus the pixel's own dead time."""
    model = dataclasses.replace(FAST, refractory_s=1e-2) + Leak(rate_per_s=60.0) + RefractoryMismatch(spread=0.3)
    events = record(model, 10.0, 0.08, roi=MANY)
    dead_s = np.array([t_s[1] - t_s[0] - 0.3 / 60.0 for t_s in by_pixel(events, MANY)])
    error = 0.3 / math.sqrt(MANY.pixels)
    assert np.median(dead_s) == pytest.approx(1e-2, rel=4.0 * 1.26 * error)
    assert np.std(np.log(dead_s)) == pytest.approx(0.3, rel=4.0 / math.sqrt(2 * MANY.pixels))


# Readout


@pytest.mark.effect("hot_pixels", shows="signature")
def test_hot_pixels_fire_in_the_dark_and_nothing_else_does(record: Record) -> None:
    events = record(FAST + HotPixels(fraction=0.01, rate_hz=100.0), 0.0, 1.0, roi=MANY)
    pixels = {(int(x), int(y)) for x, y in zip(events["x"], events["y"], strict=True)}
    assert 8 <= len(pixels) <= 36  # 20 are expected
    assert np.all(events["p"] == 1)
    assert len(events) == pytest.approx(100.0 * len(pixels), abs=4.0 * math.sqrt(100.0 * len(pixels)))
    lit = record(FAST + HotPixels(fraction=0.01, rate_hz=100.0), 100.0, 1.0, roi=MANY)
    assert {(int(x), int(y)) for x, y in zip(lit["x"], lit["y"], strict=True)} == pixels


@pytest.mark.effect("readout_saturation", shows="signature")
@pytest.mark.effect("readout_saturation", shows="closed_form")
def test_the_queue_spreads_latencies_where_many_pixels_answer_at_once(record: Record) -> None:
    model = dataclasses.replace(FAST, refractory_s=0.1)
    quick = record(model, step(0.5), 0.1, roi=MANY)
    assert np.ptp(quick["t"]) == 0
    slow = record(model + ReadoutSaturation(max_rate_eps=1e5, fifo_events=1e4), step(0.5), 0.1, roi=MANY)
    assert len(slow) == MANY.pixels
    assert slow["t"][-1] - quick["t"][0] == pytest.approx(MANY.pixels * 10.0, abs=1.0)
    small = record(model + ReadoutSaturation(max_rate_eps=1e5, fifo_events=100.0), step(0.5), 0.1, roi=MANY)
    assert len(small) == 100
    few = record(model + ReadoutSaturation(max_rate_eps=1e5, fifo_events=100.0), step(0.5), 0.1, roi=Roi(0, 0, 5, 5))
    assert len(few) == 25


@pytest.mark.effect("timestamp_jitter", shows="signature")
@pytest.mark.effect("timestamp_jitter", shows="closed_form")
def test_jitter_scatters_latencies(record: Record) -> None:
    model = dataclasses.replace(FAST, refractory_s=0.1) + TimestampJitter(sigma_s=5e-5)
    t_us = record(model, step(0.5), 0.1, roi=MANY)["t"]
    assert len(t_us) == MANY.pixels
    assert t_us.std() == pytest.approx(50.0, rel=4.0 / math.sqrt(2 * MANY.pixels))
    without = record(dataclasses.replace(model, effects=()), step(0.5), 0.1)["t"][0]
    assert t_us.mean() == pytest.approx(without, abs=4.0 * 50.0 / math.sqrt(MANY.pixels))


@pytest.mark.effect("crosstalk", shows="signature")
def test_crosstalk_makes_pairs_in_neighbours_and_no_cascade(record: Record) -> None:
    model = dataclasses.replace(FAST, noise_rms=0.06, corner_hz=2000.0, refractory_s=1e-2)
    alone = record(model, 10.0, 1.0, roi=MANY)
    events = record(model + Crosstalk(probability=1.0), 10.0, 1.0, roi=MANY)
    assert 200 < len(alone) < 20_000
    inner = np.mean(
        [
            (alone["x"] > 0).mean(),
            (alone["x"] < 63).mean(),
            (alone["y"] > 0).mean(),
            (alone["y"] < 31).mean(),
        ]
    )
    share = len(events) / len(alone) - 1.0  # the rest are lost over the rim; a copy has none of its own
    assert share == pytest.approx(float(inner), abs=4.0 * math.sqrt(0.05 / len(alone)))


@pytest.mark.effect("trail_filter", shows="signature")
def test_the_trail_filter_lets_one_event_pass_for_each_pulse(record: Record) -> None:
    edges_s = np.arange(0.0, 0.4, 0.02)
    light = LightHistory(edges_s, 10.0 * np.exp(1.4 * (np.arange(len(edges_s)) % 2)))
    model = dataclasses.replace(FAST, corner_hz=200.0, refractory_s=1e-4)
    assert np.bincount(record(model, light, 0.4)["p"]).tolist() == [27, 30]
    filtered = record(model + TrailFilter(window_s=1e-2), light, 0.4)
    assert np.bincount(filtered["p"]).tolist() == [9, 10]  # the recording ends with the last pulse on


@pytest.mark.effect("event_rate_limit", shows="signature")
@pytest.mark.effect("event_rate_limit", shows="closed_form")
def test_the_rate_limit_takes_its_share_of_all_pixels_alike(record: Record) -> None:
    """Every pixel answers within one period; 512 of 2048 may pass, at random, with their own time stamps."""
    edges_s = np.arange(0.0, 0.4, 0.01) + 5e-5
    edges_s[0] = 0.0
    light = LightHistory(edges_s, 10.0 * np.exp(0.5 * (np.arange(len(edges_s)) % 2)))
    model = dataclasses.replace(FAST, refractory_s=1e-3)
    free = record(model, light, 0.4, roi=MANY)
    limited = record(model + EventRateLimit(max_rate_eps=512e3, period_s=1e-3), light, 0.4, roi=MANY)
    assert len(free) == 39 * MANY.pixels
    assert len(limited) == 39 * 512
    assert set(limited["t"]) == set(free["t"])
    counts = np.array([len(t_s) for t_s in by_pixel(limited, MANY)])
    assert counts.var() == pytest.approx(39 * 0.25 * 0.75, rel=4.0 * math.sqrt(2.0 / MANY.pixels))
