"""Light that drifts or flickers as a staircase, and what a high-pass remembers of it as a slope of each stair.

Between two edges the law of a pixel with two low-passes is that of blocks of samples; light that never rests would
have it go sample by sample. Stairs are edges like others. No longer the same distribution: a stair of flicker is
away from it by up to two fifths of its depth, many times in a period, and what a high-pass remembers of noise is left
out; all pixels have the memory of the mean pixel.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from sim_backend.pixel.chain import LOWEST_CURRENT_FA
from sim_backend.pixel.light import LightHistory
from sim_backend.pixel.light_path import ChipLight, commanded_light, flicker_phase, settled_ripple

if TYPE_CHECKING:
    import numpy.typing as npt

    from sim_backend.pixel.chain import Chain

    Floats = npt.NDArray[np.float64]

__all__ = ["cut_for_memory", "memory_slopes", "with_stairs"]

#: Stairs in a period of flicker at the least.
_STAIRS: Final = 7.0
#: and none is higher than this, relatively.
_HIGHEST: Final = 0.04
#: They have the heights of so many phases: equal stairs are the same light, whose law is worked out once.
_PHASES: Final = 64
#: Two stairs are equally high to so many digits.
_DIGITS: Final = 12
#: Height of a stair of drift, ln units.
_DRIFT_STAIR: Final = 0.005
#: The last stair before it is dark.
_DIMMEST: Final = 1e-4
#: Part of the high-pass's time constant in which what it remembers goes along a straight line; after so many time
#: constants it has settled.
_PART_OF_TAU: Final = 0.2
_SETTLED_TAUS: Final = 10.0


def with_stairs(
    chain: Chain, light: LightHistory, dt_s: float, seed: int, duration_s: float
) -> tuple[Chain, LightHistory]:
    """Return a chain without drift and flicker, and light that has them in stairs.

    A source with a rise time is left as it is: each stair would rise.
    """
    if max(chain.rise_tau_s, light.rise_tau_s) > 0.0 or chain.drift_per_s == chain.flicker_depth == 0.0:
        return chain, light
    light = commanded_light(chain, light)
    stair_s = _flicker_stair_s(chain, dt_s)
    flicker = stair_s * np.arange(1.0, duration_s / stair_s)
    t_s = _cut(light.t_s, np.concatenate([[dt_s], flicker, _drift_cuts(chain, duration_s)]))
    level = np.searchsorted(light.t_s, t_s, side="right") - 1
    middle = 0.5 * (t_s + np.append(t_s[1:], max(duration_s, t_s[-1])))
    ripple = _flicker(chain, seed, stair_s, middle)
    # Pixels memorise the light of t = 0, not that of the first stair.
    ripple[t_s < dt_s] = 1.0 + chain.flicker_depth * settled_ripple(chain, seed)
    factor = ripple * _drift(chain, middle)
    room = np.asarray(light.room_lux)[level]
    lux = np.maximum(light.lux[level] - room, 0.0) * factor + room
    steady = replace(chain, drift_per_s=0.0, flicker_depth=0.0, contrast_gain=1.0)
    return steady, LightHistory(t_s, lux, 0.0, np.asarray(light.nd_od)[level], room)


def cut_for_memory(chain: Chain, light: LightHistory, duration_s: float) -> LightHistory:
    """Return the same light with each level in parts, in which what a high-pass remembers goes along a line."""
    part_s = _PART_OF_TAU / (2.0 * math.pi * chain.high_pass_hz)
    slowest_hz = min(chain.high_pass_hz, chain.corner_hz, float(np.min(_receptor_hz(chain, light.lux))))
    settled_s = _SETTLED_TAUS / (2.0 * math.pi * slowest_hz)
    ends = np.append(light.t_s[1:], duration_s)
    parts = np.minimum(ends - light.t_s, settled_s) / part_s
    long = parts > 1.0
    cuts = [t + part_s * np.arange(1.0, n) for t, n in zip(light.t_s[long], parts[long], strict=True)]
    t_s = _cut(light.t_s, np.concatenate([np.empty(0), *cuts]))
    level = np.searchsorted(light.t_s, t_s, side="right") - 1
    nd_od, room = np.asarray(light.nd_od)[level], np.asarray(light.room_lux)[level]
    return LightHistory(t_s, light.lux[level], light.rise_tau_s, nd_od, room)


def memory_slopes(chain: Chain, light: LightHistory, dt_s: float, seed: int, duration_s: float) -> Floats:
    """(m,) by how much what the high-pass remembers grows in a sample of each level of the light.

    It follows the output of the source follower, ``dL/dt = w (V - L)``, that the photoreceptor,
    ``dV/dt = c (P - V)``, and that the settled level u, ``dP/dt = r (u - P)``. All have that of the mean pixel.
    """
    from sim_backend.pixel.engines.memory_kernels import remember

    on_chip = ChipLight(chain, light, dt_s, seed)
    settled = np.log(np.maximum(_current_fa(chain, on_chip.settled_lux), LOWEST_CURRENT_FA))
    w, c = (2.0 * math.pi * hz * dt_s for hz in (chain.high_pass_hz, chain.corner_hz))
    receptor = 2.0 * math.pi * dt_s * _receptor_hz(chain, on_chip.settled_lux)
    samples = np.diff(np.append(on_chip.first, max(round(duration_s / dt_s), on_chip.first[-1])))
    slopes = np.zeros(len(settled))
    remember(w, c, receptor, settled, samples, slopes)
    return slopes


def _current_fa(chain: Chain, lux: Floats) -> Floats:
    """Return the photocurrent of the mean pixel."""
    return np.asarray(float(np.mean(chain.gain_fa_per_lux)) * lux + float(np.mean(chain.dark_fa)))


def _receptor_hz(chain: Chain, lux: Floats) -> Floats:
    """Return the corner of the mean pixel's photoreceptor at each light; infinite without one."""
    current = np.maximum(_current_fa(chain, lux), LOWEST_CURRENT_FA)
    return np.minimum(chain.receptor_hz_per_fa * current, chain.receptor_max_hz)


def _cut(t_s: Floats, cuts: Floats) -> Floats:
    """Return the times of edges and cuts in order; two edges at one time stay two."""
    inside = cuts[(cuts > 0.0) & ~np.isin(cuts, t_s)]
    return np.sort(np.concatenate([t_s, inside]))


def _flicker_stair_s(chain: Chain, dt_s: float) -> float:
    """Return how long a stair is: 2^j samples, which are one block; without flicker longer than any recording."""
    if chain.flicker_depth == 0.0:
        return math.inf
    stairs = max(_STAIRS, 2.0 * math.pi * chain.flicker_depth / _HIGHEST)
    samples = max(1.0 / (stairs * chain.flicker_hz * dt_s), 1.0)
    return math.ldexp(dt_s, math.floor(math.log2(samples)))


def _flicker(chain: Chain, seed: int, stair_s: float, t_s: Floats) -> Floats:
    """Return the height of the stair at each time, to one of the phases.

    What low-passes leave of stairs is their first harmonic: that is as deep as the flicker if stairs are higher than
    it by as much as they lose, which is sinc(f T) for stairs of length T.
    """
    if chain.flicker_depth == 0.0:
        return np.ones(len(t_s))
    middle = (np.floor(t_s / stair_s) + 0.5) * stair_s
    turns = chain.flicker_hz * middle + flicker_phase(chain, seed) / (2.0 * math.pi)
    phase = np.mod(np.floor(turns * _PHASES), _PHASES) + 0.5
    height = np.sin(2.0 * math.pi * phase / _PHASES) / np.sinc(chain.flicker_hz * stair_s)
    return np.asarray(1.0 + np.round(chain.flicker_depth * height, _DIGITS))


def _drift_cuts(chain: Chain, duration_s: float) -> Floats:
    rate = chain.drift_per_s
    if rate == 0.0:
        return np.empty(0)
    sign = math.copysign(_DRIFT_STAIR, rate)
    end = max(1.0 + rate * duration_s, _DIMMEST)
    stairs = np.arange(1.0, math.log(end) / sign)
    dark = [-1.0 / rate] if 1.0 + rate * duration_s < 0.0 else []
    return np.append(np.expm1(sign * stairs) / rate, dark)


def _drift(chain: Chain, t_s: Floats) -> Floats:
    """Return the height of the stair at each time."""
    if chain.drift_per_s == 0.0:
        return np.ones(len(t_s))
    grown = 1.0 + chain.drift_per_s * t_s
    stair = np.floor(np.log(np.maximum(grown, _DIMMEST)) / _DRIFT_STAIR) + 0.5
    return np.where(grown > 0.0, np.exp(stair * _DRIFT_STAIR), 0.0)
