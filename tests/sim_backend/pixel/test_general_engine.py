"""The general kernel against a plain loop and against the fast kernel, and what must not change its events."""

from __future__ import annotations

import dataclasses
import functools
import math
import operator
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pytest

from drivers.events.types import EVENT_DTYPE
from protocols.errors import InputError
from protocols.points import Roi
from sim_backend.pixel import LightHistory, PixelModel, ReferenceEngine, build_chain
from sim_backend.pixel.chain import pixel_ids
from sim_backend.pixel.effects import (
    ComparatorDelay,
    ContrastError,
    DarkCurrent,
    HighPass,
    InjectionOffset,
    Leak,
    LightDrift,
    LightFlicker,
    LowFrequencyNoise,
    NdError,
    ParasiticPhotocurrent,
    PhotoreceptorBandwidth,
    RefractoryMismatch,
    ResetNoise,
    ShotNoise,
    StrayLight,
    ThresholdMismatch,
)
from sim_backend.pixel.engines import general_kernels as general
from sim_backend.pixel.engines import reference_kernels as kernels
from sim_backend.pixel.engines.general_kernels import exp_falling
from sim_backend.pixel.engines.stationary import draw, stationary_covariance
from sim_backend.pixel.philox import philox4x32, split_seed

if TYPE_CHECKING:
    import numpy.typing as npt

    from sim_backend.pixel import Chain

    Floats = npt.NDArray[np.float64]
    Events = npt.NDArray[np.void]

DT_S = 1e-5
SEED = 3
ROI = Roi(30, 40, 11, 13)  # 143 pixels: two whole groups of lanes and a part of one
DURATION_S = 0.06
STEPS = LightHistory(np.array([0.0, 0.01, 0.02, 0.0301, 0.045]), np.array([0.3, 0.9, 0.2, 4.0, 0.3]), nd_od=3.0)
BASE = PixelModel(noise_rms=0.09, corner_hz=300.0, theta_on=0.3, theta_off=0.25, refractory_s=2e-3)
WITHOUT_READOUT = functools.reduce(
    operator.add,
    [
        ContrastError(gain_error=0.1),
        LightDrift(rate_per_s=0.5),
        LightFlicker(depth=0.05, frequency_hz=180.0, phase=1.0),
        NdError(delta_od=0.1),
        StrayLight(illuminance_lux=0.05),
        DarkCurrent(mean_fa=5.0, spread=0.4),
        ShotNoise(factor=2.0),
        PhotoreceptorBandwidth(hz_per_fa=20.0, max_hz=900.0),
        LowFrequencyNoise(rms=0.05, tau_s=0.01),
        HighPass(corner_hz=20.0),
        Leak(rate_per_s=2.0, spread=0.3),
        ParasiticPhotocurrent(rate_per_s_per_lux=1.0),
        ResetNoise(rms=0.05),
        InjectionOffset(offset=0.02),
        ThresholdMismatch(),
        ComparatorDelay(delay_s=3.4e-5),
        RefractoryMismatch(spread=0.2),
    ],
    BASE,
)


def events_of(model: PixelModel, light: LightHistory = STEPS, roi: Roi = ROI, **engine: Any) -> Events:
    chain = build_chain(model, roi, 5)
    parts = list(ReferenceEngine(**engine).events(chain, light, DURATION_S, SEED))
    return np.concatenate([np.empty(0, EVENT_DTYPE), *parts])


def box_muller(words: npt.NDArray[np.uint32]) -> Floats:
    """Return (n, 4) normal numbers of (n, 4) words, in double precision and with library functions."""
    a, b = words[:, ::2].astype(np.int64), words[:, 1::2].astype(np.int64)
    radius = np.sqrt(-2.0 * np.log(((a >> 1) + 0.5) / 2.0**31))
    angle = ((b << 2) & 0xFFFFFFFF).astype(np.uint32).astype(np.int32) * math.pi / 2.0**33
    swap, sign = (b >> 31) == 1, np.where((b >> 30) & 1, -1.0, 1.0)
    first, second = np.cos(angle), np.sin(angle)
    pairs = (sign * radius)[:, :, None] * np.stack([np.where(swap, second, first), np.where(swap, first, second)], 2)
    return np.asarray(pairs.reshape(len(words), 4))


def numbers(addresses: Any, pixel: int, purpose: int) -> Floats:
    counter = np.zeros((len(addresses), 4), np.uint32)
    counter[:, 0], counter[:, 1], counter[:, 2] = addresses, pixel, purpose
    return box_muller(philox4x32(counter, split_seed(SEED)))


def light_at(chain: Chain, samples: int) -> Floats:
    """Return the light on the chip, by the definition."""
    t_s = np.arange(samples) * DT_S
    level = np.searchsorted(STEPS.t_s, t_s + 1e-9, side="right") - 1
    lux = STEPS.lux[0] * np.exp(chain.contrast_gain * np.log(STEPS.lux[level] / STEPS.lux[0]))
    lux *= 1.0 + chain.drift_per_s * t_s
    lux *= 1.0 + chain.flicker_depth * np.sin(2.0 * math.pi * chain.flicker_hz * t_s + (chain.flicker_phase or 0.0))
    return np.asarray(lux * 10.0**-chain.nd_error_od + chain.stray_lux)


def plain_loop(chain: Chain, euler: bool) -> Events:
    """Return the events by the definition: one pixel after the other, one sample after the other."""
    samples = round(DURATION_S / DT_S)
    lux = light_at(chain, samples)
    events: list[Any] = []
    for i in range(chain.pixels):
        events += _events_of_pixel(chain, i, lux, euler)
    inside = [e for e in events if e[0] < DURATION_S * 1e6]
    return np.sort(np.array(inside, EVENT_DTYPE), order=["t", "y", "x"])


def _events_of_pixel(chain: Chain, i: int, lux: Floats, euler: bool) -> list[Any]:
    samples, pixel = len(lux), int(pixel_ids(chain.x[i : i + 1], chain.y[i : i + 1])[0])

    def factor(corner_hz: Any, form: bool = euler) -> Any:
        ratio = 2.0 * math.pi * corner_hz * DT_S
        return 1.0 - ratio if form else np.exp(-ratio)

    current = chain.gain_fa_per_lux[i] * lux + chain.dark_fa[i]
    shot = np.sqrt(chain.shot_factor * 1.602176634e-19 / (current * 1e-15 * DT_S))
    forget = factor(np.minimum(chain.receptor_hz_per_fa * current, chain.receptor_max_hz))
    rho, slow_rho = factor(chain.corner_hz), math.exp(-DT_S / chain.slow_tau_s)
    high_rho = factor(chain.high_pass_hz, False)
    sigma = chain.noise_rms * math.sqrt(1.0 - rho**2)
    slow_sigma = chain.slow_rms * math.sqrt(1.0 - slow_rho**2)
    blocks = np.arange(samples // 4 + 1)
    z, z_shot, z_slow = (numbers(blocks, pixel, p).ravel() for p in (0, general.PURPOSE_SHOT, general.PURPOSE_SLOW))
    z_reset = numbers(np.arange(samples), pixel, general.PURPOSE_RESET)[:, 0]
    v, p, slow, memory = _start(
        chain, pixel, current[0], shot[0], forget[0], rho, sigma, slow_rho, slow_sigma, high_rho
    )
    leaked = np.cumsum(chain.leak_per_s[i] + chain.leak_per_s_per_lux * lux) * DT_S
    leaked -= leaked[0]
    dead = round((chain.refractory_s[i] + chain.comparator_delay_s) / DT_S)
    reference, reset_at, wake = v + slow - memory + chain.injection_ln + chain.reset_rms * z_reset[0], 0, -1
    found = []
    for n in range(1, samples):
        p = forget[n] * p + (1.0 - forget[n]) * (math.log(current[n]) + shot[n] * z_shot[n - 1])
        v = rho * v + (1.0 - rho) * p + sigma * z[n - 1]
        slow = slow_rho * slow + slow_sigma * z_slow[n - 1]
        memory = high_rho * memory + (1.0 - high_rho) * (v + slow)
        signal = v + slow - memory
        difference = signal - reference + leaked[n] - leaked[reset_at]
        if n > wake and (difference >= chain.theta_on[i] or difference <= -chain.theta_off[i]):
            stamp = np.rint(n * DT_S * 1e6 + chain.comparator_delay_s * 1e6)
            found.append((stamp, chain.x[i], chain.y[i], difference > 0.0))
            wake = n + dead
        if n == wake:
            reference, reset_at = signal + chain.injection_ln + chain.reset_rms * z_reset[n], n
    return found


def _start(
    chain: Chain, pixel: int, current: float, shot: float, forget: float, rho: float, sigma: float, slow_rho: float,
    slow_sigma: float, high_rho: float,
) -> Floats:  # fmt: skip
    """Return source follower, photoreceptor, slow noise and high-pass; columns are what a unit does."""

    def step(x: list[float], z: list[float]) -> list[float]:
        p = forget * x[1] + (1.0 - forget) * shot * z[0]
        v = rho * x[0] + (1.0 - rho) * p + sigma * z[1]
        slow = slow_rho * x[2] + slow_sigma * z[2]
        return [v, p, slow, high_rho * x[3] + (1.0 - high_rho) * (v + slow)]

    a = np.array([step(list(unit), [0.0] * 3) for unit in np.eye(4)]).T[None]
    b = np.array([step([0.0] * 4, list(unit)) for unit in np.eye(3)]).T[None]
    first = numbers([0], pixel, kernels.PURPOSE_START)[0, :1]
    z = np.concatenate([first, numbers([0], pixel, general.PURPOSE_START)[0, :3]])[:, None]
    level = math.log(current) * np.array([1.0, 1.0, 0.0, 1.0])
    return np.asarray(draw(stationary_covariance(a, b), z)[:, 0] + level)


@pytest.mark.parametrize("step", ["exact", "euler"])
def test_the_engine_is_the_plain_loop(step: Literal["exact", "euler"]) -> None:
    roi = Roi(30, 40, 7, 2)
    expected = plain_loop(build_chain(WITHOUT_READOUT, roi, 5), step == "euler")
    assert len(expected) > 100
    assert 0 < expected["p"].sum() < len(expected)
    assert np.array_equal(events_of(WITHOUT_READOUT, roi=roi, step=step), expected)


@pytest.mark.parametrize("step", ["exact", "euler"])
def test_both_kernels_give_a_plain_pixel_the_same_events(step: Literal["exact", "euler"]) -> None:
    model = BASE + DarkCurrent(mean_fa=5.0, spread=0.4) + ThresholdMismatch() + LightFlicker(depth=0.1)
    expected = events_of(model, step=step)
    assert len(expected) > 1000
    assert np.array_equal(events_of(model, step=step, general=True), expected)


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("stretch_samples", [1, 999, 100_000])
def test_threads_and_stretches_change_nothing(threads: int, stretch_samples: int) -> None:
    expected = events_of(WITHOUT_READOUT)
    assert len(expected) > 1000
    same = events_of(WITHOUT_READOUT, threads=threads, stretch_samples=stretch_samples)
    assert np.array_equal(same, expected)


def test_the_window_changes_nothing() -> None:
    expected = events_of(WITHOUT_READOUT)
    inner = Roi(33, 42, 5, 6)
    events = events_of(WITHOUT_READOUT, roi=inner)
    x, y = expected["x"], expected["y"]
    inside = (x >= inner.x) & (x < inner.x + inner.width) & (y >= inner.y) & (y < inner.y + inner.height)
    assert len(events) > 100
    assert np.array_equal(events, expected[inside])


def test_stationary_variances_are_those_of_continuous_time() -> None:
    """White noise of density S behind one pole has the variance S / (2 tau), behind two S / (2 (tau + tau'))."""
    tau_s, tau_pr_s, density = 5e-4, 3e-3, 1e-5
    rho, forget = math.exp(-DT_S / tau_s), math.exp(-DT_S / tau_pr_s)
    a = np.array([[[rho, (1.0 - rho) * forget], [0.0, forget]]])
    b = math.sqrt(density / DT_S) * (1.0 - forget) * np.array([[[1.0 - rho], [1.0]]])
    covariance = stationary_covariance(a, b)[0]
    assert covariance[1, 1] == pytest.approx(density / (2.0 * tau_pr_s), rel=1e-4)
    assert covariance[0, 0] == pytest.approx(density / (2.0 * (tau_pr_s + tau_s)), rel=0.01)


def test_vectors_are_drawn_with_their_covariance() -> None:
    wanted = np.array([[4.0, 1.0, 0.0], [1.0, 2.0, 0.0], [0.0, 0.0, 0.0]])
    n = 100_000
    z = np.random.default_rng(1).standard_normal((3, n))
    drawn = draw(np.broadcast_to(wanted, (n, 3, 3)), z)
    assert np.array_equal(drawn[0], 2.0 * z[0])
    assert np.all(drawn[2] == 0.0)
    assert np.cov(drawn) == pytest.approx(wanted, abs=5.0 * 4.0 * math.sqrt(2.0 / n))


def test_the_exponential_is_exact() -> None:
    x = np.concatenate([[0.0], np.geomspace(1e-12, 699.0, 500)])
    assert np.array([exp_falling(v) for v in x]) == pytest.approx(np.exp(-x), rel=2e-14)
    assert exp_falling(701.0) == 0.0
    assert exp_falling(math.inf) == 0.0


def test_the_euler_step_must_be_shorter_than_the_photoreceptors_time_constant() -> None:
    model = BASE + PhotoreceptorBandwidth(hz_per_fa=5.0, max_hz=2e4)
    with pytest.raises(InputError, match="not below the time constant of 20000 Hz"):
        events_of(model, step="euler")
    assert len(events_of(dataclasses.replace(model), step="exact")) > 0
