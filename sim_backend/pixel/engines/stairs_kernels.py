"""Compiled parts of the fast engine: a quiet pixel under light in stairs, which are low beside its noise.

What the low-pass makes of the light, the response R, is the same with and without noise, and what it makes of the
noise, w, is stationary. Seen from w the levels move with R, slowly beside an excursion of w, which lasts a time
constant over b^2 at a level b. So the pixel may go by the table of rates not to the end of a stair, but through many:
with the hazard of the nearest approach it is taken to where there may be an event, and there is one with the share
that the hazard at that moment has of it.

A level that comes nearer meets more paths. Near a barrier b that moves by b' in a time constant the density of
Ornstein-Uhlenbeck paths is ``exp(b x) - exp(b' x)`` (x the distance from it) times the Gaussian: that solves the
Fokker-Planck equation of ``dw = -w dt + sqrt(2) dW`` there. Its slope at the barrier, the rate of crossings, is
``b - b'`` instead of b. In a time constant R moves by its distance from the settled level, and that must be a small
share of b.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from drivers.jit import lean_njit, njit
from sim_backend.pixel.engines.block_kernels import nearest
from sim_backend.pixel.engines.draws_kernels import exponential
from sim_backend.pixel.engines.jump_kernels import APART, from_normal, hazard, most_hazard, quiet_output
from sim_backend.pixel.engines.moving_kernels import between_nodes

# Tables of the response, over dark currents and segments, in rms of the noise
RESPONSE: Final = 0  #: at the beginning of the segment, since t = 0
AWAY: Final = 1  #: there, less the settled level of the segment
HIGHEST: Final = 2  #: extremes from there to the end of the window
LOWEST: Final = 3
TABLES: Final = 4  #: how many

#: A response further from its settled level than this, rms, is no low stair.
LOW: Final = 2.0
#: A window, through which one jump leads, has so many stairs at the most.
WINDOW: Final = 32
#: R may move by this share of the nearest level in a time constant, and that be so near, rms: what is left out goes
#: with the square of the one, and with how long an excursion to the other takes.
_SLOW: Final = 0.25
_NEAREST: Final = 3.0
#: Possible events that turn out to be none, in one jump.
_TRIALS: Final = 3


@lean_njit(forceinline=True)
def begin_of(first, segment):  # type: ignore[no-untyped-def]
    """Return the last sample that the light before a segment has shaped."""
    return max(first[segment] - 1, 0)


@lean_njit()
def follow(first, lux, start_lux, lowest_lux, rate, rms, response, away):  # type: ignore[no-untyped-def]
    """Write (m,) the response at the beginning of each segment, and what it is away from the settled level there.

    Parameters are those of :func:`respond`; dark currents are part of the light.
    """
    start = max(start_lux, lowest_lux)
    at = 0.0
    for s in range(len(lux)):
        level = math.log(max(lux[s], lowest_lux) / start) / rms
        response[s] = at
        away[s] = at - level
        if first[s + 1] > 1:  # else it is over before t = 0
            at = level + away[s] * math.exp(-rate * (begin_of(first, s + 1) - begin_of(first, s)))


@lean_njit()
def find_calm(first, away, fastest, window, since):  # type: ignore[no-untyped-def]
    """Write where stairs are low, and the windows that jumps may lead through; see :func:`respond`."""
    segments = len(away)
    beyond = first[segments]
    for s in range(segments):
        fastest[s] = abs(away[s])
        since[s] = beyond
        if fastest[s] <= LOW:
            since[s] = since[s - 1] if s > 0 and since[s - 1] < beyond else begin_of(first, s)
    for s in range(segments - 1, -1, -1):
        window[s] = begin_of(first, s + 1)
        if (s + 1) % WINDOW != 0 and s + 1 < segments and since[s + 1] < beyond:
            window[s] = window[s + 1]
            fastest[s] = max(fastest[s], fastest[s + 1])


@njit(cache=True, nogil=True, error_model="numpy")
def respond(  # type: ignore[no-untyped-def]
    first, lux, start_lux, dark_lux, lowest_lux, rate, rms, tables, fastest, window, since
):
    """Fill the tables of the response, for a few dark currents.

    Parameters
    ----------
    first, lux
        (m + 1,) first sample of each segment; (m,) its light, which does not move.
    start_lux
        Light at t = 0, at which everything has settled.
    dark_lux, lowest_lux
        (k,) dark currents, as light; the logarithm is taken of no less than this.
    rate, rms
        Inverse of the time constant, per sample; rms of the noise, the unit of the tables.
    tables
        (TABLES, k, m). Written.
    fastest, window, since
        (m,) how far R is away at the most, until the end of the window; its last sample; sample since which all
        stairs have been low, or one beyond all others. Those of a pixel without dark current, in which R moves most:
        they are the same whatever pixels there are. Written.
    """
    segments = len(lux)
    response, away = np.empty(segments), np.empty(segments)
    follow(first, lux, start_lux, lowest_lux, rate, rms, response, away)
    find_calm(first, away, fastest, window, since)
    for k in range(len(dark_lux)):
        row = tables[:, k]
        follow(
            first, lux + dark_lux[k], start_lux + dark_lux[k], lowest_lux, rate, rms, row[RESPONSE], row[AWAY]
        )  # fmt: skip
        for s in range(segments - 1, -1, -1):
            end = row[RESPONSE, s + 1] if s + 1 < segments else row[RESPONSE, s] - row[AWAY, s]
            row[HIGHEST, s], row[LOWEST, s] = max(row[RESPONSE, s], end), min(row[RESPONSE, s], end)
            if s + 1 < segments and window[s] == window[s + 1]:
                row[HIGHEST, s] = max(row[HIGHEST, s], row[HIGHEST, s + 1])
                row[LOWEST, s] = min(row[LOWEST, s], row[LOWEST, s + 1])


@lean_njit(forceinline=True)
def shift_at(tables, place, segment, rate, first, at):  # type: ignore[no-untyped-def]
    """Return the response of a pixel at a sample, and what it is away from the settled level of its segment.

    Parameters
    ----------
    segment
        That of the sample, or one before.
    """
    while first[segment + 1] - 1 < at:
        segment += 1
    begin_away = between_nodes(tables[AWAY], place, segment)
    away = begin_away * math.exp(-rate * (at - begin_of(first, segment)))
    return between_nodes(tables[RESPONSE], place, segment) - begin_away + away, away


@lean_njit()
def blind_through(at, wake, segment, w, rate, place, first, stairs, z):  # type: ignore[no-untyped-def]
    """Return the output of a blind pixel at the sample at which it wakes, less the settled level of now.

    Parameters
    ----------
    w
        The same at the sample `at` of a segment.
    z
        A normal number.
    """
    tables = stairs[0]
    now, away = shift_at(tables, place, segment, rate, first, at)
    fade = math.exp(-rate * (wake - at))
    then, _ = shift_at(tables, place, segment, rate, first, wake)
    return fade * (w - away) + math.sqrt(1.0 - fade * fade) * z + away + then - now


@lean_njit()
def jump_through(at, segment, on_level, off_level, slope, rate, place, first, stairs, hazards, z, used):  # type: ignore[no-untyped-def]
    """Take a quiet pixel to its next event, or to the end of the window, or not so far.

    Parameters
    ----------
    on_level, off_level
        Levels for the output less the settled level of the segment; both go down by `slope` per sample.

    Returns
    -------
    Samples gone, 0 if levels are too near or move too fast; output there, less the settled level of now; normal
    numbers used; and 1 for an ON event, -1 for an OFF event, 0 for none.
    """
    tables, fastest, window, _ = stairs
    rates, inside, beyond = hazards
    now, away = shift_at(tables, place, segment, rate, first, at)
    samples = window[segment] - at
    on_level -= away
    off_level -= away
    high, low = between_nodes(tables[HIGHEST], place, segment), between_nodes(tables[LOWEST], place, segment)
    upper, lower = nearest(on_level + now - high, off_level + now - low, slope, samples)
    near, leak = min(upper, -lower), slope / rate
    if near < _NEAREST or on_level - off_level < APART:
        return 0, 0.0, used, 0
    speed = (fastest[segment] + abs(leak)) / near
    if speed > _SLOW:
        return 0, 0.0, used, 0
    most = (1.0 + speed) * (most_hazard(rates, upper) + most_hazard(rates, -lower))
    gone, moved = 0, 0.0
    for _ in range(_TRIALS):
        wait = exponential(z, used)
        used += 2
        certain = wait >= most * (samples - gone)  # that nothing happens
        gone = samples if certain else min(gone + int(wait / most) + 1, samples)
        then, away_then = shift_at(tables, place, segment, rate, first, at + gone)
        moved = then - now
        upper = on_level - moved - slope * gone
        lower = off_level - moved - slope * gone
        if certain:
            break
        share = most * math.exp(-exponential(z, used))
        used += 2
        on = hazard(rates, upper) * (1.0 + (leak - away_then) / upper)
        off = hazard(rates, -lower) * (1.0 + (leak - away_then) / lower)
        if share < on:
            return gone, from_normal(beyond, upper, np.float64(z[used])) + away + moved, used + 1, 1
        if share < on + off:
            return gone, away + moved - from_normal(beyond, -lower, np.float64(z[used])), used + 1, -1
    return gone, quiet_output(upper, lower, inside, np.float64(z[used])) + away + moved, used + 1, 0
