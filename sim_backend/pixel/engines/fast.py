"""The fast engine: from event to event instead of from sample to sample."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from protocols.errors import InputError
from sim_backend.pixel.engines.readout import read_out, together
from sim_backend.pixel.engines.reference import ReferenceEngine, samples_before
from sim_backend.pixel.engines.stepped_light import cut_for_memory, memory_slopes, with_stairs
from sim_backend.pixel.hooks import has_hooks

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

    from sim_backend.pixel.chain import Chain
    from sim_backend.pixel.engines.readout import Crossings
    from sim_backend.pixel.engines.stretches import Walk
    from sim_backend.pixel.light import LightHistory

__all__ = ["FastEngine", "is_faster"]


#: A shift of a level by less than this, in rms of the noise, is not followed.
_SEEN_RMS: Final = 1e-3


def is_faster(chain: Chain, dt_s: float) -> npt.NDArray[np.bool_]:
    """Return for each pixel whether going from event to event is possible, and cheaper than through all samples.

    Without noise it is not. Nor is it for a pixel that has an event every few hundred samples: its two thresholds
    less than 8 rms apart, and few samples in a time constant.
    """
    without_noise = chain.noise_rms == chain.slow_rms == chain.shot_factor == 0.0
    if without_noise or chain.high_pass_hz > 0.0 or has_hooks(chain):
        return np.zeros(chain.pixels, np.bool_)
    if _has_more_than_one_pole(chain):
        return np.full(chain.pixels, chain.drift_per_s == chain.flicker_depth == 0.0)
    if chain.noise_rms == 0.0:
        return np.zeros(chain.pixels, np.bool_)
    rate = 2.0 * math.pi * chain.corner_hz * dt_s
    apart = (chain.theta_on + chain.theta_off) / chain.noise_rms
    return np.asarray((apart >= 8.0) | (apart**2 / 40.0 >= 40.0 * rate))


def _are_alike(chain: Chain) -> bool:
    """Return whether the light is the same to all pixels."""
    return float(np.ptp(chain.dark_fa)) == float(np.ptp(chain.gain_fa_per_lux)) == 0.0


def _has_a_second_memory(chain: Chain) -> bool:
    """Return whether anything but the source follower remembers."""
    return math.isfinite(min(chain.receptor_hz_per_fa, chain.receptor_max_hz)) or chain.slow_rms > 0.0


def _has_more_than_one_pole(chain: Chain) -> bool:
    """Return whether noise follows the light, or anything but the source follower remembers."""
    return chain.shot_factor > 0.0 or _has_a_second_memory(chain)


def _is_shot_noise_alone(chain: Chain, light: LightHistory) -> bool:
    """Return whether only shot noise, in light that goes from level to level, keeps a pixel from having one low-pass.

    Between two edges its noise is then that of another floor.
    """
    rests = max(chain.rise_tau_s, light.rise_tau_s) == chain.drift_per_s == chain.flicker_depth == 0.0
    return rests and chain.noise_rms > 0.0 and not _has_a_second_memory(chain)


def _leak_follows_moving_light(chain: Chain, light: LightHistory) -> bool:
    """Return whether a leak in proportion to the light has anything of moving light that can be seen."""
    if chain.leak_per_s_per_lux == 0.0:
        return False
    if not chain.drift_per_s == chain.flicker_depth == 0.0:
        return True
    away = chain.leak_per_s_per_lux * float(np.max(light.lux)) * max(chain.rise_tau_s, light.rise_tau_s)
    return away > _SEEN_RMS * chain.noise_rms


@dataclass(frozen=True, slots=True)
class FastEngine:
    """The distribution of events of ``ReferenceEngine(step="exact")`` on the same grid, at a fraction of the cost.

    Pixels for which the reference engine is cheaper (:func:`is_faster`) are given to it: without noise the events are
    identical to its own. The same seed gives the same events of a pixel, whatever the number of threads and the other
    pixels; other events than the reference engine's, since fewer random numbers are drawn.

    Parameters
    ----------
    dt_s
        Length of a sample, s.
    threads
        Number of threads; None for as many as there are processors for this process.
    quiet_high_pass
        Up to this corner of a high-pass, beside that of the source follower, what it remembers of the noise is left
        out, and only its share of the variance is taken off; slow noise also becomes quicker. That is some twenty
        times as fast, and no longer the same distribution.
    steady_leak
        A leak that follows the light follows its levels, not how these drift, flicker or rise. Beside the leak of a
        level that is little, and it is hundreds of times as fast; but no longer the same distribution.
    stepped_light
        Drift and flicker of the light go in small steps, for all pixels; what a high-pass remembers (see
        `quiet_high_pass`) follows the light alone, along short lines, and that of the mean pixel where there is more
        than one low-pass. That is up to tens of times as fast, most of all with few pixels or more than one low-pass;
        but no longer the same distribution: see :mod:`sim_backend.pixel.engines.stepped_light`, and
        :mod:`sim_backend.pixel.engines.stairs_kernels` for quiet pixels beside flicker.
    """

    dt_s: float = 1e-5
    threads: int | None = None
    quiet_high_pass: float = 0.0
    steady_leak: bool = False
    stepped_light: bool = False

    def __post_init__(self) -> None:
        if not 0.0 < self.dt_s < math.inf:
            raise InputError(f"fast engine: dt is {self.dt_s} s; expected more than 0")
        if self.threads is not None and self.threads < 1:
            raise InputError(f"fast engine: {self.threads} threads; expected 1 or more")

    def events(
        self, chain: Chain, light: LightHistory, duration_s: float, seed: int
    ) -> Iterator[npt.NDArray[np.void]]:
        """Yield the events of a recording; as :meth:`ReferenceEngine.events`."""
        return read_out(chain, seed, duration_s, self.crossings(chain, light, duration_s, seed))

    def crossings(self, chain: Chain, light: LightHistory, duration_s: float, seed: int) -> Crossings:
        """Yield what the comparators find, in stretches of time; parameters are those of :meth:`events`."""
        from sim_backend.pixel.engines.one_pole import OnePole
        from sim_backend.pixel.engines.stretches import crossings
        from sim_backend.pixel.engines.two_poles import TwoPoles

        chain = _with_injection_in_thresholds(chain)
        flickers = self.stepped_light and chain.flicker_depth > 0.0
        if self.stepped_light:
            chain, light = with_stairs(chain, light, self.dt_s, seed, duration_s)
        quiet = self._without_noise_in_high_pass(chain)
        slopes = None
        if quiet is not None and self.stepped_light and (_are_alike(chain) or _has_more_than_one_pole(chain)):
            light = cut_for_memory(chain, light, duration_s)
            slopes = memory_slopes(chain, light, self.dt_s, seed, duration_s)
            quiet = replace(quiet, high_pass_hz=0.0)
        fast = is_faster(chain if quiet is None else replace(quiet, high_pass_hz=0.0), self.dt_s)
        if fast.any() and not self.steady_leak and _leak_follows_moving_light(chain, light):
            fast[:] = False
        streams: list[Crossings] = []
        if fast.any():
            some = _some_pixels(quiet or chain, fast)
            walk: Walk
            if _has_more_than_one_pole(chain) and not _is_shot_noise_alone(chain, light):
                walk = TwoPoles(some, light, self.dt_s, seed, slopes)
            else:
                walk = OnePole(some, light, self.dt_s, seed, slopes, in_stairs=flickers)
            streams.append(crossings(walk, samples_before(duration_s, self.dt_s), self.threads))
        if not fast.all():
            reference = ReferenceEngine(dt_s=self.dt_s, threads=self.threads)
            streams.append(reference.crossings(_some_pixels(chain, ~fast), light, duration_s, seed))
        return streams[0] if len(streams) == 1 else together(streams)

    def _without_noise_in_high_pass(self, chain: Chain) -> Chain | None:
        """Return the chain with the noise that a high-pass leaves over, if that may be left out.

        Of the variance of noise behind a low-pass of corner f, a high-pass of corner h leaves the share f / (f + h).
        Slow noise passes by itself: see :func:`_slow_share`.
        """
        if not 0.0 < chain.high_pass_hz <= self.quiet_high_pass * chain.corner_hz:
            return None
        if _has_more_than_one_pole(chain) and not self.stepped_light:
            return None
        left = chain.corner_hz / (chain.corner_hz + chain.high_pass_hz)
        chain = replace(chain, noise_rms=chain.noise_rms * math.sqrt(left), shot_factor=chain.shot_factor * left)
        if chain.slow_rms == 0.0:
            return chain
        share = _slow_share(2.0 * math.pi * chain.high_pass_hz * chain.slow_tau_s)
        return replace(chain, slow_rms=chain.slow_rms * math.sqrt(share), slow_tau_s=chain.slow_tau_s * share)


def _slow_share(q: float) -> float:
    """Return the share that a high-pass leaves of slow noise: of its variance, and of its time.

    Noise of the covariance ``exp(-t)`` behind a high-pass of the rate q has ``(exp(-t) - q exp(-q t)) / (1 - q^2)``
    (the partial fractions of both): a variance of 1 / (1 + q), and a dip below nothing, so that after that time it is
    farther from where it was than later. Exponential covariance that is as far away at the dip, and goes as fast at
    first, is what is returned.
    """
    log = -1.0 if q == 1.0 else math.log(q) / (1.0 - q)
    dip = math.exp(2.0 * log) / q
    return (1.0 + dip) / (1.0 + q)


def _with_injection_in_thresholds(chain: Chain) -> Chain:
    """Return a chain with the same events: an offset of the memorised level moves both thresholds against it."""
    offset = chain.injection_ln
    if offset == 0.0:
        return chain
    return replace(chain, theta_on=chain.theta_on + offset, theta_off=chain.theta_off - offset, injection_ln=0.0)


def _some_pixels(chain: Chain, which: npt.NDArray[np.bool_]) -> Chain:
    """Return the chain of some of its pixels."""
    if which.all():
        return chain
    arrays: dict[str, Any] = {}
    for f in fields(chain):
        value = getattr(chain, f.name)
        if isinstance(value, np.ndarray):
            arrays[f.name] = value[which]
    return replace(chain, **arrays)
