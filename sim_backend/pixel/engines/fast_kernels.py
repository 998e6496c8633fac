"""Compiled parts of the fast engine: pixels with one low-pass, from event to event.

Everything is in units of the rms of the noise, which shot noise makes larger the less light there is: at an edge the
unit changes. Between two edges of the light the output of the low-pass less its settled level is ``w``, an
Ornstein-Uhlenbeck process of unit variance; an edge only moves and rescales w and the memorised w. A pixel goes in
steps, each from a sample to a later one, all of whose samples in between have been dealt with:

- a blind pixel goes to the end of its dead time, or to the next edge, in one step;
- an armed pixel takes a block of samples: its end is drawn, then whether the path of continuous time between both
  ends reaches a line that lies within the comparator levels, and if so, when it first does. Before that no sample can
  have crossed. Behind it the future is drawn afresh, from the line, and what was drawn as the end is forgotten;
- a pixel that has been quiet for long jumps to its next event, or to the next edge, by the table of rates.

While the light moves, the output less its settled level is w plus what the low-pass makes of the moving light, a
table over the samples (:mod:`sim_backend.pixel.engines.moving_kernels`): within a block each level is taken where it
is nearest. A leak moves both levels by the same amount in each sample, and is treated alike.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from drivers.jit import lean_njit
from sim_backend.pixel.engines.block_kernels import MOST_DRAWS, block, choose_block, nearest, until_event
from sim_backend.pixel.engines.draws_kernels import DRAW_LANES, DRAWS, fill_draws
from sim_backend.pixel.engines.jump_kernels import jump, table_holds
from sim_backend.pixel.engines.moving_kernels import LONGEST_MOVING, between_nodes, extremes
from sim_backend.pixel.engines.reference_kernels import start_normals  # noqa: F401
from sim_backend.pixel.engines.stairs_kernels import blind_through, jump_through

NEVER: Final = np.iinfo(np.int64).max  #: the pixel is not blind, or has no hazard to wait for

# Columns of the whole numbers of a pixel's state
AT: Final = 0  #: the last sample that has been dealt with
WAKE: Final = 1  #: sample at which a blind pixel memorises
SEGMENT: Final = 2  #: stretch of constant light to which AT belongs
QUIET: Final = 3  #: sample from which on the table of rates holds
USED: Final = 4  #: normal numbers used of those in store
COUNTER: Final = 5  #: counters used
CALM: Final = 6  #: sample from which on it may jump through low stairs
WHOLE: Final = 7  #: how many columns

# Columns of the real numbers of a pixel's state, all in units of the rms at the light of its segment
OUTPUT: Final = 0  #: w, the output less the settled level and less MOVED
LEVEL: Final = 1  #: the settled level
MOVED: Final = 2  #: what the low-pass has made of the moving light since the last edge
ON_LEVEL: Final = 3  #: output less settled level at which an ON event is made
OFF_LEVEL: Final = 4
REAL: Final = 5  #: how many columns

# Columns of what is fixed for a pixel
GAIN: Final = 0
DARK: Final = 1
ON: Final = 2  #: threshold over the rms of the floor
OFF: Final = 3
LEAK: Final = 4  #: drift of D over the rms of the floor, per sample
NODE: Final = 5  #: place between the pixels of the table of moving light
FIXED: Final = 6  #: how many columns

#: A level may move this far, in rms, during a jump; the hazard is that of the middle.
_JUMP_DRIFT: Final = 0.02
#: Of the distance to a level that moves in a block, at least this part is kept.
_KEPT_DISTANCE: Final = 0.5
#: and the block must not be more than this many times as long as one that is chosen for the nearer levels. For twice
#: as long a one, the line within a level on this side of zero would be behind the pixel.
_KEPT_LENGTHS: Final = 1.5


@lean_njit(forceinline=True)
def event_at(value, upper, lower):  # type: ignore[no-untyped-def]
    """Return 1 for an ON event, -1 for an OFF event, 0 for none."""
    return (1 if value >= upper else 0) - (1 if value <= lower else 0)


@lean_njit(forceinline=True)
def rms_at(current, noise):  # type: ignore[no-untyped-def]
    """Return the rms of the noise at a photocurrent (fA)."""
    floor, shot = noise
    return math.sqrt(floor * floor + shot / current) if shot > 0.0 else floor


@lean_njit(forceinline=True)
def block_under_moving_light(w, now, on_level, off_level, slope, most, scale, place, column, lows, highs):  # type: ignore[no-untyped-def]
    """Return the samples of the next block, and both levels for w where they are nearest in it.

    Parameters
    ----------
    now
        What the low-pass has made of the moving light.
    place, column
        Of the pixel and of the present sample in the table of moving light.
    """
    samples = choose_block(w, on_level - now, off_level - now, most, scale)
    while True:
        low, high = extremes(lows, highs, place, column, column + samples)
        upper, lower = nearest(on_level - high, off_level - low, slope, samples)
        if keeps_distance(w, on_level - now, off_level - now, upper, lower, samples, scale):
            return samples, upper, lower
        samples = (samples + 1) // 2


@lean_njit(forceinline=True)
def keeps_distance(w, on_level, off_level, upper, lower, samples, scale):  # type: ignore[no-untyped-def]
    """Return whether a block is fit for levels that come as near as `upper` and `lower` in it.

    Otherwise it would be hit for nothing, or its line might lie behind the pixel.
    """
    if samples == 1:
        return True
    if min(upper - w, w - lower) < _KEPT_DISTANCE * min(on_level - w, w - off_level):
        return False
    # Levels on both sides of zero: what is kept of the distance is enough for the length.
    return upper >= 0.0 >= lower or choose_block(w, upper, lower, samples, scale) * _KEPT_LENGTHS >= samples


@lean_njit()
def run_pixels(  # type: ignore[no-untyped-def]
    begin,
    stop,
    light,
    rate,
    noise,
    settle,
    key,
    lowest,
    reset,
    sensor,
    factors,
    tables,
    moving,
    stairs,
    state,
    events,
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
        sample at which its light still moves; its settled light; its leak, in rms of the floor per sample, beside
        that of the pixel.
    rate, noise
        Inverse of the time constant, per sample; rms of the floor, and variance of the shot noise behind the
        low-pass, times the photocurrent (fA). Beside shot noise no light moves.
    settle
        Samples after which a pixel is quiet.
    key
        Seed of the recording, two uint32.
    lowest
        The logarithm is taken of no less than this, fA.
    reset
        Rms of the noise of a reset, over that of the floor.
    sensor
        Number of all pixels; of each pixel: (n, FIXED) what is fixed; (n,) samples of dead time; (n,) uint32 number;
        (n,) place in the order in which events of one time are given; (n,) longest block, samples.
    factors
        (longest + 1, FACTORS) what a block of n samples needs.
    tables
        (b, RATES) rates, law inside (b, z) and law beyond (b, z).
    moving
        Table, lows and highs of :func:`~sim_backend.pixel.engines.moving_kernels.follow`; (m,) shift of each segment;
        while the light moves, no step goes beyond a multiple of so many samples, up to which the table is filled.
    stairs
        Tables, fastest, window and since of :func:`~sim_backend.pixel.engines.stairs_kernels.respond`; of no segments
        where the light is no stairs.
    state
        (n, WHOLE), (n, REAL), (n, DRAWS): state of each pixel, and normal numbers; room for DRAWS uint32. Changed.
    events
        (e,) int64: ``(sample * pixels + rank) * 2 + polarity``, so that their order is that of time. Written.

    Returns
    -------
    The index of the pixel to go on with, and the number of events.
    """
    first, until, lux, leaks = light
    key0, key1 = key
    pixels, fixed, dead, pixel, rank, longest = sensor
    scale = 1.0 / rate
    rates, inside, beyond = tables
    table, lows, highs, shifts, unit = moving
    _, _, window, since = stairs
    in_stairs = len(since) > 0
    whole, real, store, words = state
    count = 0
    for i in range(begin, len(pixel)):
        at, wake, segment = whole[i, AT], whole[i, WAKE], whole[i, SEGMENT]
        quiet, used, counter = whole[i, QUIET], whole[i, USED], whole[i, COUNTER]
        calm = whole[i, CALM]
        w, level, moved = real[i, OUTPUT], real[i, LEVEL], real[i, MOVED]
        on_level, off_level = real[i, ON_LEVEL], real[i, OFF_LEVEL]
        place = fixed[i, NODE]
        rms = rms_at(max(fixed[i, GAIN] * lux[segment] + fixed[i, DARK], lowest), noise)
        of_floor = noise[0] / rms  # of the floor, in units of now
        slope = (fixed[i, LEAK] + leaks[segment]) * of_floor
        z = store[i]
        dead_fade = math.exp(-rate * dead[i])
        dead_spread = math.sqrt(1.0 - dead_fade * dead_fade)
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
                current = max(fixed[i, GAIN] * lux[segment] + fixed[i, DARK], lowest)
                before_rms = rms
                rms = rms_at(current, noise)
                change = before_rms / rms
                of_floor = noise[0] / rms
                step = level * change
                level = math.log(current) / rms
                step -= level
                w = w * change + step
                on_level = on_level * change + step
                off_level = off_level * change + step
                slope = (fixed[i, LEAK] + leaks[segment]) * of_floor
                end = first[segment + 1] - 1
                quiet = max(at, min(until[segment], end)) + settle
            event = 0
            before = at
            moves = at < until[segment]
            last = min(end, until[segment], (at // unit + 1) * unit) if moves else end
            gone = 0
            if in_stairs and wake == NEVER and at >= max(calm, since[segment] + settle):
                gone, there, used, event = jump_through(
                    at, segment, on_level, off_level, slope, rate, place, first, stairs, tables, z, used
                )
                if gone == 0:  # nor will it before the window ends
                    calm = window[segment]
            if gone > 0:
                w = there
                at += gone
                on_level -= slope * gone
                off_level -= slope * gone
            elif wake != NEVER and in_stairs:
                w = blind_through(at, wake, segment, w, rate, place, first, stairs, np.float64(z[used]))
                used += 1
                at = wake
            elif wake != NEVER:
                at = min(wake, last)
                if at - before == dead[i]:  # the most frequent by far
                    w = dead_fade * w + dead_spread * np.float64(z[used])
                else:
                    fade = math.exp(-rate * (at - before))
                    w = fade * w + math.sqrt(1.0 - fade * fade) * np.float64(z[used])
                used += 1
                if moves:
                    moved = between_nodes(table, place, at - shifts[segment])
            elif moves:
                samples, upper, lower = block_under_moving_light(
                    w,
                    moved,
                    on_level,
                    off_level,
                    slope,
                    min(last - at, longest[i], LONGEST_MOVING),
                    scale,
                    place,
                    at - shifts[segment],
                    lows,
                    highs,
                )
                gone, w, used = block(w, upper, lower, samples, rate, factors, z, used)
                at += gone
                moved = between_nodes(table, place, at - shifts[segment])
                on_level -= slope * gone
                off_level -= slope * gone
                event = event_at(w + moved, on_level, off_level)
            elif at >= quiet and abs(slope) <= _JUMP_DRIFT * rate and table_holds(on_level, off_level):
                samples = last - at
                if slope != 0.0:
                    samples = max(min(samples, int(_JUMP_DRIFT / abs(slope))), 1)
                half = 0.5 * slope * samples
                gone, w, used, event = jump(
                    on_level - half, off_level - half, samples, rates, inside, beyond, z, used
                )
                at += gone
                on_level -= slope * gone
                off_level -= slope * gone
            elif slope == 0.0:
                most = (last if at >= quiet else min(last, quiet)) - at
                gone, w, used = until_event(w, on_level, off_level, most, longest[i], rate, factors, z, used)
                at += gone
                event = event_at(w, on_level, off_level)
            else:
                most = min((last if at >= quiet else min(last, quiet)) - at, longest[i])
                samples = choose_block(w, on_level, off_level, most, scale)
                upper, lower = nearest(on_level, off_level, slope, samples)
                while not keeps_distance(w, on_level, off_level, upper, lower, samples, scale):
                    samples = (samples + 1) // 2
                    upper, lower = nearest(on_level, off_level, slope, samples)
                gone, w, used = block(w, upper, lower, samples, rate, factors, z, used)
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
                    memorised += reset * of_floor * np.float64(z[used])
                    used += 1
                on_level = memorised + fixed[i, ON] * of_floor
                off_level = memorised - fixed[i, OFF] * of_floor
                quiet = max(at, min(until[segment], end)) + settle
                calm = at + settle
        whole[i, AT], whole[i, WAKE], whole[i, SEGMENT] = at, wake, segment
        whole[i, QUIET], whole[i, USED], whole[i, COUNTER] = quiet, used, counter
        whole[i, CALM] = calm
        real[i, OUTPUT], real[i, LEVEL], real[i, MOVED] = w, level, moved
        real[i, ON_LEVEL], real[i, OFF_LEVEL] = on_level, off_level
        if at < stop - 1:
            return i, count
    return len(pixel), count
