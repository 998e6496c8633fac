"""Compiled parts of the fast engine: whether, and where first, a block with drawn ends crosses a level.

The chance that any sample of a block is beyond a level is at most the sum of the chances of its samples. With a bound
on that sum most blocks are done with one random number: nothing has crossed, and no sample is drawn. In the rest, one
sample is proposed, each with the bound on its chance, drawn beyond the level, and taken if none before it is beyond a
level too. So a sample is taken with the chance that it is the first one to cross, exactly.

Source: to draw a Gaussian process given that it exceeds a level from the sum over its points is due to R. J. Adler,
J. H. Blanchet and J. Liu, "Efficient Monte Carlo for high excursions of Gaussian random fields", Annals of Applied
Probability 22 (2012), who weight each point by one over the number of exceedances; here the first one is taken.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from drivers.jit import lean_njit
from sim_backend.pixel.engines.block_law_kernels import (
    APP,
    AVP,
    AVV,
    DEVIATION,
    L11,
    L21,
    L22,
    LIMIT,
    S_FADE,
    S_STEP,
    STRICT,
    clearance,
    draw_middle,
    normal_above,
    tail,
)
from sim_backend.pixel.engines.draws_kernels import DRAW_LANES, DRAWS, exponential, fill_draws
from sim_backend.pixel.engines.fast_kernels import event_at

# Rows of the states that are worked with
START: Final = 0
FOUND: Final = 1
_LEFT: Final = 2
_RIGHT: Final = 3
STATES: Final = 4


@lean_njit()
def put(state, other):  # type: ignore[no-untyped-def]
    """Write another (v, p, s) into a state."""
    for i in range(3):
        state[i] = other[i]


@lean_njit()
def over(table, slow, samples):  # type: ignore[no-untyped-def]
    """Return factors and covariance of v and p, factor and variance of s, over any number of samples."""
    avv, avp, app, vv, vp, pp, fade, ss = 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0
    j = 0
    while samples > 0:
        if samples & 1:
            bvv, bvp, bpp = table[j, AVV], table[j, AVP], table[j, APP]
            l11, l21, l22 = table[j, L11], table[j, L21], table[j, L22]
            vv, vp, pp = (
                bvv * (bvv * vv + bvp * vp) + bvp * (bvv * vp + bvp * pp) + l11 * l11,
                bpp * (bvv * vp + bvp * pp) + l11 * l21,
                bpp * bpp * pp + l21 * l21 + l22 * l22,
            )
            avv, avp, app = bvv * avv, bvv * avp + bvp * app, bpp * app
            ss = slow[j, S_FADE] ** 2 * ss + slow[j, S_STEP] ** 2
            fade *= slow[j, S_FADE]
        samples >>= 1
        j += 1
    return avv, avp, app, vv, vp, pp, fade, ss


@lean_njit()
def inside(table, slow, before, after, v0, p0, s0, v1, p1, s1):  # type: ignore[no-untyped-def]
    """Return the law of a sample between two that are known, so many samples before and after it.

    Returns
    -------
    Mean of v, p, s; covariance of v and p (vv, vp, pp); variance of s.
    """
    avv, avp, app, vv, vp, pp, fade, ss = over(table, slow, before)
    bvv, bvp, bpp, rvv, rvp, rpp, rfade, rss = over(table, slow, after)
    mv, mp, ms = avv * v0 + avp * p0, app * p0, fade * s0
    # X = C B', the covariance with the end; W = B C B' + R, that of the end
    x_vv, x_vp, x_pv, x_pp = vv * bvv + vp * bvp, vp * bpp, vp * bvv + pp * bvp, pp * bpp
    w_vv, w_vp, w_pp = bvv * x_vv + bvp * x_pv + rvv, bvv * x_vp + bvp * x_pp + rvp, bpp * x_pp + rpp
    det = w_vv * w_pp - w_vp * w_vp
    k_vv, k_vp, k_pv, k_pp = 0.0, 0.0, 0.0, 0.0
    if det > 1e-13 * w_vv * w_pp:
        k_vv, k_vp = (x_vv * w_pp - x_vp * w_vp) / det, (x_vp * w_vv - x_vv * w_vp) / det
        k_pv, k_pp = (x_pv * w_pp - x_pp * w_vp) / det, (x_pp * w_vv - x_pv * w_vp) / det
    elif w_vv > 0.0:  # nothing is random in p
        k_vv = x_vv / w_vv
    ev, ep = v1 - bvv * mv - bvp * mp, p1 - bpp * mp
    w_ss = rfade * rfade * ss + rss
    k_ss = rfade * ss / w_ss if w_ss > 0.0 else 0.0
    return (
        mv + k_vv * ev + k_vp * ep,
        mp + k_pv * ev + k_pp * ep,
        ms + k_ss * (s1 - rfade * ms),
        max(vv - k_vv * x_vv - k_vp * x_vp, 0.0),
        vp - k_vv * x_pv - k_vp * x_pp,
        max(pp - k_pv * x_pv - k_pp * x_pp, 0.0),
        max(ss - k_ss * rfade * ss, 0.0),
    )


@lean_njit()
def p_given_v(mp, vv, vp, pp, away, z):  # type: ignore[no-untyped-def]
    """Return p of a sample whose v is `away` from its mean."""
    if vv <= 0.0:
        return mp + math.sqrt(pp) * z
    return mp + vp / vv * away + math.sqrt(max(pp - vp * vp / vv, 0.0)) * z


@lean_njit()
def refill(pixel, key0, key1, words, z, numbers):  # type: ignore[no-untyped-def]
    """Have ten normal numbers in store; `numbers` is how many are used, and of counters."""
    if numbers[0] > DRAWS - 10:
        fill_draws(pixel, numbers[1], key0, key1, words, z)
        numbers[1] += DRAW_LANES
        numbers[0] = 0


@lean_njit()
def crosses_inside(  # type: ignore[no-untyped-def]
    table, slow, j, left, right, on_level, off_level, slope, pixel, key0, key1, words, z, numbers, way
):
    """Return whether any sample between two states, 2^j samples apart, is beyond a level.

    Parameters
    ----------
    left, right
        (3,) v, p, s.
    on_level, off_level, slope
        Levels at `left`, and how far they fall in a sample.
    way
        (m, 4) room for states on the way, each with its j.
    """
    v, p, s = left
    way[0, 0], way[0, 1], way[0, 2], way[0, 3] = right[0], right[1], right[2], j
    top = 0
    while top >= 0:
        v1, p1, s1, j = way[top, 0], way[top, 1], way[top, 2], int(way[top, 3])
        drift = slope * (1 << j)
        done = j == 0
        if j > 1:
            up, down = clearance(
                table, slow, j, v, p, s, v1, p1, s1, on_level - max(drift, 0.0), off_level - min(drift, 0.0)
            )
            done = min(up, down) > STRICT * table[j, DEVIATION]
        if done:
            v, p, s = v1, p1, s1
            on_level -= drift
            off_level -= drift
            top -= 1
            if top >= 0 and event_at(v + s, on_level, off_level) != 0:  # the last one is `right` itself
                return True
        else:
            refill(pixel, key0, key1, words, z, numbers)
            m0, m1, m2 = draw_middle(table, slow, j, v, p, s, v1, p1, s1, z, numbers[0])
            numbers[0] += 3
            way[top, 3] = j - 1
            top += 1
            way[top, 0], way[top, 1], way[top, 2], way[top, 3] = m0, m1, m2, j - 1
    return False


@lean_njit()
def first_crossing(  # type: ignore[no-untyped-def]
    table, slow, j, states, end, on_level, off_level, slope, pixel, key0, key1, words, z, numbers, way
):
    """Propose a sample of a block of 2^j beyond a level, and return its number if it is the first to cross, else 0.

    For a block with both levels at least LIMIT deviations away from the expected output: then no sample is beyond one
    of them with more than the tail of LIMIT.

    Parameters
    ----------
    states
        (STATES, 3) v, p, s: START is that at the start; FOUND is that of the sample. Written.
    end
        (3,) the same at the end.
    """
    start, found = states[START], states[FOUND]
    refill(pixel, key0, key1, words, z, numbers)
    used = numbers[0]
    inner = (1 << j) - 1
    on = z[used] > 0.0
    k = 1 + min(int(math.exp(-exponential(z, used + 1)) * inner), inner - 1)
    u = math.exp(-exponential(z, used + 3))
    share = math.exp(-exponential(z, used + 5))
    z0, z1 = np.float64(z[used + 7]), np.float64(z[used + 8])
    numbers[0] += 9
    mv, mp, ms, vv, vp, pp, ss = inside(
        table, slow, k, inner + 1 - k, start[0], start[1], start[2], end[0], end[1], end[2]
    )
    both = math.sqrt(vv + ss)
    away = on_level - slope * k - (mv + ms) if on else (mv + ms) - off_level + slope * k
    if both <= 0.0 or u * tail(table[j, LIMIT]) > tail(away / both):
        return 0
    out = both * normal_above(away / both, share)
    if not on:
        out = -out
    # How much of it is slow noise
    s_away = ss / (vv + ss) * out + math.sqrt(ss * vv / (vv + ss)) * z0
    found[0] = mv + out - s_away
    found[1] = p_given_v(mp, vv, vp, pp, out - s_away, z1)
    found[2] = ms + s_away
    before = crosses_before(
        table, slow, k, states, on_level, off_level, slope, pixel, key0, key1, words, z, numbers, way
    )
    return 0 if before else k


@lean_njit()
def crosses_before(  # type: ignore[no-untyped-def]
    table, slow, k, states, on_level, off_level, slope, pixel, key0, key1, words, z, numbers, way
):
    """Return whether a sample between START and FOUND, `k` samples later, is beyond a level.

    From the right to the left, in steps of 1, 1, 2, 4, ... samples: most often it is the one right before.
    """
    start, left, right = states[START], states[_LEFT], states[_RIGHT]
    put(right, states[FOUND])
    at, j = k, 0
    while at > 0:
        while 1 << j > at:
            j -= 1
        before = at - (1 << j)
        if before > 0:
            refill(pixel, key0, key1, words, z, numbers)
            used = numbers[0]
            mv, mp, ms, vv, vp, pp, ss = inside(
                table, slow, before, 1 << j, start[0], start[1], start[2], right[0], right[1], right[2]
            )
            away = math.sqrt(vv) * np.float64(z[used])
            left[0] = mv + away
            left[1] = p_given_v(mp, vv, vp, pp, away, np.float64(z[used + 1]))
            left[2] = ms + math.sqrt(ss) * np.float64(z[used + 2])
            numbers[0] += 3
            if event_at(left[0] + left[2], on_level - slope * before, off_level - slope * before) != 0:
                return True
        else:
            put(left, start)
        if j > 0 and crosses_inside(
            table, slow, j, left, right, on_level - slope * before, off_level - slope * before, slope, pixel,
            key0, key1, words, z, numbers, way,
        ):  # fmt: skip
            return True
        put(right, left)
        if at != k and j < len(table) - 1:
            j += 1
        at = before
    return False
