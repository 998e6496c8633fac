"""Compiled parts of the reference engine for pixels on which functions of effects act.

The general kernel with a function at each stage, which is called through its address
(:mod:`sim_backend.pixel.engines.user_kernels`). Where a function returns what it is given, the result is that of the
general kernel, bit by bit.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np

from drivers.jit import njit
from sim_backend.pixel.engines.general_kernels import (
    PURPOSE_SHOT,
    PURPOSE_SLOW,
    exp_falling,
    fill_purpose,
    reset_normal,
)
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

PURPOSE_DEAD_TIME: Final = 12  #: what a dead time is made of, by the sample of the event
PURPOSE_THRESHOLDS: Final = 13  #: what thresholds are made of, by the sample of the reset
LONGEST_DEAD_S: Final = 1e9  #: a dead time cannot be longer, s
LOWEST_CORNER_HZ: Final = 1e-6  #: the photoreceptor's corner must be higher, Hz
EULER_TOO_LONG: Final = 7  #: number of the trouble that the photoreceptor is too fast for the Euler form

_U32 = np.uint32


class Functions(NamedTuple):
    """A function for each hook, or its parameters; the number of a hook's trouble is its place, from 1."""

    response: Any
    receptor_hz: Any
    noise_rms: Any
    leak: Any
    thresholds: Any
    refractory: Any


class Numbers(NamedTuple):
    """What all pixels have in common beside the coefficients of the general kernel."""

    used: int  #: lanes that have a pixel
    watch: bool  #: thresholds may change between two resets
    noise_rms: float  #: ln units
    noise_root: float  #: what the noise adds in a sample, for each rms
    receptor_hz_per_fa: float  #: Hz/fA
    receptor_max_hz: float  #: Hz
    ratio_per_hz: float  #: length of a sample over the time constant of a corner, for each Hz
    delay_s: float  #: of the comparators, s
    injection_ln: float  #: offset of the memorised level, ln units


class Pixel(NamedTuple):
    """All that is no state."""

    c: Any  #: coefficients of the general kernel
    m: Any  #: :class:`Numbers`
    f: Any  #: :class:`Functions`
    p: Any  #: their parameters, in the same places
    fixed: Any  #: (6, LANES): gain, dark current, ON and OFF threshold, dead time in s, leak per s
    pixel: Any  #: (LANES,) uint32, numbers of the pixels
    key: Any  #: seed of the recording, two uint32


@njit(cache=True, nogil=True, error_model="numpy")
def normal_of(purpose, n, lane, h):  # type: ignore[no-untyped-def]
    """Return the standard normal number of a lane at sample n (int64) for this purpose."""
    w0, w1, _, _ = philox4x32(_U32(n), h.pixel[lane], _U32(purpose), _U32(n >> 32), h.key[0], h.key[1])
    return np.float64(normal_pair(w0, w1)[0])


@njit(cache=True, nogil=True, error_model="numpy")
def note(trouble, hook, value, current):  # type: ignore[no-untyped-def]
    """Write down the first value that cannot be used, and at which photocurrent."""
    if trouble[0] == 0.0:
        trouble[0] = hook
        trouble[1] = value
        trouble[2] = current


@njit(cache=True, nogil=True, error_model="numpy")
def current_at(lux, lane, h):  # type: ignore[no-untyped-def]
    """Return the photocurrent of a lane."""
    return larger(h.fixed[0, lane] * lux + h.fixed[1, lane], h.c.lowest_fa)


@njit(cache=True, nogil=True, error_model="numpy")
def at_light(lane, current, logarithm, h, trouble):  # type: ignore[no-untyped-def]
    """Return what a photocurrent gives: u, ratio of the photoreceptor, rms of the noise in a sample, added leak."""
    m, leak = h.m, h.fixed[5, lane]
    u = np.float64(h.f.response(h.p.response, logarithm, current))
    corner = -larger(-m.receptor_hz_per_fa * current, -m.receptor_max_hz)
    hz = np.float64(h.f.receptor_hz(h.p.receptor_hz, corner, current))
    rms = np.float64(h.f.noise_rms(h.p.noise_rms, m.noise_rms, current))
    rate = np.float64(h.f.leak(h.p.leak, leak, current))
    ratio = -larger(-h.c.receptor_per_fa * current, -h.c.receptor_most)
    if hz != corner:
        ratio = m.ratio_per_hz * hz
    if not -np.inf < u < np.inf:
        note(trouble, 1, u, current)
    if not hz > LOWEST_CORNER_HZ:
        note(trouble, 2, hz, current)
    if h.c.euler and 1.0 <= ratio < np.inf:
        note(trouble, EULER_TOO_LONG, hz, current)
    if not 0.0 <= rms < np.inf:
        note(trouble, 3, rms, current)
    if not -np.inf < rate < np.inf:
        note(trouble, 4, rate, current)
    return u, ratio, rms * m.noise_root, rate - leak


@njit(cache=True, nogil=True, error_model="numpy")
def start_light(current, logarithm, h, trouble):  # type: ignore[no-untyped-def]
    """Return (3, LANES) for t = 0: u, ratio of the photoreceptor, rms of the noise in a sample."""
    out = np.zeros((3, LANES), np.float64)
    out[1] = np.inf
    for lane in range(h.m.used):
        out[0, lane], out[1, lane], out[2, lane], _ = at_light(lane, current[lane], logarithm[lane], h, trouble)
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def fill_light(lux, n, h, u, shot, forget, sigma, added, trouble):  # type: ignore[no-untyped-def]
    """Write what the light gives for samples n to n + 3, as in the general kernel; `added` is drift in a sample."""
    for i in range(4):
        for lane in range(h.m.used):
            k = i * LANES + lane
            current = current_at(lux[n + i], lane, h)
            u[k], ratio, sigma[k], rate = at_light(lane, current, ln_f64(current), h, trouble)
            shot[k] = math.sqrt(h.c.shot_fa / current)
            added[k] = rate * h.c.dt_s
            if h.c.euler and ratio < np.inf:
                forget[k] = 1.0 - ratio
            else:
                forget[k] = exp_falling(ratio)


@njit(cache=True, nogil=True, error_model="numpy")
def advance(row, seconds, leaked, h, u, shot, forget, sigma, added, z, z_shot, z_slow, state, output):  # type: ignore[no-untyped-def]
    """Take sample `row` of four; `state` is that of the general kernel, and behind it the added drift."""
    c = h.c
    for lane in range(LANES):
        k = row * LANES + lane
        p = forget[k] * state[LANES + lane] + (1.0 - forget[k]) * (u[k] + shot[k] * z_shot[k])
        v = c.rho * state[lane] + ((1.0 - c.rho) * p + sigma[k] * z[k])
        slow = c.slow_rho * state[2 * LANES + lane] + c.slow_sigma * z_slow[k]
        memory = c.high_rho * state[3 * LANES + lane] + (1.0 - c.high_rho) * (v + slow)
        drift = state[6 * LANES + lane] + added[k]
        out = (v + slow) - memory + (h.fixed[5, lane] * seconds + leaked) + drift
        state[lane] = v
        state[LANES + lane] = p
        state[2 * LANES + lane] = slow
        state[3 * LANES + lane] = memory
        state[4 * LANES + lane] = larger(state[4 * LANES + lane], out)
        state[5 * LANES + lane] = -larger(-state[5 * LANES + lane], -out)
        state[6 * LANES + lane] = drift
        output[lane] = out


@njit(cache=True, nogil=True, error_model="numpy")
def set_levels(lane, current, since_s, h, resets, levels, trouble):  # type: ignore[no-untyped-def]
    """Set the comparators around what was memorised; `resets` has level, sample and z of each lane's reset."""
    on, off = h.f.thresholds(h.p.thresholds, h.fixed[2, lane], h.fixed[3, lane], current, since_s, resets[2, lane])
    if not (on > 0.0 and off > 0.0):
        note(trouble, 5, off if on > 0.0 else on, current)
    levels[lane] = resets[0, lane] + (on + h.m.injection_ln)
    levels[LANES + lane] = resets[0, lane] - (off - h.m.injection_ln)


@njit(cache=True, nogil=True, error_model="numpy")
def memorise(lane, n, value, current, h, resets, levels, wake, trouble):  # type: ignore[no-untyped-def]
    """Reset a lane at sample n (int64), at which the signal with the noise of the reset is `value`."""
    wake[lane] = NEVER
    resets[0, lane] = value
    resets[1, lane] = n
    resets[2, lane] = normal_of(PURPOSE_THRESHOLDS, n, lane, h)
    set_levels(lane, current, 0.0, h, resets, levels, trouble)


@njit(cache=True, nogil=True, error_model="numpy")
def start_levels(value, current, h, resets, levels, wake, trouble):  # type: ignore[no-untyped-def]
    """Reset all lanes at t = 0; one without a pixel never has an event."""
    levels[:LANES] = np.inf
    levels[LANES:] = -np.inf
    for lane in range(h.m.used):
        memorise(lane, np.int64(0), value[lane], current[lane], h, resets, levels, wake, trouble)


@njit(cache=True, nogil=True, error_model="numpy")
def dead_samples(n, lane, current, h, trouble):  # type: ignore[no-untyped-def]
    """Return for how many samples a lane is blind after its event at sample n (int64)."""
    z = normal_of(PURPOSE_DEAD_TIME, n, lane, h)
    period_s = np.float64(h.f.refractory(h.p.refractory, h.fixed[4, lane], current, z))
    if not 0.0 <= period_s <= LONGEST_DEAD_S:
        note(trouble, 6, period_s, current)
        return np.int64(0)
    return np.int64(np.rint((period_s + h.m.delay_s) / h.c.dt_s))


@njit(cache=True, nogil=True, error_model="numpy")
def detect(lane, first, samples, lux, output, h, resets, levels, wake, events, count, trouble):  # type: ignore[no-untyped-def]
    """Follow one lane through a block, as in the other kernels."""
    for n in range(first, first + samples):
        value = output[(n - first) * LANES + lane]
        current = current_at(lux[n - first], lane, h)
        if h.m.watch and wake[lane] == NEVER:
            since_s = (n - np.int64(resets[1, lane])) * h.c.dt_s
            set_levels(lane, current, since_s, h, resets, levels, trouble)
        on = value >= levels[lane]
        if on or value <= levels[LANES + lane]:
            events[count, 0] = n
            events[count, 1] = lane
            events[count, 2] = on
            count += 1
            wake[lane] = n + dead_samples(np.int64(n), lane, current, h, trouble)
            levels[lane] = np.inf
            levels[LANES + lane] = -np.inf
        if wake[lane] == n:
            if h.c.reset_rms > 0.0:
                value += h.c.reset_rms * reset_normal(np.int64(n), h.pixel[lane], h.key[0], h.key[1])
            memorise(lane, np.int64(n), value, current, h, resets, levels, wake, trouble)
    return count


@njit(cache=True, nogil=True, error_model="numpy")
def run_group(first, stop, lux, steady, leaked, h, kept, resets, levels, wake, events, trouble):  # type: ignore[no-untyped-def]
    """Take one group of lanes from sample `first` to `stop` - 1, or until `events` might run over.

    Parameters are those of the general kernel, and

    h
        :class:`Pixel`.
    kept
        (5 LANES,) as in the general kernel, and behind it the added drift. Changed.
    resets
        (3, LANES), see :func:`set_levels`. Changed.
    trouble
        (3,) number of the hook that gave what cannot be used, 0 for none; that value; the photocurrent. Written.

    Returns
    -------
    The sample that comes next, and the number of events.
    """
    words = np.empty(4 * LANES, np.uint32)
    z = np.zeros(4 * LANES, np.float32)
    z_shot = np.zeros(4 * LANES, np.float32)
    z_slow = np.zeros(4 * LANES, np.float32)
    u = np.zeros(4 * LANES, np.float64)
    shot = np.zeros(4 * LANES, np.float64)
    forget = np.zeros(4 * LANES, np.float64)
    sigma = np.zeros(4 * LANES, np.float64)
    added = np.zeros(4 * LANES, np.float64)
    output = np.empty(BLOCK * LANES, np.float64)
    state = np.empty(7 * LANES, np.float64)
    state[: 4 * LANES] = kept[: 4 * LANES]
    state[6 * LANES :] = kept[4 * LANES :]
    look = np.ones(LANES, np.bool_)
    filled_lux = np.nan
    count = 0
    n = first
    while n < stop and count + BLOCK * LANES <= len(events) and trouble[0] == 0.0:
        state[4 * LANES : 5 * LANES] = -np.inf
        state[5 * LANES : 6 * LANES] = np.inf
        still = steady[(n - first) // BLOCK]
        for block in range(0, BLOCK, 4):
            at = n - first + block
            if not (still and lux[at] == filled_lux):
                fill_light(lux, at, h, u, shot, forget, sigma, added, trouble)
                filled_lux = lux[at] if still else np.nan
            index = (n - 1 + block) // 4
            fill_purpose(index, h.pixel, _U32(PURPOSE_NOISE), h.key[0], h.key[1], words, z)
            if h.c.shot_fa > 0.0:
                fill_purpose(index, h.pixel, _U32(PURPOSE_SHOT), h.key[0], h.key[1], words, z_shot)
            if h.c.slow_sigma > 0.0:
                fill_purpose(index, h.pixel, _U32(PURPOSE_SLOW), h.key[0], h.key[1], words, z_slow)
            for row in range(4):
                seconds = (n + block + row) * h.c.dt_s
                begin = (block + row) * LANES
                advance(
                    row, seconds, leaked[at + row], h, u, shot, forget, sigma, added, z, z_shot, z_slow, state,
                    output[begin : begin + LANES],
                )  # fmt: skip
        samples = min(BLOCK, stop - n)
        if h.m.watch or lanes_to_look_at(state[3 * LANES :], levels, wake, n + samples, look) > 0:
            for lane in range(h.m.used):
                if look[lane]:
                    count = detect(
                        lane, n, samples, lux[n - first :], output, h, resets, levels, wake, events, count, trouble
                    )
        n += samples
    kept[: 4 * LANES] = state[: 4 * LANES]
    kept[4 * LANES :] = state[6 * LANES :]
    return n, count
