"""Print how well edges are placed by events alone: worst errors, periods off and doubts in 1000 trials of each case.

The recordings are made pixel by pixel: a light with a first-order edge, a low-pass, thresholds that differ from pixel
to pixel, a dead time, a delay of the electronics that differs from pixel to pixel and from event to event, background
events, and losses, single ones and whole stretches. None of that is what the alignment takes the answers to be.
Run with ``python -m benchmarks.edge_alignment [trials [processes]]``.
"""

from __future__ import annotations

import math
import os
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.alignment.counts import EventCounts
from bench.alignment.events import align_to_events
from bench.alignment.latency import Answering
from protocols.points import Preamble
from protocols.preamble import with_preamble
from protocols.waveforms import reset_test_edges, square_edges

if TYPE_CHECKING:
    import numpy.typing as npt

    from bench.alignment.events import EdgeAlignment
    from protocols.stimulus import Stimulus

    Floats = npt.NDArray[np.float64]

__all__ = ["CASES", "Case", "Outcome", "Sensor", "Truth", "recorded", "trial"]

_GRID_S: Final = 1e-5
_MOST_EVENTS: Final = 12  #: of one pixel after one edge
_FIRST_SEED: Final = 1000
WANTED_S: Final = 2e-4


@dataclass(frozen=True, slots=True)
class Sensor:
    """Pixels and light of one trial."""

    pixels: int
    theta_on: float
    theta_off: float
    mismatch: float  #: of the thresholds, relative
    threshold_noise: float  #: from event to event, ln
    pole_s: float
    dead_s: float
    delay_s: float  #: median of the pixels
    jitter_s: float  #: mean of what comes on top from event to event
    background_hz: float  #: of each pixel and polarity
    rise_tau_s: float


@dataclass(frozen=True, slots=True)
class Truth:
    """Where the light's edges are on the camera's clock."""

    offset_s: float
    rate: float
    duration_s: float

    def at(self, t_s: Floats) -> Floats:
        """Return camera times."""
        return np.asarray(self.offset_s + (1.0 + self.rate) * t_s, np.float64)


@dataclass(frozen=True, slots=True)
class Case:
    """What is asked of 1000 trials."""

    name: str
    preamble: bool = True
    stretches: bool = False  #: the lost events come in stretches, not one by one
    rise_known: bool = True
    limits_s: float | None = None  #: how well the host knows the offset
    cut: bool = False  #: the recording begins after the stimulus did
    preamble_ratio: float = 5.0


CASES: Final = (
    Case("preamble"),
    Case("preamble, rise not given", rise_known=False),
    Case("preamble, losses in stretches", stretches=True),
    Case("preamble, its beginning not recorded", cut=True),
    Case("no preamble", preamble=False),
    Case("no preamble, losses in stretches", preamble=False, stretches=True),
    Case("no preamble, beginning not recorded", preamble=False, cut=True),
    Case("no preamble, host knows +-20 ms", preamble=False, limits_s=0.02),
)


@dataclass(frozen=True, slots=True)
class Outcome:
    """One trial."""

    worst_s: float  #: largest error at any edge
    doubtful: bool
    periods_off: bool
    bound_s: float
    none: bool = False


def _answer(sensor: Sensor, step: float, gap_s: float) -> Floats:
    """Return the signal of a pixel after an edge, ln, from 0 to `step`, on a grid of 10 us."""
    from scipy.signal import lfilter

    t = np.arange(0.0, min(gap_s, 0.03), _GRID_S)
    light = np.log1p(np.expm1(step) * -np.expm1(-t / sensor.rise_tau_s))
    kept = np.exp(-_GRID_S / sensor.pole_s)
    return np.asarray(lfilter([1.0 - kept], [1.0, -kept], light), np.float64)


def light_events(
    stimulus: Stimulus, sensor: Sensor, rng: np.random.Generator
) -> tuple[Floats, npt.NDArray[np.uint8]]:
    """Return times, on the clock of the light, and polarities of the events that the light makes."""
    level = np.log(stimulus.lux)
    theta = {
        p: mean * np.exp(sensor.mismatch * rng.standard_normal(sensor.pixels))
        for p, mean in ((1, sensor.theta_on), (0, sensor.theta_off))
    }
    own_delay = sensor.delay_s * np.exp(0.3 * rng.standard_normal(sensor.pixels))
    reference = level[0] + 0.2 * sensor.theta_on * rng.standard_normal(sensor.pixels)
    free_s = np.zeros(sensor.pixels)
    times: list[Floats] = [np.empty(0)]
    signs: list[npt.NDArray[np.uint8]] = [np.empty(0, np.uint8)]
    gaps = np.diff(np.append(stimulus.t_s, stimulus.duration_s))
    for i in range(1, len(level)):
        step, begin = level[i] - level[i - 1], stimulus.t_s[i]
        signal = _answer(sensor, step, gaps[i])
        up = int(step > 0)
        # On rising signals |signal| grows; it is looked up both ways.
        size, grid = np.abs(signal), np.arange(len(signal)) * _GRID_S
        for _ in range(_MOST_EVENTS):
            wanted = theta[up] + sensor.threshold_noise * rng.standard_normal(sensor.pixels)
            away = (reference - level[i - 1]) * (1 if up else -1)
            crossing = np.interp(away + wanted, size, grid, left=0.0, right=np.inf)
            at = np.maximum(begin + crossing, free_s)
            fires = np.flatnonzero(np.isfinite(crossing) & (at < begin + grid[-1]))
            if not len(fires):
                break
            sent = at[fires] + own_delay[fires] + rng.exponential(sensor.jitter_s, len(fires))
            times.append(sent)
            signs.append(np.full(len(fires), up, np.uint8))
            free_s[fires] = at[fires] + sensor.dead_s
            reset_at = np.minimum(free_s[fires] - begin, grid[-1])
            reference[fires] = level[i - 1] + np.interp(reset_at, grid, signal)
    return np.concatenate(times), np.concatenate(signs)


def recorded(
    stimulus: Stimulus, sensor: Sensor, truth: Truth, *, stretches: bool, rng: np.random.Generator
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.uint8]]:
    """Return times (us) and polarities on the clock of the camera, a fifth of them lost."""
    light_s, p = light_events(stimulus, sensor, rng)
    number = rng.poisson(2 * sensor.pixels * sensor.background_hz * truth.duration_s)
    t_s = np.concatenate([truth.at(light_s), rng.uniform(0.0, truth.duration_s, number)])
    p = np.concatenate([p, rng.integers(0, 2, number).astype(np.uint8)])
    kept = (t_s >= 0.0) & (t_s < truth.duration_s)
    if stretches:
        lost = 0.0
        while lost < 0.2 * truth.duration_s:
            length = rng.uniform(0.01, 0.5)
            begin = rng.uniform(0.0, truth.duration_s)
            kept &= (t_s < begin) | (t_s >= begin + length)
            lost += length
    else:
        kept &= rng.random(len(t_s)) >= 0.2
    t_us = np.floor(t_s[kept] * 1e6).astype(np.int64)
    order = np.argsort(t_us, kind="stable")
    return t_us[order], p[kept][order]


def _stimulus(case: Case, rng: np.random.Generator) -> tuple[Stimulus, float]:
    """Return a periodic stimulus, and its period."""
    low = 10.0 ** rng.uniform(0.0, 2.0)
    contrast = rng.uniform(0.5, 1.6)
    length_s = rng.uniform(4.0, 30.0)
    if rng.random() < 0.5:
        period_s = 1.0 / rng.uniform(2.0, 15.0)
        stimulus = square_edges(
            period_s=period_s,
            duty=rng.uniform(0.3, 0.7),
            low_lux=low,
            high_lux=low * np.exp(contrast),
            cycles=max(5, round(length_s / period_s)),
            first_edge_s=period_s,
        )
    else:
        gap, reset, test = rng.uniform(0.03, 0.15), rng.uniform(0.02, 0.1), rng.uniform(0.02, 0.1)
        period_s = 2 * gap + reset + test
        stimulus = reset_test_edges(
            baseline_lux=low,
            reset_lux=low * np.exp(rng.choice([-1.0, 1.0]) * contrast),
            test_lux=low * np.exp(rng.choice([-1.0, 1.0]) * rng.uniform(0.1, 0.8)),
            gap_s=gap,
            reset_s=reset,
            test_s=test,
            cycles=max(5, round(length_s / period_s)),
        )
    if case.preamble:
        stimulus = with_preamble(stimulus, Preamble(math.log(low * case.preamble_ratio / stimulus.lux[0])))
    return stimulus, period_s


def _sensor(rng: np.random.Generator) -> Sensor:
    return Sensor(
        pixels=int(2 ** rng.uniform(5, 9)),
        theta_on=rng.uniform(0.2, 0.4),
        theta_off=rng.uniform(0.2, 0.4),
        mismatch=rng.uniform(0.03, 0.15),
        threshold_noise=rng.uniform(0.005, 0.05),
        pole_s=1.0 / (2 * np.pi * 10.0 ** rng.uniform(np.log10(500.0), np.log10(5000.0))),
        dead_s=10.0 ** rng.uniform(-3.5, -2.0),
        delay_s=rng.uniform(10e-6, 80e-6),
        jitter_s=rng.uniform(5e-6, 50e-6),
        background_hz=10.0 ** rng.uniform(-1.0, 1.0),
        rise_tau_s=1e-3 * rng.uniform(0.85, 1.15),
    )


def trial(case: Case, seed: int) -> tuple[Outcome, EdgeAlignment | None]:
    """Return how one trial of a case ended."""
    rng = np.random.default_rng((seed, len(case.name)))
    stimulus, period_s = _stimulus(case, rng)
    sensor = _sensor(rng)
    offset_s = -rng.uniform(0.2, 3.0) if case.cut else rng.uniform(0.0, 3.0)
    rate = 1e-6 * float(rng.choice([-50.0, 50.0]))
    truth = Truth(offset_s, rate, stimulus.duration_s + offset_s + rng.uniform(0.0, 1.0))
    t_us, p = recorded(stimulus, sensor, truth, stretches=case.stretches, rng=rng)
    limits = None
    if case.limits_s is not None:
        host_s = offset_s + rng.uniform(-case.limits_s, case.limits_s)
        limits = (host_s - case.limits_s, host_s + case.limits_s)
    found = align_to_events(
        stimulus.t_s,
        stimulus.lux,
        EventCounts.of(t_us, p),
        duration_s=truth.duration_s,
        offset_limits_s=limits,
        answering=Answering(rise_tau_s=1e-3 if case.rise_known else None),
    )
    if found is None:
        return Outcome(np.nan, True, False, np.nan, none=True), None
    inside = truth.at(stimulus.t_s[1:]) >= 0.0
    errors = (found.t_s - truth.at(stimulus.t_s))[1:][inside]
    worst = float(np.abs(errors).max())
    return Outcome(worst, found.doubtful, worst > 0.25 * min(period_s, 0.04), found.bound_s), found


def outcome(case: Case, seed: int) -> Outcome:
    """Return how one trial of a case ended, without the alignment."""
    return trial(case, seed)[0]


def _report(case: Case, outcomes: list[Outcome]) -> str:
    sure = [o for o in outcomes if not o.doubtful]
    worst = np.array([o.worst_s for o in sure])
    right = np.array([o.worst_s for o in outcomes if not o.none and not o.periods_off])
    return (
        f"{case.name:<40}{len(outcomes):>7}{len(outcomes) - len(sure):>9}"
        f"{sum(o.periods_off for o in sure):>8}{sum(o.periods_off for o in outcomes if o.doubtful):>9}"
        f"{1e3 * np.median(worst) if len(worst) else np.nan:>9.3f}"
        f"{1e3 * np.quantile(worst, 0.99) if len(worst) else np.nan:>9.3f}"
        f"{1e3 * worst.max() if len(worst) else np.nan:>9.3f}"
        f"{int((worst > WANTED_S).sum()):>9}"
        f"{1e3 * right.max() if len(right) else np.nan:>9.3f}"
        f"{1e3 * np.median([o.bound_s for o in outcomes if not o.none]):>9.3f}"
        f"{sum(o.worst_s > o.bound_s for o in sure):>9}"
    )


def main(trials: int, workers: int) -> None:
    """Print one line for each case."""
    print(
        f"{'case':<40}{'trials':>7}{'doubtful':>9}{'sure,':>8}{'doubted,':>9}{'worst error of the sure, ms':>27}"
        f"{'> 0.2 ms':>9}{'all in':>9}{'bound':>9}{'beyond':>9}\n"
        f"{'':<56}{'off':>8}{'off':>9}{'median':>9}{'99 %':>9}{'worst':>9}{'sure':>9}{'place':>9}{'ms':>9}"
        f"{'bound':>9}"
    )
    with ProcessPoolExecutor(workers) as pool:
        for case in CASES:
            print(
                _report(
                    case,
                    list(pool.map(partial(outcome, case), range(_FIRST_SEED, _FIRST_SEED + trials), chunksize=4)),
                ),
                flush=True,
            )


if __name__ == "__main__":
    asked = [int(value) for value in sys.argv[1:]]
    main(*(asked + [1000, os.cpu_count() or 1][len(asked) :]))
