"""Compiled parts of the reference engine for pixels that have more than one low-pass and constant thresholds.

The same layout as :mod:`sim_backend.pixel.engines.reference_kernels`: groups of LANES pixels side by side, blocks of
BLOCK samples, random numbers by address. The light-independent noise has the same random numbers as there; each other
source has a purpose of its own in the third word of the counter.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from drivers.jit import lean_njit, njit
from sim_backend.pixel.engines.reference_kernels import (
    BLOCK,
    LANES,
    NEVER,
    PURPOSE_NOISE,
    lanes_to_look_at,
    larger,
    ln_f64,
    normal_pair,
    philox4x32,
)

PURPOSE_SHOT: Final = 2  #: shot noise, by blocks of four samples
PURPOSE_SLOW: Final = 3  #: slow noise, by blocks of four samples
PURPOSE_RESET: Final = 4  #: noise of a reset, by its sample
PURPOSE_START: Final = 5  #: photoreceptor, slow noise and high-pass at t = 0

_U32 = np.uint32


class Coefficients(NamedTuple):
    """Numbers that all pixels have in common; factors are for one sample."""

    rho: float  #: factor of the source follower
    sigma: float  #: rms of what the light-independent noise adds behind the source follower
    slow_rho: float  #: factor of the slow noise
    slow_sigma: float  #: rms of what is added to the slow noise
    high_rho: float  #: factor of the high-pass's memory; 1: no high-pass
    shot_fa: float  #: variance of the shot noise on ln I, times I, fA
    receptor_per_fa: float  #: dt over the photoreceptor's time constant, for each fA
    receptor_most: float  #: the highest such ratio
    euler: bool  #: the photoreceptor forgets 1 - ratio, not exp(-ratio)
    dt_s: float  #: length of a sample, s
    lowest_fa: float  #: the logarithm is taken of no less, fA
    reset_rms: float  #: rms of the noise of a reset


@lean_njit()
def exp_falling(x):  # type: ignore[no-untyped-def]
    """Return ``exp(-x)`` of x >= 0 to 1e-15; 0 above 700.

    ``exp(-x) = 2^-k exp(r)`` with r within half of ln 2; the power series of exp(r).
    """
    if x > 700.0:
        return 0.0
    k = math.floor(x / math.log(2.0) + 0.5)
    r = k * 0.6931471803691238 - x + k * 1.9082149292705877e-10  # ln 2 in two parts
    series = 1.0
    for i in range(14, 0, -1):
        series = 1.0 + series * r / i
    return series * np.int64((1023 - np.int64(k)) << 52).view(np.float64)


@njit(cache=True, nogil=True, error_model="numpy")
def fill_purpose(index, pixel, purpose, key0, key1, words, z):  # type: ignore[no-untyped-def]
    """Write four standard normal numbers for each lane: sample block `index` (int64), this purpose."""
    c0 = _U32(index)
    c3 = _U32(index >> 32)
    for lane in range(LANES):
        w0, w1, w2, w3 = philox4x32(c0, pixel[lane], purpose, c3, key0, key1)
        words[lane] = w0
        words[LANES + lane] = w1
        words[2 * LANES + lane] = w2
        words[3 * LANES + lane] = w3
    for lane in range(LANES):
        z0, z1 = normal_pair(words[lane], words[LANES + lane])
        z2, z3 = normal_pair(words[2 * LANES + lane], words[3 * LANES + lane])
        z[lane] = z0
        z[LANES + lane] = z1
        z[2 * LANES + lane] = z2
        z[3 * LANES + lane] = z3


@njit(cache=True, nogil=True, error_model="numpy")
def start_normals(pixel, key0, key1):  # type: ignore[no-untyped-def]
    """Return (3, n) standard normal numbers: for photoreceptor, slow noise and high-pass at t = 0."""
    out = np.empty((3, len(pixel)), np.float64)
    for i in range(len(pixel)):
        w0, w1, w2, w3 = philox4x32(_U32(0), pixel[i], _U32(PURPOSE_START), _U32(0), key0, key1)
        out[0, i], out[1, i] = normal_pair(w0, w1)
        out[2, i] = normal_pair(w2, w3)[0]
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def reset_normal(n, pixel, key0, key1):  # type: ignore[no-untyped-def]
    """Return the standard normal number of a reset of this pixel at sample n (int64)."""
    w0, w1, _, _ = philox4x32(_U32(n), pixel, _U32(PURPOSE_RESET), _U32(n >> 32), key0, key1)
    return np.float64(normal_pair(w0, w1)[0])


@njit(cache=True, nogil=True, error_model="numpy")
def reset_normals(n, pixel, key0, key1):  # type: ignore[no-untyped-def]
    """Return the number of :func:`reset_normal` for each pixel."""
    out = np.empty(len(pixel), np.float64)
    for i in range(len(pixel)):
        out[i] = reset_normal(np.int64(n), pixel[i], key0, key1)
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def fill_light(lux, n, gain, dark, c, u, shot, forget):  # type: ignore[no-untyped-def]
    """Write log photocurrent, rms of its shot noise and factor of the photoreceptor for samples n to n + 3."""
    for i in range(4):
        for lane in range(LANES):
            current = larger(gain[lane] * lux[n + i] + dark[lane], c.lowest_fa)
            u[i * LANES + lane] = ln_f64(current)
            shot[i * LANES + lane] = math.sqrt(c.shot_fa / current)
            ratio = -larger(-c.receptor_per_fa * current, -c.receptor_most)
            if c.euler and ratio < np.inf:
                forget[i * LANES + lane] = 1.0 - ratio
            else:
                forget[i * LANES + lane] = exp_falling(ratio)


@njit(cache=True, nogil=True, error_model="numpy")
def advance(row, seconds, leaked, leak, c, u, shot, forget, z, z_shot, z_slow, state, output):  # type: ignore[no-untyped-def]
    """Take sample `row` of four, `seconds` after the start of the recording.

    `state` has, one behind the other, source follower, photoreceptor, slow noise, memory of the high-pass, and the
    highest and lowest output of the block, of each lane.
    """
    for lane in range(LANES):
        k = row * LANES + lane
        p = forget[k] * state[LANES + lane] + (1.0 - forget[k]) * (u[k] + shot[k] * z_shot[k])
        v = c.rho * state[lane] + ((1.0 - c.rho) * p + c.sigma * z[k])
        slow = c.slow_rho * state[2 * LANES + lane] + c.slow_sigma * z_slow[k]
        memory = c.high_rho * state[3 * LANES + lane] + (1.0 - c.high_rho) * (v + slow)
        out = (v + slow) - memory + (leak[lane] * seconds + leaked)
        state[lane] = v
        state[LANES + lane] = p
        state[2 * LANES + lane] = slow
        state[3 * LANES + lane] = memory
        state[4 * LANES + lane] = larger(state[4 * LANES + lane], out)
        state[5 * LANES + lane] = -larger(-state[5 * LANES + lane], -out)
        output[lane] = out


@njit(cache=True, nogil=True, error_model="numpy")
def detect(lane, first, samples, output, thresholds, dead, pixel, c, key0, key1, levels, wake, events, count):  # type: ignore[no-untyped-def]
    """Follow one lane through a block, as in the other kernels; each reset has its noise."""
    for n in range(first, first + samples):
        value = output[(n - first) * LANES + lane]
        on = value >= levels[lane]
        if on or value <= levels[LANES + lane]:
            events[count, 0] = n
            events[count, 1] = lane
            events[count, 2] = on
            count += 1
            wake[lane] = n + dead[lane]
            levels[lane] = np.inf
            levels[LANES + lane] = -np.inf
        if wake[lane] == n:
            wake[lane] = NEVER
            if c.reset_rms > 0.0:
                value += c.reset_rms * reset_normal(np.int64(n), pixel[lane], key0, key1)
            levels[lane] = value + thresholds[0, lane]
            levels[LANES + lane] = value - thresholds[1, lane]
    return count


@njit(cache=True, nogil=True, error_model="numpy")
def run_group(first, stop, lux, steady, leaked, c, key0, key1, fixed, leak, dead, pixel, kept, levels, wake, events):  # type: ignore[no-untyped-def]
    """Take one group of lanes from sample `first` to `stop` - 1, or until `events` might run over.

    Parameters are those of the other kernels, and

    leaked
        Drift of D that all pixels share, ln units, at each sample from `first`.
    c
        :class:`Coefficients`.
    leak
        (LANES,) drift of D, ln units per s.
    kept
        (4 LANES,) source follower, photoreceptor, slow noise, memory of the high-pass. Changed.

    Returns
    -------
    The sample that comes next, and the number of events.
    """
    words = np.empty(4 * LANES, np.uint32)
    z = np.zeros(4 * LANES, np.float32)
    z_shot = np.zeros(4 * LANES, np.float32)
    z_slow = np.zeros(4 * LANES, np.float32)
    u = np.empty(4 * LANES, np.float64)
    shot = np.empty(4 * LANES, np.float64)
    forget = np.empty(4 * LANES, np.float64)
    output = np.empty(BLOCK * LANES, np.float64)
    state = np.empty(6 * LANES, np.float64)
    state[: 4 * LANES] = kept
    look = np.empty(LANES, np.bool_)
    filled_lux = np.nan
    count = 0
    n = first
    while n < stop and count + BLOCK * LANES <= len(events):
        state[4 * LANES : 5 * LANES] = -np.inf
        state[5 * LANES :] = np.inf
        still = steady[(n - first) // BLOCK]
        for block in range(0, BLOCK, 4):
            at = n - first + block
            if not (still and lux[at] == filled_lux):
                fill_light(lux, at, fixed[0], fixed[1], c, u, shot, forget)
                filled_lux = lux[at] if still else np.nan
            index = (n - 1 + block) // 4
            if c.sigma > 0.0:
                fill_purpose(index, pixel, _U32(PURPOSE_NOISE), key0, key1, words, z)
            if c.shot_fa > 0.0:
                fill_purpose(index, pixel, _U32(PURPOSE_SHOT), key0, key1, words, z_shot)
            if c.slow_sigma > 0.0:
                fill_purpose(index, pixel, _U32(PURPOSE_SLOW), key0, key1, words, z_slow)
            for row in range(4):
                seconds = (n + block + row) * c.dt_s
                begin = (block + row) * LANES
                advance(
                    row, seconds, leaked[at + row], leak, c, u, shot, forget, z, z_shot, z_slow, state,
                    output[begin : begin + LANES],
                )  # fmt: skip
        samples = min(BLOCK, stop - n)
        if lanes_to_look_at(state[3 * LANES :], levels, wake, n + samples, look) > 0:
            for lane in range(LANES):
                if look[lane]:
                    count = detect(
                        lane, n, samples, output, fixed[2:], dead, pixel, c, key0, key1, levels, wake, events, count
                    )
        n += samples
    kept[:] = state[: 4 * LANES]
    return n, count
