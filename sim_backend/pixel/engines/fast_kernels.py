"""Compiled parts of the fast engine: blocks of samples that are skipped unless the pixel can cross in them.

Everything is in units of the rms of the noise. Between two edges of the light the output of the low-pass less its
settled level is ``w``, an Ornstein-Uhlenbeck process of unit variance; an edge only moves w and the memorised w. A
pixel goes in steps, each from a sample to a later one, all of whose samples in between have been dealt with:

- a blind pixel goes to the end of its dead time, or to the next edge, in one step;
- an armed pixel takes a block of samples: its end is drawn, then whether the path of continuous time between both
  ends reaches a line that lies within the comparator levels, and if so, when it first does. Before that no sample can
  have crossed. Behind it the future is drawn afresh, from the line, and what was drawn as the end is forgotten;
- a pixel that has been quiet for long jumps to its next event, or to the next edge, by the table of rates.

While the light moves, the output less its settled level is w plus what the low-pass makes of the moving light, a
table over the samples (:mod:`sim_backend.pixel.engines.moving_kernels`): within a block each level is taken where it
is nearest. A leak moves both levels by the same amount in each sample, and is treated alike.

The normal numbers of a pixel are taken in turn from its own sequence (Philox, with the number of four of them, the
pixel and a purpose as counter), so they do not depend on other pixels, on threads, or on where a stretch ends.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from drivers.jit import njit
from sim_backend.pixel.engines.hazard import B_FIRST, B_LAST, B_STEP, Z_LAST, Z_STEP
from sim_backend.pixel.engines.moving_kernels import LONGEST_MOVING, between_nodes, extremes
from sim_backend.pixel.engines.reference_kernels import normal_pair, philox4x32, start_normals  # noqa: F401

NEVER: Final = np.iinfo(np.int64).max  #: the pixel is not blind, or has no hazard to wait for
PURPOSE_FAST: Final = 2  #: third word of the counter

DRAW_LANES: Final = 32  #: counters that are turned into normal numbers together
DRAWS: Final = 4 * DRAW_LANES  #: normal numbers in store for a pixel
MOST_DRAWS: Final = 17  #: of one step at the most

# Columns of the whole numbers of a pixel's state
AT: Final = 0  #: the last sample that has been dealt with
WAKE: Final = 1  #: sample at which a blind pixel memorises
SEGMENT: Final = 2  #: stretch of constant light to which AT belongs
QUIET: Final = 3  #: sample from which on the table of rates holds
USED: Final = 4  #: normal numbers used of those in store
COUNTER: Final = 5  #: counters used
WHOLE: Final = 6  #: how many columns

# Columns of the real numbers of a pixel's state, all in units of the rms
OUTPUT: Final = 0  #: w, the output less the settled level and less MOVED
LEVEL: Final = 1  #: the settled level
MOVED: Final = 2  #: what the low-pass has made of the moving light since the last edge
ON_LEVEL: Final = 3  #: output less settled level at which an ON event is made
OFF_LEVEL: Final = 4
REAL: Final = 5  #: how many columns

# Columns of what is fixed for a pixel
GAIN: Final = 0
DARK: Final = 1
ON: Final = 2  #: threshold over rms
OFF: Final = 3
LEAK: Final = 4  #: drift of D over rms, per sample
NODE: Final = 5  #: place between the pixels of the table of moving light
FIXED: Final = 6  #: how many columns

#: The further barrier must be this far away for the table of rates, and the two this far apart.
FURTHER: Final = 3.5
APART: Final = 7.99

#: The longest block is ``sqrt(distance / (factor level))`` time constants, for a level beyond zero and on this side.
_FAR: Final = 0.25
_NEAR: Final = 0.5

#: A level may move this far, in rms, during a jump; the hazard is that of the middle.
_JUMP_DRIFT: Final = 0.02
#: Of the distance to a level that moves in a block, at least this part is kept.
_KEPT_DISTANCE: Final = 0.5
#: and the block must not be more than this many times as long as one that is chosen for the nearer levels.
_KEPT_LENGTHS: Final = 2

#: A path is taken never to reach a line if the exponent of the probability is beyond this: 1 in 10^11.
_NO_HIT: Final = 25.0

_U32 = np.uint32


@njit(cache=True, nogil=True, error_model="numpy")
def fill_draws(pixel, counter, key0, key1, words, z):  # type: ignore[no-untyped-def]
    """Write the normal numbers of the next DRAW_LANES counters of a pixel."""
    for lane in range(DRAW_LANES):
        index = counter + lane
        w0, w1, w2, w3 = philox4x32(_U32(index), pixel, _U32(PURPOSE_FAST), _U32(index >> 32), key0, key1)
        words[lane] = w0
        words[DRAW_LANES + lane] = w1
        words[2 * DRAW_LANES + lane] = w2
        words[3 * DRAW_LANES + lane] = w3
    for lane in range(DRAW_LANES):
        z0, z1 = normal_pair(words[lane], words[DRAW_LANES + lane])
        z2, z3 = normal_pair(words[2 * DRAW_LANES + lane], words[3 * DRAW_LANES + lane])
        z[lane] = z0
        z[DRAW_LANES + lane] = z1
        z[2 * DRAW_LANES + lane] = z2
        z[3 * DRAW_LANES + lane] = z3


@njit(cache=True, nogil=True, error_model="numpy")
def exponential(z, used):  # type: ignore[no-untyped-def]
    """Return an exponential number of mean 1, half the squared radius of the two normal ones at `used`."""
    a = np.float64(z[used])
    b = np.float64(z[used + 1])
    return 0.5 * (a * a + b * b)


@njit(cache=True, nogil=True, error_model="numpy")
def first_hit(x, y, span, z, e1, e2):  # type: ignore[no-untyped-def]
    """Return which part of its length has gone when a Brownian bridge first reaches zero, given that it does.

    It begins x > 0 above zero and ends y above it (or -y below it) `span` later. Seen from a bridge that ends |y|
    below zero (reflection), ``t span / (span - t)`` of the first hit t is that of Brownian motion with drift
    ``-|y| / span``: inverse Gaussian of mean ``x span / |y|`` and shape x^2.

    Parameters
    ----------
    z, e1, e2
        A normal and two exponential numbers.

    Source: J. R. Michael, W. R. Schucany, R. W. Haas, "Generating random variates using transformations with multiple
    roots", The American Statistician 30 (1976), written for the inverse of the variate, which has no cancellation.
    """
    slow = abs(y) / x
    half = 0.5 * span * (z / x) ** 2
    inverse = slow + half + math.sqrt(half * (2.0 * slow + half))
    if e1 * slow >= e2 * inverse:
        inverse = slow * slow / inverse
    return 1.0 / (1.0 + inverse)


@njit(cache=True, nogil=True, error_model="numpy")
def behind_hit(w, end, c, samples, rate, fades, z, used):  # type: ignore[no-untyped-def]
    """Return the samples to the first one behind the hit of the line of level c from below, and the output there.

    Six normal numbers are used.
    """
    growth = 1.0 / fades[samples]
    span = growth * growth - 1.0
    part = first_hit(
        c - w, (c - end) * growth, span, np.float64(z[used]), exponential(z, used + 1), exponential(z, used + 3)
    )
    line = c * (1.0 + (growth - 1.0) * part)
    gone = min(int(math.log1p(span * part) / (2.0 * rate)) + 1, samples)
    fade = fades[gone]
    variance = 1.0 - fade * fade * (1.0 + span * part)
    return gone, fade * line + math.sqrt(max(variance, 0.0)) * np.float64(z[used + 5])


@njit(cache=True, nogil=True, error_model="numpy")
def block(w, upper, lower, samples, rate, fades, spreads, tangents, z, used):  # type: ignore[no-untyped-def]
    """Take an armed pixel up to `samples` on, or to the first sample behind the first time at which it may cross.

    With ``s = exp(2 t / tau)`` the process is ``w(t) = W(s) / sqrt(s)``, W Brownian, and a level b >= 0 is the curve
    ``b sqrt(s)``, above its chord. For b < 0 the curve is above its tangent in the middle, which is the chord of the
    level ``b cosh(x / 2)``, x the length of the block over tau. The bridge of W reaches that line, c its level, with
    the probability ``exp(-(c - w0)(c - w1) / sinh x)``; no sample can have crossed unless it does.

    Both lines in one block: less than 1 in 10^8, since blocks are short beside the distance of the two.

    Parameters
    ----------
    w, upper, lower
        Start, and the levels at which an event is made.
    samples, rate
        Length of the block; inverse of the time constant, per sample.
    fades, spreads, tangents
        See :func:`run_pixels`.
    z, used
        Normal numbers in store, and how many of them are used.

    Returns
    -------
    Samples gone, output there, and normal numbers used.
    """
    spread = spreads[samples]
    end = fades[samples] * w + spread * np.float64(z[used])
    used += 1
    if samples == 1:
        return samples, end, used
    tangent = tangents[samples]
    up = max(upper, 0.0) + min(upper, 0.0) * tangent
    down = max(-lower, 0.0) + min(-lower, 0.0) * tangent
    twice_keep = 2.0 * fades[samples]
    variance = spread * spread
    up_product = twice_keep * (up - w) * (up - end)
    down_product = twice_keep * (down + w) * (down + end)
    if min(up_product, down_product) > _NO_HIT * variance:
        return samples, end, used
    used += 4
    if up_product < exponential(z, used - 4) * variance:
        gone, w = behind_hit(w, end, up, samples, rate, fades, z, used)
        return gone, w, used + 6
    if down_product < exponential(z, used - 2) * variance:
        gone, w = behind_hit(-w, -end, down, samples, rate, fades, z, used)
        return gone, -w, used + 6
    return samples, end, used


@njit(cache=True, nogil=True, error_model="numpy")
def choose_block(w, upper, lower, most, scale):  # type: ignore[no-untyped-def]
    """Return the samples of the next block, from 1 to `most`.

    The line lies below the level by a part of the distance of the pixel from it: ``x^2 <= 2 distance / |level|``,
    twice that for a level on the far side of zero, where the line leaves it only inside the block.
    """
    on = (upper - w) / (_FAR * max(upper, 0.0) - _NEAR * min(upper, 0.0))
    off = (w - lower) / (_FAR * max(-lower, 0.0) - _NEAR * min(-lower, 0.0))
    wanted = scale * math.sqrt(max(min(on, off), 0.0))
    return max(int(min(wanted, float(most))), 1)


@njit(cache=True, nogil=True, error_model="numpy")
def between(table, row, x):  # type: ignore[no-untyped-def]
    """Return the number at x, in steps of the table, between two entries of a row."""
    i = min(max(int(x), 0), table.shape[1] - 2)
    return table[row, i] + (x - i) * (table[row, i + 1] - table[row, i])


@njit(cache=True, nogil=True, error_model="numpy")
def from_normal(table, b, z):  # type: ignore[no-untyped-def]
    """Return the number that the table of a law has for barrier b at the normal number z."""
    x = (min(b, B_LAST) - B_FIRST) / B_STEP
    row = min(int(x), len(table) - 2)
    at = (min(max(z, -Z_LAST), Z_LAST) + Z_LAST) / Z_STEP
    low = between(table, row, at)
    return low + (x - row) * (between(table, row + 1, at) - low)


@njit(cache=True, nogil=True, error_model="numpy")
def hazard(log_rate, b):  # type: ignore[no-untyped-def]
    """Return the hazard of a crossing, per sample, of a pixel that has long been quiet."""
    if b > B_LAST:
        return 0.0
    return math.exp(between(log_rate, 0, (b - B_FIRST) / B_STEP) - 0.5 * b * b)


@njit(cache=True, nogil=True, error_model="numpy")
def table_holds(upper, lower):  # type: ignore[no-untyped-def]
    """Return whether the table of rates may be used between these levels: one near at the most, both far apart."""
    return min(upper, -lower) >= B_FIRST and max(upper, -lower) >= FURTHER and upper - lower >= APART


@njit(cache=True, nogil=True, error_model="numpy")
def jump(upper, lower, samples, log_rate, inside, beyond, z, used):  # type: ignore[no-untyped-def]
    """Take a quiet pixel to its next event, or `samples` on.

    Returns
    -------
    What :func:`block` returns, and 1 for an ON event, -1 for an OFF event, 0 for none.
    """
    on = hazard(log_rate, upper)
    off = hazard(log_rate, -lower)
    wait = exponential(z, used)
    z0 = np.float64(z[used + 2])
    if wait >= (on + off) * samples:
        w = z0
        if upper < B_LAST:
            w += from_normal(inside, upper, z0) - z0
        if lower > -B_LAST:
            w -= from_normal(inside, -lower, -z0) + z0
        return samples, w, used + 3, 0
    gone = min(int(wait / (on + off)) + 1, samples)
    if exponential(z, used + 3) * off < exponential(z, used + 5) * on:
        return gone, from_normal(beyond, upper, z0), used + 7, 1
    return gone, -from_normal(beyond, -lower, z0), used + 7, -1


@njit(cache=True, nogil=True, error_model="numpy")
def event_at(value, upper, lower):  # type: ignore[no-untyped-def]
    """Return 1 for an ON event, -1 for an OFF event, 0 for none."""
    return (1 if value >= upper else 0) - (1 if value <= lower else 0)


@njit(cache=True, nogil=True, error_model="numpy")
def block_under_moving_light(w, on_level, off_level, slope, most, scale, place, at, moving):  # type: ignore[no-untyped-def]
    """Return the samples of the next block, and both levels for w where they are nearest in it."""
    table, lows, highs, begin = moving
    now = between_nodes(table, place, at - begin)
    samples = choose_block(w, on_level - now, off_level - now, most, scale)
    while True:
        low, high = extremes(lows, highs, place, begin, at, at + samples)
        upper, lower = nearest(on_level - high, off_level - low, slope, samples)
        if keeps_distance(w, on_level - now, off_level - now, upper, lower, samples, scale):
            return samples, upper, lower
        samples = (samples + 1) // 2


@njit(cache=True, nogil=True, error_model="numpy")
def nearest(upper, lower, slope, samples):  # type: ignore[no-untyped-def]
    """Return both levels where a leak takes them nearest to the pixel in a block."""
    return upper - max(slope, 0.0) * samples, lower - min(slope, 0.0) * samples


@njit(cache=True, nogil=True, error_model="numpy")
def keeps_distance(w, on_level, off_level, upper, lower, samples, scale):  # type: ignore[no-untyped-def]
    """Return whether a block is fit for levels that come as near as `upper` and `lower` in it.

    Otherwise it would be hit for nothing, or its line might lie behind the pixel.
    """
    return samples == 1 or (
        min(upper - w, w - lower) >= _KEPT_DISTANCE * min(on_level - w, w - off_level)
        and choose_block(w, upper, lower, samples, scale) * _KEPT_LENGTHS >= samples
    )


@njit(cache=True, nogil=True, error_model="numpy")
def run_pixels(  # type: ignore[no-untyped-def]
    begin, stop, light, rate, rms, settle, key, lowest, reset, sensor, blocks, tables, moving, state, events
):
    """Take pixels to sample `stop` - 1 or beyond, or until there is no more room for events.

    Parameters
    ----------
    begin
        Index of the pixel to begin with.
    stop
        Sample.
    light
        (m + 1,), (m + 1,) and (m,): first sample of each segment between two edges, with one beyond all others; last
        sample at which its light still moves; its settled light; its leak, rms per sample, beside that of the pixel.
    rate, rms
        Inverse of the time constant, per sample; rms of the noise.
    settle
        Samples after which a pixel is quiet.
    key
        Seed of the recording, two uint32.
    lowest
        The logarithm is taken of no less than this, fA.
    reset
        Rms of the noise of a reset, over that of the noise.
    sensor
        Number of all pixels; of each pixel: (n, FIXED) what is fixed; (n,) samples of dead time; (n,) uint32 number;
        (n,) place in the order in which events of one time are given; (n,) longest block, samples.
    blocks
        For blocks of n samples from 0 to the longest, x = rate n: exp(-x), sqrt(1 - exp(-2 x)), cosh(x / 2).
    tables
        Logarithm of the rate (1, b), law inside (b, z) and law beyond (b, z).
    moving
        Table, lows and highs of :func:`~sim_backend.pixel.engines.moving_kernels.follow`, with the sample before the
        first one as the table's first column, and the number of that sample.
    state
        (n, WHOLE), (n, REAL), (n, DRAWS): state of each pixel, and normal numbers. Changed.
    events
        (e,) int64: ``(sample * pixels + rank) * 2 + polarity``, so that their order is that of time. Written.

    Returns
    -------
    The index of the pixel to go on with, and the number of events.
    """
    words = np.empty(DRAWS, np.uint32)
    first, until, lux, leaks = light
    key0, key1 = key
    pixels, fixed, dead, pixel, rank, longest = sensor
    fades, spreads, tangents = blocks
    scale = 1.0 / rate
    log_rate, inside, beyond = tables
    whole, real, store = state
    count = 0
    for i in range(begin, len(pixel)):
        at, wake, segment = whole[i, AT], whole[i, WAKE], whole[i, SEGMENT]
        quiet, used, counter = whole[i, QUIET], whole[i, USED], whole[i, COUNTER]
        w, level, moved = real[i, OUTPUT], real[i, LEVEL], real[i, MOVED]
        on_level, off_level = real[i, ON_LEVEL], real[i, OFF_LEVEL]
        place = fixed[i, NODE]
        slope = fixed[i, LEAK] + leaks[segment]
        z = store[i]
        end = first[segment + 1] - 1
        while at < stop - 1 and count < len(events):
            if used > DRAWS - MOST_DRAWS:
                fill_draws(pixel[i], counter, key0, key1, words, z)
                counter += DRAW_LANES
                used = 0
            if moved != 0.0 and (at >= end or at >= until[segment]):
                w += moved
                moved = 0.0
            if at >= end:
                while at >= first[segment + 1] - 1:
                    segment += 1
                step = level
                level = math.log(max(fixed[i, GAIN] * lux[segment] + fixed[i, DARK], lowest)) / rms
                step -= level
                w += step
                on_level += step
                off_level += step
                slope = fixed[i, LEAK] + leaks[segment]
                end = first[segment + 1] - 1
                quiet = max(at, min(until[segment], end)) + settle
            event = 0
            before = at
            moves = at < until[segment]
            last = min(end, until[segment], stop - 1) if moves else end
            if wake != NEVER:
                at = min(wake, last)
                keep = math.exp(-rate * (at - before))
                w = keep * w + math.sqrt(1.0 - keep * keep) * np.float64(z[used])
                used += 1
                if moves:
                    moved = between_nodes(moving[0], place, at - moving[3])
            elif moves:
                samples, upper, lower = block_under_moving_light(
                    w,
                    on_level,
                    off_level,
                    slope,
                    min(last - at, longest[i], LONGEST_MOVING),
                    scale,
                    place,
                    at,
                    moving,
                )
                gone, w, used = block(w, upper, lower, samples, rate, fades, spreads, tangents, z, used)
                at += gone
                moved = between_nodes(moving[0], place, at - moving[3])
                on_level -= slope * gone
                off_level -= slope * gone
                event = event_at(w + moved, on_level, off_level)
            elif at >= quiet and abs(slope) <= _JUMP_DRIFT * rate and table_holds(on_level, off_level):
                samples = last - at
                if slope != 0.0:
                    samples = max(min(samples, int(_JUMP_DRIFT / abs(slope))), 1)
                half = 0.5 * slope * samples
                gone, w, used, event = jump(
                    on_level - half, off_level - half, samples, log_rate, inside, beyond, z, used
                )
                at += gone
                on_level -= slope * gone
                off_level -= slope * gone
            else:
                most = min((last if at >= quiet else min(last, quiet)) - at, longest[i])
                samples = choose_block(w, on_level, off_level, most, scale)
                upper, lower = nearest(on_level, off_level, slope, samples)
                while not keeps_distance(w, on_level, off_level, upper, lower, samples, scale):
                    samples = (samples + 1) // 2
                    upper, lower = nearest(on_level, off_level, slope, samples)
                gone, w, used = block(w, upper, lower, samples, rate, fades, spreads, tangents, z, used)
                at += gone
                on_level -= slope * gone
                off_level -= slope * gone
                event = event_at(w, on_level, off_level)
            if event != 0:
                events[count] = (at * pixels + rank[i]) * 2 + (event > 0)
                count += 1
                wake = at + dead[i]
            if at == wake:
                wake = NEVER
                memorised = w + moved
                if reset > 0.0:
                    memorised += reset * np.float64(z[used])
                    used += 1
                on_level = memorised + fixed[i, ON]
                off_level = memorised - fixed[i, OFF]
                quiet = max(at, min(until[segment], end)) + settle
        whole[i, AT], whole[i, WAKE], whole[i, SEGMENT] = at, wake, segment
        whole[i, QUIET], whole[i, USED], whole[i, COUNTER] = quiet, used, counter
        real[i, OUTPUT], real[i, LEVEL], real[i, MOVED] = w, level, moved
        real[i, ON_LEVEL], real[i, OFF_LEVEL] = on_level, off_level
        if at < stop - 1:
            return i, count
    return len(pixel), count
