"""The threshold from the fit of a noisy pixel: against a brute-force simulation, and against draws from the law."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
import pytest

from bench.analysis.noisy_pixel import ThetaFit, fit_both, fit_theta, reason_against, time_grid_s
from bench.analysis.noisy_pixel_model import Conditions, Latencies, LatencyModel, Pixels, probability
from bench.analysis.results import CurveKey, Estimate, ResponseRow

if TYPE_CHECKING:
    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]

Z90 = 1.6448536


@dataclass(frozen=True)
class Bench:
    """A pixel array and how it is measured."""

    theta: float = 0.3
    other: float = 0.25
    noise_rms: float = 0.05
    corner_hz: float = 200.0
    mismatch: float = 0.01
    refractory_s: float = 0.006
    armed_s: float = 0.012
    window_s: float = 0.016
    grid_s: float = 2e-5
    span: tuple[float, float] = (0.3, 1.5)
    contrasts: int = 14
    pulses: int = 20
    pixels: int = 128

    @property
    def tau_s(self) -> float:
        return 1.0 / (2.0 * math.pi * self.corner_hz)


def latency_edges(window_s: float) -> Floats:
    inner = np.round(5e-5 * 10.0 ** (np.arange(80) / 20), 6)
    return np.concatenate(([0.0], inner[inner < window_s - 1e-6], [window_s]))


def make_row(
    contrast: float, counts: npt.NDArray[np.int64], pulses: int, latencies_s: Floats, window_s: float
) -> ResponseRow:
    edges = latency_edges(window_s)
    share = float(counts.mean() / pulses)
    return ResponseRow(
        point=0,
        key=CurveKey("reset_test", "on", 100.0, 0.0, window_s, ""),
        log_contrast=contrast,
        pulses=pulses,
        pixels=counts.size,
        responses=int(counts.sum()),
        probability=share,
        low=share,
        high=share,
        events_per_pulse=share,
        answered_resets=1.0,
        per_pixel=counts,
        latency_edges_s=edges,
        latency_counts=np.histogram(latencies_s, edges)[0].astype(np.int64),
        latency_median_s=float(np.sort(latencies_s)[latencies_s.size // 2]) if latencies_s.size else math.nan,
        latency_iqr_s=0.0,
    )


def simulate(bench: Bench, seed: int) -> list[ResponseRow]:
    """Return rows from pixels that are followed sample by sample, from the memorising of the reference.

    Events during the wait blind the pixel and renew its reference, those of the wrong polarity in the window too.
    """
    rng = np.random.default_rng(seed)
    contrasts = np.linspace(*bench.span, bench.contrasts) * bench.theta
    shape = (bench.contrasts, bench.pixels, bench.pulses)
    own = np.float32(bench.theta) + np.float32(bench.mismatch) * rng.standard_normal((bench.pixels, 1), np.float32)
    up = np.broadcast_to(own, shape).ravel()
    down = np.float32(-bench.other)
    step = np.repeat(contrasts, bench.pixels * bench.pulses).astype(np.float32)
    rho = math.exp(-bench.grid_s / bench.tau_s)
    keep, kick = np.float32(rho), np.float32(bench.noise_rms * math.sqrt(1.0 - rho * rho))
    dead = round(bench.refractory_s / bench.grid_s)
    before, after = round(bench.armed_s / bench.grid_s), round(bench.window_s / bench.grid_s)
    noise = np.float32(bench.noise_rms) * rng.standard_normal(step.size, np.float32)
    reference, wake = noise.copy(), np.full(step.size, -1)
    answer = np.full(step.size, -1)
    for k in range(before + after):
        noise = keep * noise + kick * rng.standard_normal(step.size, np.float32)
        level = noise + step * np.float32(max(0.0, 1.0 - rho ** (k + 1 - before)))
        renewed = np.flatnonzero(wake == k)
        reference[renewed] = level[renewed]
        moved = level - reference
        fired = np.flatnonzero((wake <= k) & (wake != k) & ((moved >= up) | (moved <= down)))
        wake[fired] = k + dead
        first = fired[(moved[fired] > 0) & (answer[fired] < 0)] if k >= before else fired[:0]
        answer[first] = k + 1 - before
    found = answer.reshape(shape)
    return [
        make_row(
            float(contrast),
            np.sum(found[j] >= 0, axis=1),
            bench.pulses,
            found[j][found[j] >= 0] * bench.grid_s,
            bench.window_s,
        )
        for j, contrast in enumerate(contrasts)
    ]


def error_of(estimate: Estimate) -> float:
    return (estimate.high - estimate.low) / (2.0 * Z90)


def fit(rows: list[ResponseRow], **known: object) -> ThetaFit:
    found = fit_theta(rows, **known)  # type: ignore[arg-type]
    assert found is not None
    return found


BENCHES = {
    "200 Hz": Bench(),
    "slow": Bench(
        corner_hz=80.0, refractory_s=0.015, armed_s=0.03, window_s=0.03, grid_s=4e-5, theta=0.35, other=0.28
    ),
    "mismatch": Bench(theta=0.2, other=0.19, noise_rms=0.025, mismatch=0.02, span=(0.4, 1.5)),
    "quiet": Bench(noise_rms=0.015, mismatch=0.003, span=(0.7, 1.2), pixels=64),
}


@cache
def fitted(name: str) -> ThetaFit:
    bench = BENCHES[name]
    return fit(simulate(bench, seed=11), armed_s=bench.armed_s)


@pytest.mark.parametrize(
    "name", ["200 Hz", "mismatch", *(pytest.param(name, marks=pytest.mark.slow) for name in ("slow", "quiet"))]
)
def test_brute_force_arrays(name: str) -> None:
    bench, found = BENCHES[name], fitted(name)
    assert found.theta.value == pytest.approx(bench.theta, abs=3.0 * error_of(found.theta))
    assert error_of(found.theta) < 0.03 * bench.theta
    assert found.noise_rms.value == pytest.approx(bench.noise_rms, abs=3.0 * error_of(found.noise_rms))
    assert found.mismatch.value == pytest.approx(bench.mismatch, abs=3.5 * error_of(found.mismatch))
    assert found.corner_hz.value == pytest.approx(bench.corner_hz, abs=3.0 * error_of(found.corner_hz))
    assert found.chi2_per_dof < 2.5
    assert found.theta_99[0] < found.theta.low < found.theta.high < found.theta_99[1]
    assert found.note.count("comparators taken to look every") == 1


@pytest.mark.slow
def test_thresholds_have_no_common_bias() -> None:
    off = np.array([fitted(name).theta.value / bench.theta - 1.0 for name, bench in BENCHES.items()])
    error = np.array([error_of(fitted(name).theta) / bench.theta for name, bench in BENCHES.items()])
    mean = float(np.average(off, weights=error**-2))
    assert np.sum(error**-2) ** -0.5 < 0.005
    # The 50 % points of these curves lie 10 to 40 % below the threshold.
    assert abs(mean) < 0.01


def test_the_curve_lies_far_to_the_left_of_the_threshold() -> None:
    found = fitted("200 Hz")
    middle = float(np.interp(0.5, found.probability, found.contrast))
    assert middle < 0.8 * found.theta.value


@pytest.mark.slow
def test_both_polarities_help_each_other() -> None:
    bench = BENCHES["200 Hz"]
    rows = [simulate(bench, 3), simulate(replace(bench, theta=bench.other, other=bench.theta), 4)]
    both = fit_both(rows[0], rows[1], armed_s=bench.armed_s)
    alone = [fit(mine, armed_s=bench.armed_s) for mine in rows]
    narrower = 1.0
    for found, first, truth in zip(both, alone, (bench.theta, bench.other), strict=True):
        assert found is not None
        assert found.theta.value == pytest.approx(truth, abs=3.0 * error_of(found.theta))
        assert "fitted along" not in found.note
        narrower *= error_of(found.theta) / error_of(first.theta)
    assert narrower < 1.0


def draw(bench: Bench, seed: int) -> list[ResponseRow]:
    """Return rows drawn from the law itself, in continuous time."""
    rng = np.random.default_rng(seed)
    contrasts = np.linspace(*bench.span, bench.contrasts) * bench.theta
    pixels = Pixels(bench.theta, bench.noise_rms, bench.mismatch, 0.99, bench.other / bench.theta)
    conditions = Conditions(bench.tau_s, bench.window_s, bench.armed_s, 0.0)
    thresholds = bench.theta + bench.mismatch * rng.standard_normal(bench.pixels)
    counts = rng.binomial(bench.pulses, probability(thresholds, pixels, conditions, contrasts))
    none = (np.zeros(0),) * bench.contrasts
    model = LatencyModel(pixels, conditions, Latencies(contrasts, none, none))
    rows = []
    for j, contrast in enumerate(contrasts):
        answered = 1.0 - model.missed[j]
        inside = float(np.interp(bench.window_s / bench.tau_s, model.time, answered))
        latencies_s = bench.tau_s * np.interp(inside * rng.random(int(counts[:, j].sum())), answered, model.time)
        rows.append(make_row(float(contrast), counts[:, j], bench.pulses, latencies_s, bench.window_s))
    return rows


KNOWN = Estimate(0.25, 0.246, 0.254, "ln")


@pytest.mark.slow
def test_intervals_cover() -> None:
    bench = Bench(pixels=96)
    pulls = []
    for seed in range(20):
        found = fit(draw(bench, seed), armed_s=bench.armed_s, other=KNOWN)
        pulls.append((found.theta.value - bench.theta) / error_of(found.theta))
    covered = np.abs(pulls) < Z90
    assert covered.sum() >= 14  # of 20 at 90 %: fewer happens once in 400
    assert np.std(pulls) > 0.5


@cache
def drawn(**change: object) -> list[ResponseRow]:
    return draw(replace(Bench(pixels=64), **change), seed=8)  # type: ignore[arg-type]


@pytest.mark.slow
def test_more_pixels_than_are_needed_are_represented_by_some(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bench.analysis.noisy_pixel._MOST_PIXELS", 64)
    rows = draw(Bench(pixels=96), seed=5)
    one, same, other = (fit(rows, seed=seed, other=KNOWN) for seed in (1, 1, 2))
    assert one.theta == same.theta
    assert one.theta != other.theta


@cache
def fit_of_drawn() -> ThetaFit:
    return fit(drawn(), other=KNOWN)


def test_order_of_the_rows_does_not_matter() -> None:
    assert fit(drawn()[::-1], other=KNOWN).theta == fit_of_drawn().theta


def test_counts_that_do_not_fit_widen_the_interval() -> None:
    rows = drawn()
    shaken = [
        replace(r, per_pixel=np.clip(r.per_pixel + (-1) ** j * (2 < j < 8), 0, r.pulses)) for j, r in enumerate(rows)
    ]
    good, poor = fit_of_drawn(), fit(shaken, other=KNOWN)
    assert poor.chi2_per_dof > 2.0
    assert "poor fit" in poor.note
    assert "poor fit" not in good.note
    assert error_of(poor.theta) > error_of(good.theta)


def steps() -> list[ResponseRow]:
    """Return rows of pixels without noise."""
    rows = drawn()
    return [
        make_row(r.log_contrast, np.full(r.pixels, 20 * (r.log_contrast > 0.3)), 20, np.full(640, 1e-3), 0.016)
        for r in rows
    ]


def as_square(rows: list[ResponseRow]) -> list[ResponseRow]:
    return [replace(r, key=replace(r.key, waveform="square")) for r in rows]


REFUSED = {
    "leave a reference": lambda: as_square(drawn()),
    "on the rise": lambda: drawn(span=(0.8, 1.5)),
    "0 contrasts on the rise": lambda: steps(),
    "were answered": lambda: drawn(span=(0.1, 0.5)),
    "fewer than 8 pixels": lambda: drawn(pixels=4),
    "different numbers of pixels": lambda: [*drawn(), *drawn(pixels=65)],
    "for want of triggers": lambda: [replace(r, latency_counts=0 * r.latency_counts) for r in drawn()],
    "their latencies": lambda: [replace(r, latency_counts=np.minimum(r.latency_counts, 1)) for r in drawn()],
}


@pytest.mark.parametrize("reason", list(REFUSED))
def test_what_does_not_determine_a_threshold_is_refused_with_the_reason(reason: str) -> None:
    rows = REFUSED[reason]()
    said = reason_against(rows)
    assert said is not None
    assert reason in said
    assert fit_theta(rows) is None


def test_no_rows_are_refused() -> None:
    assert reason_against([]) is not None
    assert fit_theta([]) is None


@pytest.mark.parametrize(
    ("medians_us", "grid_us"),
    [
        ((500, 730, 1210, 1500, 1600, 1700, 1800, 1900), 10),
        ((500, 730, 1210, 1500, 1600, 1700, 1801, 1900), 0),
        ((500, 730, 1210, 1500, 1600, 1700, 1800.4, 1900), 0),
        ((500, 730, 1210), 0),
    ],
)
def test_time_grid_of_sampled_comparators(medians_us: tuple[float, ...], grid_us: float) -> None:
    row = make_row(0.3, np.full(8, 20), 20, np.full(160, 1e-3), 0.02)
    rows = [replace(row, latency_median_s=m * 1e-6) for m in medians_us]
    assert time_grid_s(rows) == pytest.approx(grid_us * 1e-6)


def test_a_time_grid_shows_in_the_interquartile_ranges_too() -> None:
    row = make_row(0.3, np.full(8, 20), 20, np.full(160, 1e-3), 0.02)
    assert time_grid_s([replace(row, latency_iqr_s=30e-6)] * 8) == pytest.approx(10e-6)
    assert time_grid_s([replace(row, latency_iqr_s=31e-6)] * 8) == 0.0
