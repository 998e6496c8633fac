"""The noise that gives a background rate: against the engine, a closed form, and what cannot be."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING

import numpy as np
import pytest

from bench.cli import run
from bench.models.noise_calibration import calibrate_noise, matrix_rms
from bench.models.noise_chain import lasting_rate, memory_chain, settling_intervals
from bench.models.noise_recording import Bench
from protocols.errors import InputError
from sim_backend.pixel import PixelModel
from sim_backend.pixel.effects import HotPixels, ThresholdMismatch

if TYPE_CHECKING:
    from pathlib import Path

DT_S = 1e-5


def pixel(corner_hz: float, refractory_s: float, theta_off: float = 0.3) -> PixelModel:
    return PixelModel(corner_hz=corner_hz, refractory_s=refractory_s, theta_on=0.3, theta_off=theta_off)


def bench(model: PixelModel, pixels: int = 256) -> Bench:
    return Bench(model, lux=10.0, dt_s=DT_S, step="exact", pixels=pixels, seed=5)


def test_without_memory_the_rate_is_that_of_independent_samples() -> None:
    """rho = 0: each sample is drawn anew, so an exit from around r has a known chance in each sample."""
    from scipy.special import ndtr

    a, b, dead = 2.5, 2.1, 7
    r = np.linspace(-8.0, 8.0, 4001)
    weight = np.exp(-0.5 * r**2)
    samples = 1.0 / (1.0 - ndtr(r + a) + ndtr(r - b))
    assert lasting_rate(a, b, 0.0, dead) == pytest.approx(1.0 / (dead + weight @ samples / weight.sum()), rel=1e-4)


@pytest.mark.parametrize(("corner_hz", "dead"), [(2000.0, 10), (200.0, 0), (200.0, 1000)])
def test_a_chain_of_levels_keeps_probability_and_symmetry(corner_hz: float, dead: int) -> None:
    level, samples, change = memory_chain(3.5, 3.5, math.exp(-2.0 * math.pi * corner_hz * DT_S), dead)
    assert np.allclose(change.sum(axis=1), 1.0, atol=1e-6)
    assert np.allclose(samples, samples[::-1], rtol=1e-6)
    assert np.allclose(change @ level, -(change @ level)[::-1], atol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("corner_hz", "refractory_s", "theta_off", "rms"),
    [(2000.0, 1e-4, 0.3, 0.07), (200.0, 0.0, 0.27, 0.08), (200.0, 1e-4, 0.3, 0.08), (500.0, 1e-3, 0.33, 0.08)],
)
def test_the_engine_counts_what_the_transition_matrix_says(
    corner_hz: float, refractory_s: float, theta_off: float, rms: float
) -> None:
    b = bench(pixel(corner_hz, refractory_s, theta_off), pixels=512)
    on, off = 0.3 / rms, theta_off / rms
    rate_hz = lasting_rate(on, off, b.rho(), b.dead_samples) / DT_S
    wait_s = settling_intervals(on, off, b.rho(), b.dead_samples, 0.002) / rate_hz
    counts = b.counts(rms, wait_s, 60.0 / rate_hz, 0)
    error = counts.std(ddof=1) / math.sqrt(counts.size) / counts.mean()
    assert error < 0.04
    assert abs(counts.mean() / 60.0 - 1.0) < 4.0 * error + 0.002


@pytest.mark.slow
@pytest.mark.parametrize("step", ["exact", "euler"])
def test_the_noise_found_is_that_of_the_matrix(step: str) -> None:
    found = calibrate_noise(pixel(2000.0, 1e-2), 0.5, lux=10.0, step=step)  # type: ignore[arg-type]
    assert found.matrix_rms is not None
    assert found.rms_error < 0.005 * found.rms
    assert abs(found.rms - found.matrix_rms) < 4.0 * found.rms_error
    assert found.rms == pytest.approx(0.0628, rel=0.03)
    assert found.events > 5000


@pytest.mark.slow
def test_a_model_with_effects_reaches_the_rate() -> None:
    model = pixel(2000.0, 1e-3) + ThresholdMismatch(sigma_on=0.02, sigma_off=0.02)
    found = calibrate_noise(model, 5.0, lux=10.0)
    assert found.matrix_rms is None
    # Thresholds that are lower in some pixels need less noise for the same mean rate.
    plain = matrix_rms(bench(pixel(2000.0, 1e-3)), 5.0)
    assert plain is not None
    assert found.rms < 0.99 * plain
    r = found.reached
    assert (
        abs(r.rate_hz - 5.0)
        < 4.0 * (r.high_hz - r.low_hz) / 3.29 + 4.0 * 5.0 * found.slope * found.rms_error / found.rms
    )


def test_more_than_the_dead_time_allows_is_refused() -> None:
    with pytest.raises(InputError, match=r"no pixel has more than 99\.9 Hz; 200 Hz is beyond what noise can do"):
        calibrate_noise(pixel(200.0, 1e-2), 200.0, lux=10.0)


@pytest.mark.slow
def test_hot_pixels_that_give_more_than_the_target_are_named() -> None:
    model = pixel(2000.0, 1e-2) + HotPixels(fraction=0.5, rate_hz=50.0)
    with pytest.raises(InputError, match=r"without this noise the pixel already has .* Hz \(hot_pixels\), more than"):
        calibrate_noise(model, 5.0, lux=10.0, pixels=64, seconds=2.0, wait_s=0.0)


@pytest.mark.slow
def test_a_target_far_below_what_effects_give_is_refused_without_hours_of_counting() -> None:
    model = pixel(200.0, 1e-2) + HotPixels(fraction=0.5, rate_hz=5.0)
    with pytest.raises(InputError, match=r"already has 2\.\d+ Hz \(hot_pixels\), more than the 1e-05 Hz wanted"):
        calibrate_noise(model, 1e-5, lux=10.0, pixels=64, dt_s=1e-4)


@pytest.mark.slow
def test_the_command_says_what_it_found(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    base = ["--corner-hz", "2000", "--theta-on", "0.3", "--theta-off", "0.3", "--refractory-s", "1e-3"]
    arguments = ["calibrate-noise", "--target-hz", "10", *base, "--pixels", "128"]
    assert run([*arguments, "--json", "--out", str(tmp_path / "out")]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["format"] == "evs-bench-noise/1"
    assert abs(found["rms"] - found["matrix_rms"]) < 4.0 * found["rms_error"]
    assert json.loads((tmp_path / "out" / "noise.json").read_text()) == found
    assert (tmp_path / "out" / "noise.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--corner-hz", "200"], "missing --theta-on, --theta-off, --refractory-s"),
        (["--model", "m.yaml"], "--model needs --lux"),
        (["--model", "m.yaml", "--lux", "1", "--corner-hz", "5"], "--model has its own --corner-hz"),
    ],
)
def test_a_pixel_that_is_half_given_is_refused(
    arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["calibrate-noise", "--target-hz", "1", *arguments]) == 1
    assert said in capsys.readouterr().err
