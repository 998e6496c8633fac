"""The settings at which the engines are compared: one table for tests and benchmarks."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from drivers.events.types import EVENT_DTYPE
from sim_backend.pixel.chain import Chain, build_chain
from sim_backend.pixel.effects import (
    ComparatorDelay,
    ContrastError,
    Crosstalk,
    DarkCurrent,
    HighPass,
    HotPixels,
    InjectionOffset,
    Leak,
    LightDrift,
    LightFlicker,
    LightRiseTime,
    LowFrequencyNoise,
    NdError,
    ParasiticPhotocurrent,
    PhotoreceptorBandwidth,
    RefractoryMismatch,
    ResetNoise,
    ShotNoise,
    StrayLight,
    ThresholdMismatch,
    TimestampJitter,
)
from sim_backend.pixel.engines.compare import Pulses
from sim_backend.pixel.light import LightHistory
from sim_backend.pixel.model import PixelModel

if TYPE_CHECKING:
    import numpy.typing as npt

    from protocols.points import Roi
    from sim_backend.pixel.engines.base import Engine

__all__ = ["SETTINGS", "Setting", "Stimulus", "constant", "reset_test", "setting", "square"]

_LUX: Final = 10.0
_PERIOD_S: Final = 0.2
_THETA: Final = 0.3
#: Effects with a memory of their own.
_MEMORIES: Final = frozenset({"photoreceptor_bandwidth", "low_frequency_noise", "high_pass"})
#: Stands for the individual sensor.
_SENSOR_SEED: Final = 3


@dataclass(frozen=True, slots=True)
class Stimulus:
    """A light that repeats its period; the bright pulse is the latter half of it."""

    kind: str  #: square, reset and test, or constant
    starts_s: tuple[float, ...]  #: of each level in the period, s; the first is 0
    log_contrasts: tuple[float, ...]  #: of each level to the baseline
    lux: float = _LUX  #: baseline, on the chip
    nd_od: float = 0.0  #: filter that is in
    period_s: float = _PERIOD_S  #: s

    def light(self, periods: int) -> LightHistory:
        """Return the light of some periods."""
        if len(self.starts_s) == 1:
            return LightHistory.constant(self.lux, nd_od=self.nd_od)
        t_s = (np.arange(periods)[:, None] * self.period_s + np.array(self.starts_s)).ravel()
        return LightHistory(t_s, np.tile(self.lux * np.exp(self.log_contrasts), periods), nd_od=self.nd_od)


def square(log_contrast: float, lux: float = _LUX, nd_od: float = 0.0) -> Stimulus:
    """Return a square wave of 5 Hz."""
    return Stimulus("square", (0.0, 0.1), (0.0, log_contrast), lux, nd_od)


def reset_test(log_contrast: float) -> Stimulus:
    """Return reset pulses of 50 % and 40 ms, and test pulses, in turn."""
    return Stimulus("reset and test", (0.0, 0.02, 0.06, 0.1), (0.0, math.log(1.5), 0.0, log_contrast))


def constant(lux: float = _LUX, period_s: float = _PERIOD_S) -> Stimulus:
    """Return light that never changes; its periods and pulses are only for counting."""
    return Stimulus("constant", (0.0,), (0.0,), lux, period_s=period_s)


@dataclass(frozen=True, slots=True)
class Setting:
    """A pixel and a stimulus."""

    name: str
    purpose: str  #: what it is for, in one line
    model: PixelModel
    stimulus: Stimulus
    tile: int = 1  #: 1: all pixels are independent; else they stand in squares this wide, with a gap between them

    @property
    def poles(self) -> int:
        """Number of low-passes and of slow processes: the source follower, and what has a memory beside it."""
        return 1 + sum(e.id in _MEMORIES for e in self.model.effects)

    @property
    def apart(self) -> float:
        """Lower threshold over the rms of the noise that does not depend on the light."""
        return min(self.model.theta_on, self.model.theta_off) / self.model.noise_rms

    def chain(self, roi: Roi) -> Chain:
        """Return the chain of the pixels of a window; without those in the gaps between tiles."""
        chain = build_chain(self.model, roi, _SENSOR_SEED)
        if self.tile == 1:
            return chain
        last = self.tile - 1
        kept = ((chain.x - roi.x) % self.tile < last) & ((chain.y - roi.y) % self.tile < last)
        values = {f.name: getattr(chain, f.name) for f in fields(chain)}
        arrays: dict[str, Any] = {k: v[kept] for k, v in values.items() if isinstance(v, np.ndarray)}
        return replace(chain, **arrays)

    def pulses(self, roi: Roi, pixel_seconds: float) -> Pulses:
        """Return the pulses of a recording of this many pixels times seconds, or a little more."""
        periods = math.ceil(pixel_seconds / (self.chain(roi).pixels * self.stimulus.period_s))
        return Pulses(roi, self.stimulus.period_s, 0.5 * self.stimulus.period_s, periods, self.tile)

    def events(self, engine: Engine, pulses: Pulses, seed: int) -> npt.NDArray[np.void]:
        """Return the events of a recording."""
        light = self.stimulus.light(pulses.periods)
        parts = engine.events(self.chain(pulses.roi), light, pulses.duration_s, seed)
        return np.concatenate([np.empty(0, EVENT_DTYPE), *parts])


def _noisy(
    corner_hz: float, refractory_s: float, apart: float = 4.5, theta_on: float = _THETA, theta_off: float = _THETA
) -> PixelModel:
    """Return a pixel whose noise has the rms of a threshold of 0.3 over `apart`."""
    return PixelModel(
        noise_rms=_THETA / apart,
        corner_hz=corner_hz,
        refractory_s=refractory_s,
        theta_on=theta_on,
        theta_off=theta_off,
    )


_MEAN_DARK_FA: Final = 3.72
_DARK: Final = DarkCurrent(mean_fa=_MEAN_DARK_FA, spread=0.2)
_MISMATCH: Final = ThresholdMismatch(sigma_on=0.01, sigma_off=0.01)
_RECEPTOR: Final = PhotoreceptorBandwidth(hz_per_fa=5.0, max_hz=3000.0)
_STATION: Final = _noisy(200.0, 5e-3, 6.0, theta_off=0.25) + _DARK + _MISMATCH + LightRiseTime(tau_s=1e-4)
_LOW_LUX: Final = 0.15  # as much photocurrent as dark current
_LOW_STEP: Final = 0.55  # log contrast that is a step of 0.31 of the total current there

_PLAIN: Final = (
    Setting("2 kHz, 10 ms", "fast pixel, dead time far beyond its memory", _noisy(2000.0, 1e-2), square(0.3)),
    Setting("2 kHz, 0.1 ms", "fast pixel, dead time of one time constant", _noisy(2000.0, 1e-4), square(0.3)),
    Setting("200 Hz, 10 ms", "the paper's corner and its long dead time", _noisy(200.0, 1e-2), square(0.3)),
    Setting("200 Hz, 0.1 ms", "memorises on the slope of the step", _noisy(200.0, 1e-4), square(0.3)),
    Setting("50 Hz, 10 ms", "slow pixel, dead time of three time constants", _noisy(50.0, 1e-2), square(0.3)),
    Setting("50 Hz, 0.1 ms", "slow pixel, bursts of noise events", _noisy(50.0, 1e-4), square(0.3)),
    Setting("5 Hz, 10 ms", "the step is never settled", _noisy(5.0, 1e-2), square(0.32)),
    Setting("5 Hz, large step", "several events on one slope", _noisy(5.0, 1e-4, 6.0), square(1.2)),
    Setting("200 Hz, theta/rms 6", "quiet pixel, rare events far out", _noisy(200.0, 1e-2, 6.0), square(0.24)),
    Setting("200 Hz, theta/rms 2.5", "noise events everywhere", _noisy(200.0, 1e-3, 2.5), square(0.2)),
    Setting("2 kHz, reset/test", "three edges in a period, fast", _noisy(2000.0, 1e-4), reset_test(0.27)),
    Setting("200 Hz, reset/test", "unequal thresholds", _noisy(200.0, 1e-3, theta_off=0.25), reset_test(0.25)),
    Setting("50 Hz, reset/test", "the reset is not settled at the test", _noisy(50.0, 1e-2), reset_test(0.27)),
    Setting("2 kHz, constant", "noise events of a fast pixel", _noisy(2000.0, 1e-4), constant()),
    Setting("200 Hz, constant", "noise events, long dead time", _noisy(200.0, 1e-2, 4.2), constant()),
    Setting("50 Hz, constant", "noise events in bursts", _noisy(50.0, 1e-4), constant()),
    Setting("5 Hz, constant", "noise events with a memory of many", _noisy(5.0, 1e-2, 4.0), constant()),
    Setting("50 Hz, very noisy", "both thresholds within reach at once", _noisy(50.0, 1e-3, 2.5), constant()),
)

_WITH_EFFECTS: Final = (
    Setting(
        "rise 0.1 ms", "light still moves at the first samples of an edge",
        _noisy(200.0, 1e-2) + LightRiseTime(tau_s=1e-4), square(0.3),
    ),
    Setting(
        "rise 1 ms", "light slower than the pixel", _noisy(2000.0, 1e-3) + LightRiseTime(tau_s=1e-3), square(0.3)
    ),
    Setting(
        "dark current, low light", "each pixel has another step", _noisy(200.0, 1e-2) + _DARK + _MISMATCH
        + StrayLight(illuminance_lux=0.01), square(_LOW_STEP, _LOW_LUX),
    ),
    Setting(
        "leak", "leak at the upper end, different in each pixel",
        _noisy(200.0, 1e-2) + Leak(rate_per_s=0.2, spread=0.3), square(0.28),
    ),
    Setting(
        "strong leak, constant", "regular ON events, thresholds that move in a quiet pixel",
        _noisy(200.0, 1e-3, 6.0) + Leak(rate_per_s=0.5) + ParasiticPhotocurrent(rate_per_s_per_lux=0.02), constant(),
    ),
    Setting(
        "parasitic photocurrent", "a leak that follows the light",
        _noisy(200.0, 1e-3) + ParasiticPhotocurrent(rate_per_s_per_lux=0.02), square(0.3),
    ),
    Setting(
        "refractory mismatch", "dead times of 1 to 10 ms",
        _noisy(200.0, 3e-3, 3.5) + RefractoryMismatch(spread=0.4), square(0.35),
    ),
    Setting("reset noise", "noisy references", _noisy(200.0, 1e-2) + ResetNoise(rms=0.03), square(0.25)),
    Setting(
        "reset noise, constant", "references far out fire at once",
        _noisy(2000.0, 1e-4, 6.0) + ResetNoise(rms=0.05), constant(),
    ),
    Setting(
        "injection offset", "thresholds move against each other", _noisy(200.0, 1e-2) + InjectionOffset(offset=0.02),
        square(0.3),
    ),
    Setting(
        "drift", "light that rises all the time", _noisy(200.0, 1e-2) + LightDrift(rate_per_s=0.2), square(0.28)
    ),
    Setting(
        "drift, constant", "falling light, quiet pixel", _noisy(200.0, 1e-3, 5.0) + LightDrift(rate_per_s=-0.02),
        constant(),
    ),
    Setting(
        "flicker", "light that never rests under pulses",
        _noisy(200.0, 1e-2) + LightFlicker(depth=0.02, frequency_hz=100.0, phase=1.0), square(0.27),
    ),
    Setting(
        "flicker, constant", "events locked to its phase",
        _noisy(200.0, 1e-3) + LightFlicker(depth=0.05, frequency_hz=100.0, phase=1.0), constant(period_s=0.01),
    ),
    Setting(
        "slow noise", "events in runs, correlated over many pulses",
        _noisy(200.0, 1e-2, 5.0) + LowFrequencyNoise(rms=0.06, tau_s=0.5), square(0.28),
    ),
    Setting("high-pass", "the step fades", _noisy(200.0, 1e-2) + HighPass(corner_hz=1.0), square(0.32)),
    Setting(
        "comparator delay", "events and dead times begin late",
        _noisy(2000.0, 1e-4) + ComparatorDelay(delay_s=1e-4), square(0.32),
    ),
    Setting(
        "hot pixels, crosstalk, jitter", "what happens behind the comparators",
        _noisy(200.0, 1e-3) + HotPixels(fraction=0.02, rate_hz=20.0) + Crosstalk(probability=0.1)
        + TimestampJitter(sigma_s=5e-5), square(0.3), tile=4,
    ),
    Setting(
        "ND filter, contrast error", "the light is not what was commanded",
        _noisy(200.0, 1e-2) + NdError(delta_od=0.05) + ContrastError(gain_error=0.05) + _DARK,
        square(_LOW_STEP, _LOW_LUX, nd_od=2.0),
    ),
    Setting(
        "shot noise, one pole", "noise that follows the light", _noisy(200.0, 1e-2, 6.0) + ShotNoise() + _DARK,
        square(0.35, 1.0),
    ),
    Setting(
        "gross shot noise, low light", "noise that each edge changes, beside all that counts in its units",
        _noisy(100.0, 3e-3, 8.0, theta_off=0.25) + ShotNoise(factor=0.3) + _DARK + Leak(rate_per_s=0.2, spread=0.3)
        + ParasiticPhotocurrent(rate_per_s_per_lux=0.2) + ResetNoise(rms=0.03), square(0.4, 0.3),
    ),
    Setting(
        "photoreceptor, no shot noise", "two poles of one speed", _noisy(200.0, 1e-2) + _RECEPTOR + _DARK,
        square(0.31, 1.4),
    ),
    Setting(
        "two poles, high light", "photoreceptor faster than the source follower",
        _noisy(200.0, 1e-2, 6.0) + ShotNoise() + _RECEPTOR, square(0.28),
    ),
    Setting(
        "two poles, low light", "photoreceptor slower than the source follower, and follows the light",
        _noisy(200.0, 1e-2, 6.0) + ShotNoise() + _RECEPTOR + _DARK, square(_LOW_STEP, _LOW_LUX),
    ),
    Setting(
        "two poles, fast", "source follower of 2 kHz, noise of the photoreceptor alone matters",
        _noisy(2000.0, 1e-3, 10.0) + ShotNoise() + _RECEPTOR + _DARK, square(0.6, 0.3),
    ),
    Setting(
        "two poles, constant", "noise events of two poles near the dark limit",
        _noisy(200.0, 1e-3, 6.0) + ShotNoise() + _RECEPTOR + _DARK, constant(_LOW_LUX),
    ),
    Setting("default station", "what the simulated bench has", _STATION, square(0.3)),
    Setting("default station, low light", "the same near its dark limit", _STATION, square(_LOW_STEP, _LOW_LUX)),
    Setting("default station, constant", "its background", _STATION, constant()),
    Setting(
        "everything", "all effects at once",
        _STATION + ShotNoise() + _RECEPTOR + LowFrequencyNoise(rms=0.02) + HighPass(corner_hz=0.5)
        + Leak(rate_per_s=0.05, spread=0.3) + ResetNoise(rms=0.01) + InjectionOffset(offset=0.01)
        + RefractoryMismatch(spread=0.2) + LightFlicker(depth=0.01, phase=1.0) + LightDrift(rate_per_s=1e-3)
        + ComparatorDelay(delay_s=2e-5) + TimestampJitter(sigma_s=2e-5), square(0.4, 1.0),
    ),
)  # fmt: skip

#: All settings, in the order in which they are shown.
SETTINGS: Final[tuple[Setting, ...]] = (*_PLAIN, *_WITH_EFFECTS)


def setting(name: str) -> Setting:
    """Return the setting of that name."""
    return next(s for s in SETTINGS if s.name == name)
