"""Compiled parts of the reference engine: random numbers, the low-pass, and the comparators.

Pixels are taken in groups of :data:`LANES`, which go through time side by side, so that the compiler turns each
loop over lanes into vector instructions. Time is taken in blocks of :data:`BLOCK` samples: first the output of the
low-pass is computed for the whole block, with its highest and lowest value in each lane; then only lanes that can
have an event are looked at sample by sample. The output of the low-pass does not depend on events, so this is the
sample-by-sample form, in another order.

Random numbers are addressed, not drawn in turn: Philox4x32-10 with the recording's seed as key and (block of four
samples, pixel, purpose) as counter. There is no fast-math: the same seed gives the same bits on each machine.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from drivers.jit import njit

LANES: Final = 64  #: pixels that go through time side by side
BLOCK: Final = 32  #: samples between two looks at the comparators; a multiple of 4
NEVER: Final = np.iinfo(np.int64).max  #: the lane is not blind

PURPOSE_NOISE: Final = 0  #: third word of the counter: noise before the low-pass
PURPOSE_START: Final = 1  #: third word of the counter: output of the low-pass at t = 0

_U32 = np.uint32
_F32 = np.float32

_MULTIPLIER_0 = np.uint64(0xD2511F53)
_MULTIPLIER_1 = np.uint64(0xCD9E8D57)
_WEYL_0 = np.uint32(0x9E3779B9)
_WEYL_1 = np.uint32(0xBB67AE85)
_SHIFT_32 = np.uint64(32)


@njit(cache=True, nogil=True, error_model="numpy")
def philox_round(c0, c1, c2, c3, key0, key1):  # type: ignore[no-untyped-def]
    """Return the counter after one round. Each step is cast back to 32 bits, because numba widens them to 64."""
    p0 = np.uint64(c0) * _MULTIPLIER_0
    p1 = np.uint64(c2) * _MULTIPLIER_1
    high0 = _U32(p0 >> _SHIFT_32)
    high1 = _U32(p1 >> _SHIFT_32)
    return _U32(_U32(high1 ^ c1) ^ key0), _U32(p1), _U32(_U32(high0 ^ c3) ^ key1), _U32(p0)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def philox4x32(c0, c1, c2, c3, key0, key1):  # type: ignore[no-untyped-def]
    """Return the four random words at a counter; all are uint32.

    Inlined by numba itself: the compiler's own inlining comes too late for loops over it to become vector code.

    Source: J. K. Salmon, M. A. Moraes, R. O. Dror, D. E. Shaw, "Parallel random numbers: as easy as 1, 2, 3", SC11
    (2011).
    """
    for _ in range(10):
        c0, c1, c2, c3 = philox_round(c0, c1, c2, c3, key0, key1)
        key0 = _U32(key0 + _WEYL_0)
        key1 = _U32(key1 + _WEYL_1)
    return c0, c1, c2, c3


@njit(cache=True, nogil=True, error_model="numpy")
def ln_f32(x):  # type: ignore[no-untyped-def]
    """Return the logarithm of a positive, normal float32, to 1e-7.

    x = 2^e m with m from sqrt(1/2) to sqrt(2), ln m = 2 artanh(s) with s = (m - 1) / (m + 1), as a power series in s.
    """
    bits = _F32(x).view(np.int32)
    exponent = np.int32(np.int32(bits - np.int32(0x3F3504F3)) >> np.int32(23))
    m = np.int32(bits - np.int32(exponent << np.int32(23))).view(np.float32)
    s = _F32(_F32(m - _F32(1.0)) / _F32(m + _F32(1.0)))
    q = _F32(s * s)
    series = _F32(1.0 / 9.0)
    series = _F32(_F32(series * q) + _F32(1.0 / 7.0))
    series = _F32(_F32(series * q) + _F32(1.0 / 5.0))
    series = _F32(_F32(series * q) + _F32(1.0 / 3.0))
    series = _F32(_F32(series * q) + _F32(1.0))
    return _F32(_F32(_F32(2.0) * _F32(s * series)) + _F32(_F32(exponent) * _F32(math.log(2.0))))


@njit(cache=True, nogil=True, error_model="numpy")
def ln_f64(x):  # type: ignore[no-untyped-def]
    """Return the logarithm of a positive, normal float64, to 1e-15; the method of :func:`ln_f32`."""
    bits = np.float64(x).view(np.int64)
    exponent = (bits - np.int64(0x3FE6A09E667F3BCD)) >> np.int64(52)
    m = np.int64(bits - (exponent << np.int64(52))).view(np.float64)
    s = (m - 1.0) / (m + 1.0)
    q = s * s
    series = 1.0 / 21.0
    series = series * q + 1.0 / 19.0
    series = series * q + 1.0 / 17.0
    series = series * q + 1.0 / 15.0
    series = series * q + 1.0 / 13.0
    series = series * q + 1.0 / 11.0
    series = series * q + 1.0 / 9.0
    series = series * q + 1.0 / 7.0
    series = series * q + 1.0 / 5.0
    series = series * q + 1.0 / 3.0
    series = series * q + 1.0
    return 2.0 * (s * series) + np.float64(exponent) * math.log(2.0)


@njit(cache=True, nogil=True, error_model="numpy")
def sine_f32(x):  # type: ignore[no-untyped-def]
    """Return the sine of a float32 from -pi/4 to pi/4, to 1e-7: the first terms of its power series."""
    q = _F32(x * x)
    series = _F32(1.0 / 362880.0)
    series = _F32(_F32(series * q) - _F32(1.0 / 5040.0))
    series = _F32(_F32(series * q) + _F32(1.0 / 120.0))
    series = _F32(_F32(series * q) - _F32(1.0 / 6.0))
    series = _F32(_F32(series * q) + _F32(1.0))
    return _F32(series * x)


@njit(cache=True, nogil=True, error_model="numpy")
def cosine_f32(x):  # type: ignore[no-untyped-def]
    """Return the cosine of a float32 from -pi/4 to pi/4, to 1e-7: the first terms of its power series."""
    q = _F32(x * x)
    series = _F32(1.0 / 40320.0)
    series = _F32(_F32(series * q) - _F32(1.0 / 720.0))
    series = _F32(_F32(series * q) + _F32(1.0 / 24.0))
    series = _F32(_F32(series * q) - _F32(1.0 / 2.0))
    return _F32(_F32(series * q) + _F32(1.0))


@njit(cache=True, nogil=True, error_model="numpy")
def normal_pair(a, b):  # type: ignore[no-untyped-def]
    """Return two standard normal float32 numbers made of two random words: Box-Muller, to 6.6 sigma.

    The radius is made of 31 bits of `a`. The lower 30 bits of `b` are an angle within an eighth of a turn from the
    axis, its upper two turn it by half a turn and swap the two coordinates, which makes the circle whole.
    """
    u = _F32(_F32(_F32(np.int32(a >> _U32(1))) + _F32(0.5)) * _F32(2.0**-31))
    radius = _F32(math.sqrt(_F32(_F32(-2.0) * ln_f32(u))))
    angle = _F32(_F32(np.int32(_U32(b << _U32(2)))) * _F32(math.pi / 2.0**33))
    along = cosine_f32(angle)
    across = sine_f32(angle)
    half_turn = _U32(_U32(b >> _U32(30)) & _U32(1)) != _U32(0)
    swap = _U32(b >> _U32(31)) != _U32(0)
    signed = _F32(-radius if half_turn else radius)
    return _F32(signed * _F32(across if swap else along)), _F32(signed * _F32(along if swap else across))


@njit(cache=True, nogil=True, error_model="numpy")
def fill_words(index, pixel, key0, key1, words):  # type: ignore[no-untyped-def]
    """Write the four noise words of sample block `index` (int64) of each lane, first words first."""
    c0 = _U32(index)
    c3 = _U32(index >> 32)
    for lane in range(LANES):
        w0, w1, w2, w3 = philox4x32(c0, pixel[lane], _U32(PURPOSE_NOISE), c3, key0, key1)
        words[lane] = w0
        words[LANES + lane] = w1
        words[2 * LANES + lane] = w2
        words[3 * LANES + lane] = w3


@njit(cache=True, nogil=True, error_model="numpy")
def fill_normals(words, z):  # type: ignore[no-untyped-def]
    """Make the words of :func:`fill_words` into standard normal numbers, in the same order."""
    for lane in range(LANES):
        z0, z1 = normal_pair(words[lane], words[LANES + lane])
        z2, z3 = normal_pair(words[2 * LANES + lane], words[3 * LANES + lane])
        z[lane] = z0
        z[LANES + lane] = z1
        z[2 * LANES + lane] = z2
        z[3 * LANES + lane] = z3


@njit(cache=True, nogil=True, error_model="numpy")
def start_normals(pixel, key0, key1):  # type: ignore[no-untyped-def]
    """Return one standard normal number for each pixel, for its output at t = 0."""
    out = np.empty(len(pixel), np.float64)
    for i in range(len(pixel)):
        w0, w1, _, _ = philox4x32(_U32(0), pixel[i], _U32(PURPOSE_START), _U32(0), key0, key1)
        out[i] = normal_pair(w0, w1)[0]
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def larger(a, b):  # type: ignore[no-untyped-def]
    """Return the larger of two numbers."""
    return a if a > b else b


@njit(cache=True, nogil=True, error_model="numpy")
def fill_pull(lux, n, gain, dark, lowest, weight, pull):  # type: ignore[no-untyped-def]
    """Write ``weight ln(max(gain E + dark, lowest))``, what the light adds in one sample, for samples n to n + 3."""
    for i in range(4):
        for lane in range(LANES):
            current = gain[lane] * lux[n + i] + dark[lane]
            pull[i * LANES + lane] = weight * ln_f64(current if current > lowest else lowest)


@njit(cache=True, nogil=True, error_model="numpy")
def low_pass(rho, sigma, pull, z, state, output):  # type: ignore[no-untyped-def]
    """Take four samples ``v <- rho v + pull + sigma z``, kept in `output`, and the extremes of the block.

    `state` has v of each lane, then the highest v, then the lowest.
    """
    for lane in range(LANES):
        a = rho * state[lane] + (pull[lane] + sigma * z[lane])
        b = rho * a + (pull[LANES + lane] + sigma * z[LANES + lane])
        c = rho * b + (pull[2 * LANES + lane] + sigma * z[2 * LANES + lane])
        d = rho * c + (pull[3 * LANES + lane] + sigma * z[3 * LANES + lane])
        output[lane] = a
        output[LANES + lane] = b
        output[2 * LANES + lane] = c
        output[3 * LANES + lane] = d
        state[lane] = d
        state[LANES + lane] = larger(state[LANES + lane], larger(larger(a, b), larger(c, d)))
        state[2 * LANES + lane] = -larger(-state[2 * LANES + lane], larger(larger(-a, -b), larger(-c, -d)))


@njit(cache=True, nogil=True, error_model="numpy")
def lanes_to_look_at(state, levels, wake, end, look):  # type: ignore[no-untyped-def]
    """Mark in `look` each lane that can have an event or wakes before sample `end`; return how many."""
    count = 0
    for lane in range(LANES):
        crosses = (state[LANES + lane] >= levels[lane]) | (state[2 * LANES + lane] <= levels[LANES + lane])
        look[lane] = crosses | (wake[lane] < end)
        count += 1 if look[lane] else 0
    return count


@njit(cache=True, nogil=True, error_model="numpy")
def detect(lane, first, samples, output, theta_on, theta_off, dead, levels, wake, events, count):  # type: ignore[no-untyped-def]
    """Follow one lane through a block, write its events, and return their number so far.

    `levels` has the upper comparator level of each lane, then the lower. An armed lane has them around what it
    memorised; a blind one has them at infinity, and in `wake` the sample at which it memorises its output.
    """
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
            levels[lane] = value + theta_on[lane]
            levels[LANES + lane] = value - theta_off[lane]
    return count


@njit(cache=True, nogil=True, error_model="numpy")
def run_group(first, stop, lux, steady, rho, sigma, key0, key1, lowest, fixed, dead, pixel, v, levels, wake, events):  # type: ignore[no-untyped-def]
    """Take one group of lanes from sample `first` to `stop` - 1, or until `events` might run over.

    Rows for four samples, or for several quantities, lie one behind the other in flat arrays: the compiler then sees
    that they do not overlap.

    Parameters
    ----------
    first, stop
        Samples; `first` is one more than a multiple of BLOCK (sample 0 is the start). Only at the end of a recording
        may `stop` not be one.
    lux, steady
        Illuminance at each sample from `first` to the end of the last block; for each block, whether it is one value.
    rho, sigma
        Factor of the low-pass for each sample, and rms of what the noise adds in each.
    key0, key1
        Seed of the recording, two uint32.
    lowest
        The logarithm is taken of no less than this, fA.
    fixed
        (4, LANES): gain, dark current, ON and OFF threshold.
    dead
        (LANES,) samples for which a lane is blind.
    pixel
        (LANES,) uint32, numbers of the pixels.
    v
        (LANES,) output of the low-pass. Changed.
    levels, wake
        (2 LANES,) and (LANES,), see :func:`detect`. Changed.
    events
        (m, 3) int64: sample, lane, polarity. Written.

    Returns
    -------
    The sample that comes next, and the number of events.
    """
    words = np.empty(4 * LANES, np.uint32)
    z = np.zeros(4 * LANES, np.float32)
    pull = np.empty(4 * LANES, np.float64)
    output = np.empty(BLOCK * LANES, np.float64)
    state = np.empty(3 * LANES, np.float64)
    state[:LANES] = v
    look = np.empty(LANES, np.bool_)
    pulled_lux = np.nan
    count = 0
    n = first
    while n < stop and count + BLOCK * LANES <= len(events):
        state[LANES : 2 * LANES] = -np.inf
        state[2 * LANES :] = np.inf
        still = steady[(n - first) // BLOCK]
        for row in range(0, BLOCK, 4):
            at = n - first + row
            if not (still and lux[at] == pulled_lux):
                fill_pull(lux, at, fixed[0], fixed[1], lowest, 1.0 - rho, pull)
                pulled_lux = lux[at] if still else np.nan
            if sigma > 0.0:
                fill_words((n - 1 + row) // 4, pixel, key0, key1, words)
                fill_normals(words, z)
            low_pass(rho, sigma, pull, z, state, output[row * LANES : (row + 4) * LANES])
        samples = min(BLOCK, stop - n)
        if lanes_to_look_at(state, levels, wake, n + samples, look) > 0:
            for lane in range(LANES):
                if look[lane]:
                    count = detect(lane, n, samples, output, fixed[2], fixed[3], dead, levels, wake, events, count)
        n += samples
    v[:] = state[:LANES]
    return n, count
