"""Compiled parts of the fast engine for pixels with two low-passes, noise that follows the light, or slow noise.

A block of 2^j samples is drawn at its end first. If no sample in between can be beyond a comparator level it is done.
If one can, but is not likely to, one random number decides (:mod:`sim_backend.pixel.engines.excursion_kernels`).
Otherwise the middle of the block is drawn, given both ends, and both halves are looked at in turn, down to single
samples. At the first event what was drawn behind it is forgotten: the future does not depend on how the pixel came to
where it is. While the light moves, the pixel goes sample by sample.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from drivers.jit import lean_njit
from sim_backend.pixel.engines.block_law_kernels import (
    AVP,
    AVV,
    COLUMNS,
    DEVIATION,
    LIMIT,
    PARTS,
    RARE,
    REACH,
    S_FADE,
    STRICT,
    clearance,
    draw_end,
    draw_middle,
    make_table,
    normal_above,
    receptor,
)
from sim_backend.pixel.engines.draws_kernels import DRAW_LANES, DRAWS, fill_draws
from sim_backend.pixel.engines.excursion_kernels import FOUND, START, STATES, first_crossing
from sim_backend.pixel.engines.fast_kernels import NEVER, event_at

if TYPE_CHECKING:
    import numpy.typing as npt

#: A level may come closer during a block by this part of its distance.
_LOST_DISTANCE: Final = 0.5
#: A normal number is further from 0 than this with the chance RARE.
_UNLIKELY: Final = normal_above.py_func(0.0, RARE)

# Whole numbers and real numbers of a pixel's state
AT: Final = 0
WAKE: Final = 1
SEGMENT: Final = 2
USED: Final = 3
COUNTER: Final = 4
WHOLE: Final = 5
V: Final = 0
P: Final = 1
SLOW: Final = 2
LEVEL: Final = 3
ON_LEVEL: Final = 4
OFF_LEVEL: Final = 5
REAL: Final = 6

# What is fixed for a pixel
GAIN: Final = 0
DARK: Final = 1
ON: Final = 2
OFF: Final = 3
LEAK: Final = 4
FIXED: Final = 5

MOST_DRAWS: Final = 8  #: normal numbers of one step at the most
#: Lights whose tables are kept, a power of 2: of two levels the stairs of flicker, at many stairs of drift.
_KEPT_BITS: Final = 12
_KEPT_LIGHTS: Final = 1 << _KEPT_BITS
#: Places in which the table of a light may be.
_PROBES: Final = 16
#: Spreads neighbouring numbers (2^64 over the golden ratio; Knuth, The Art of Computer Programming 3, 6.4).
_SPREAD: Final = np.uint64(0x9E3779B97F4A7C15)
_MANTISSA: Final = float(1 << 53)


@lean_njit(forceinline=True)
def largest(samples, levels):  # type: ignore[no-untyped-def]
    """Return j of the longest block of 2^j samples that is not longer than `samples`."""
    j = levels
    while samples < 1 << j:
        j -= 1
    return j


@lean_njit(forceinline=True)
def choose(table, slow, longest, most, slope, v, p, s, on_level, off_level):  # type: ignore[no-untyped-def]
    """Return j of the next block of an armed pixel, `longest` and `most` samples at the most.

    Both levels are to be far enough from where the output is, and from where it is expected at the end.
    """
    out = v + s
    j = largest(most, longest)
    while j > 0:
        end = table[j, AVV] * v + table[j, AVP] * p + slow[j, S_FADE] * s
        near = min(on_level - max(out, end), min(out, end) - off_level)
        if table[j, REACH] <= near and abs(slope) * (1 << j) <= _LOST_DISTANCE * near:
            break
        j -= 1
    return j


@lean_njit(forceinline=True)
def walk(lux, settled, gain, dark, c, v, p, s, z, used):  # type: ignore[no-untyped-def]
    """Return the state one sample later under moving light; three normal numbers.

    Parameters
    ----------
    lux
        Illuminance at that sample.
    settled
        Logarithm of the photocurrent at the settled light.
    """
    current = max(gain * lux + dark, c.lowest_fa)
    forget, added, sigma = receptor(current, c)
    p = forget * p + (1.0 - forget) * (math.log(current) - settled) + added * np.float64(z[used])
    v = c.rho * v + (1.0 - c.rho) * p + sigma * np.float64(z[used + 1])
    return v, p, c.slow_rho * s + c.slow_sigma * np.float64(z[used + 2])


@lean_njit(forceinline=True)
def place_of(current):  # type: ignore[no-untyped-def]
    """Return the first of the places in which the table of a photocurrent may be."""
    digits = np.uint64(math.frexp(current)[0] * _MANTISSA)
    return np.int64((digits * _SPREAD) >> np.uint64(64 - _KEPT_BITS))


@lean_njit()
def table_of(current, c, slow, levels, kept, tables, parts):  # type: ignore[no-untyped-def]
    """Return the number of the table of a photocurrent, made if none has it, in place of another if it must be."""
    first = place_of(current)
    found = first
    for probe in range(_PROBES):
        i = (first + probe) & (_KEPT_LIGHTS - 1)
        if kept[i] == current:
            return i
        if kept[i] < 0.0:
            found = i
            break
    kept[found] = current
    make_table(current, c, slow, levels, tables[found], parts)
    return found


def work_room(levels: int) -> tuple[npt.NDArray[Any], ...]:
    """Return room to work in, for blocks of up to 2^levels samples: kernels that make no array are faster."""
    return (
        np.empty(DRAWS, np.uint32),
        np.empty((_KEPT_LIGHTS, levels + 1, COLUMNS)),
        np.full(_KEPT_LIGHTS, -1.0),  # the photocurrents of these tables
        np.empty((levels + 2, 3)),  # states drawn ahead, the nearest last
        np.empty(levels + 2, np.int64),  # j of the stretch up to each
        np.empty(2, np.int64),
        np.empty((STATES, 3)),
        np.empty((levels + 2, 4)),
        np.empty((2, PARTS)),
    )


@lean_njit()
def run_pixels(begin, stop, light, c, slow, key, pixels, sensor, state, work, events):  # type: ignore[no-untyped-def]
    """Take pixels to sample `stop` - 1, or until there is no more room for events.

    Parameters
    ----------
    begin
        Index of the pixel to begin with.
    stop
        Sample.
    light
        (m + 1,), (m,), (m,), (m,): first sample of each segment between two edges, with one beyond all others; last
        sample at which its light still moves; its settled light; its leak, ln units per sample, beside that of the
        pixel. (s,) illuminance at the samples of the stretch, and the number of the first.
    c
        :class:`~sim_backend.pixel.engines.general_kernels.Coefficients`.
    slow
        (levels + 1, SLOW_COLUMNS) slow noise over blocks of 2^j samples.
    key
        Seed of the recording, two uint32.
    pixels
        Number of all pixels.
    sensor
        Of each pixel: (n, FIXED) what is fixed; (n,) samples of dead time; (n,) uint32 number; (n,) place in the
        order in which events of one time are given.
    state
        (n, WHOLE), (n, REAL), (n, DRAWS): state of each pixel, and normal numbers. Changed.
    work
        Room to work in: :func:`work_room`. Lights whose tables it has are not worked out again.
    events
        (e,) int64: ``(sample * pixels + rank) * 2 + polarity``. Written.

    Returns
    -------
    The index of the pixel to go on with, and the number of events.
    """
    first, until, settled_lux, leaks, lux, lux_begin = light
    key0, key1 = key
    fixed, dead, pixel, rank = sensor
    whole, real, store = state
    levels = len(slow) - 1
    words, tables, kept, ends, lengths, numbers, states, way, parts = work
    count = 0
    draws = 3 if c.slow_sigma > 0.0 else 2  # the third number of a step is of the slow noise
    for i in range(begin, len(pixel)):
        at, wake, segment, used, counter = (
            whole[i, AT], whole[i, WAKE], whole[i, SEGMENT], whole[i, USED], whole[i, COUNTER]
        )  # fmt: skip
        v, p, s, level = real[i, V], real[i, P], real[i, SLOW], real[i, LEVEL]
        on_level, off_level = real[i, ON_LEVEL], real[i, OFF_LEVEL]
        z = store[i]
        current = max(fixed[i, GAIN] * settled_lux[segment] + fixed[i, DARK], c.lowest_fa)
        which = table_of(current, c, slow, levels, kept, tables, parts)
        table = tables[which]
        slope = fixed[i, LEAK] + leaks[segment]
        end = min(first[segment + 1], stop) - 1
        top = -1
        last = 0  # j of the last block that was begun
        while at < stop - 1 and count < len(events):
            if used > DRAWS - MOST_DRAWS:
                fill_draws(pixel[i], counter, key0, key1, words, z)
                counter += DRAW_LANES
                used = 0
            if at >= end:
                while at >= first[segment + 1] - 1:
                    segment += 1
                current = max(fixed[i, GAIN] * settled_lux[segment] + fixed[i, DARK], c.lowest_fa)
                which = table_of(current, c, slow, levels, kept, tables, parts)
                table = tables[which]
                slope = fixed[i, LEAK] + leaks[segment]
                end = min(first[segment + 1], stop) - 1
                step = level - math.log(current)
                level -= step
                v += step
                p += step
                on_level += step
                off_level += step
            event = 0
            if at < until[segment]:
                v, p, s = walk(lux[at + 1 - lux_begin], level, fixed[i, GAIN], fixed[i, DARK], c, v, p, s, z, used)
                used += draws
                at += 1
                if wake == NEVER:
                    on_level -= slope
                    off_level -= slope
                    event = event_at(v + s, on_level, off_level)
            elif wake != NEVER:
                j = largest(min(wake, end) - at, levels)
                v, p, s = draw_end(table, slow, j, v, p, s, z, used)
                used += draws
                at += 1 << j
            else:
                if top < 0:
                    top = 0
                    last = choose(table, slow, min(last + 2, levels), end - at, slope, v, p, s, on_level, off_level)
                    lengths[0] = last
                    ends[0, V], ends[0, P], ends[0, SLOW] = draw_end(table, slow, last, v, p, s, z, used)
                    used += draws
                j = lengths[top]
                v1, p1, s1 = ends[top, V], ends[top, P], ends[top, SLOW]
                drift = slope * (1 << j)
                done = j == 0
                if j > 1:
                    up, down = clearance(
                        table, slow, j, v, p, s, v1, p1, s1, on_level - max(drift, 0.0), off_level - min(drift, 0.0)
                    )
                    done = min(up, down) > table[j, LIMIT] * table[j, DEVIATION]
                    if done and min(up, down) < STRICT * table[j, DEVIATION]:
                        used += 1
                        if abs(z[used - 1]) > _UNLIKELY:
                            numbers[0], numbers[1] = used, counter
                            states[START, V], states[START, P], states[START, SLOW] = v, p, s
                            k = first_crossing(
                                table, slow, j, states, ends[top], on_level, off_level, slope, pixel[i],
                                key0, key1, words, z, numbers, way,
                            )  # fmt: skip
                            used, counter = numbers[0], numbers[1]
                            if k > 0:
                                v1, p1, s1 = states[FOUND, V], states[FOUND, P], states[FOUND, SLOW]
                                drift = slope * k
                                at += k - (1 << j)
                if done:
                    v, p, s = v1, p1, s1
                    on_level -= drift
                    off_level -= drift
                    at += 1 << j
                    top -= 1
                    event = event_at(v + s, on_level, off_level)
                else:
                    top += 1
                    ends[top, V], ends[top, P], ends[top, SLOW] = draw_middle(
                        table, slow, j, v, p, s, v1, p1, s1, z, used
                    )
                    used += draws
                    lengths[top - 1] = j - 1
                    lengths[top] = j - 1
            if event != 0:
                events[count] = (at * pixels + rank[i]) * 2 + (event > 0)
                count += 1
                wake = at + dead[i]
                top = -1  # what was drawn ahead is forgotten
            if at == wake:
                wake = NEVER
                memorised = v + s
                if c.reset_rms > 0.0:
                    memorised += c.reset_rms * np.float64(z[used])
                    used += 1
                on_level = memorised + fixed[i, ON]
                off_level = memorised - fixed[i, OFF]
        whole[i, AT], whole[i, WAKE], whole[i, SEGMENT] = at, wake, segment
        whole[i, USED], whole[i, COUNTER] = used, counter
        real[i, V], real[i, P], real[i, SLOW], real[i, LEVEL] = v, p, s, level
        real[i, ON_LEVEL], real[i, OFF_LEVEL] = on_level, off_level
        if at < stop - 1:
            return i, count
    return len(pixel), count
