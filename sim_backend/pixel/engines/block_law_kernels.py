"""Compiled parts of the fast engine: the law of a pixel with two low-passes over 2^j samples, and in their middle.

Between two edges the output v and the photoreceptor p, less their settled level, and the slow noise s are a Gaussian
Markov process with constant coefficients. What is needed for blocks of each length follows from the step of one
sample of the reference engine by doubling, so the law of the samples is its own.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from drivers.jit import lean_njit
from sim_backend.pixel.engines.general_kernels import exp_falling

#: A sample counts as unable to be beyond a level that is this many of its conditional standard deviations away, or
#: more: a Brownian bridge reaches a level at K times the deviation in its middle with exp(-K^2 / 2) = 7e-10.
STRICT: Final = 6.5
#: Bound on the chance that a block which is done with one random number crosses a level.
RARE: Final = 0.03
#: A block is begun only if the levels also are this many of the deviations of its end away.
_REACH: Final = 0.5
#: Largest j of a block of 2^j samples.
MOST_HALVINGS: Final = 13
#: Between the ends of a block the expected output is looked at in 2^DEPTH parts when the table is made.
_DEPTH: Final = 4
PARTS: Final = (1 << _DEPTH) + 1
#: and may be this much further from the lines between the quarters in between.
_BETWEEN_PARTS: Final = 1.1

#: Newton's steps for the inverse of the normal tail: they come from above, then quadratically.
_NEWTON_STEPS: Final = 8

# Columns of the table of a light: one row for each j
AVV: Final = 0  #: factors of v and p over a block
AVP: Final = 1
APP: Final = 2
L11: Final = 3  #: Cholesky factor of what noise adds to v and p in it
L21: Final = 4
L22: Final = 5
G0: Final = 6  #: (v, p) in the middle from (v, p) at the start, by rows
G1: Final = 10  #: the same from the end
M11: Final = 14  #: Cholesky factor of the rest in the middle
M21: Final = 15
M22: Final = 16
SLACK: Final = 17  #: how far the output can be from the lines between its quarters, per |v0|, |p0|, |v1|, |p1|
DEVIATION: Final = 21  #: largest conditional deviation of the output inside
LIMIT: Final = 22  #: with both levels so many deviations away, a block crosses with less than RARE
REACH: Final = 23  #: how far away a level must be for a block to be worth while
COLUMNS: Final = 24

# Columns of the slow noise: one row for each j
S_FADE: Final = 0
S_STEP: Final = 1
S_MIDDLE: Final = 2  #: middle from either end
S_REST: Final = 3  #: deviation of the rest
SLOW_COLUMNS: Final = 4


@lean_njit()
def tail(x):  # type: ignore[no-untyped-def]
    """Return the probability that a standard normal number is above x."""
    return 0.5 * math.erfc(x * math.sqrt(0.5))


@lean_njit()
def normal_above(a, u):  # type: ignore[no-untyped-def]
    """Return the standard normal number above a >= 0 whose tail is the part u of that of a."""
    target = math.log(tail(a)) + math.log(u)
    x = math.sqrt(a * a - 2.0 * math.log(u))
    for _ in range(_NEWTON_STEPS):
        t = tail(x)
        x += (math.log(t) - target) * t * math.sqrt(2.0 * math.pi) * math.exp(0.5 * x * x)
    return max(x, a)


@lean_njit()
def receptor(current, c):  # type: ignore[no-untyped-def]
    """Return factor of the photoreceptor, what shot noise adds to it, and rms of the noise of the source follower.

    A photoreceptor that forgets within a sample hands its white noise on to the source follower.
    """
    shot = math.sqrt(c.shot_fa / current)
    forget = exp_falling(min(c.receptor_per_fa * current, c.receptor_most))
    if forget > 0.0:
        return forget, (1.0 - forget) * shot, c.sigma
    return 0.0, 0.0, math.hypot(c.sigma, (1.0 - c.rho) * shot)


@lean_njit()
def cholesky(vv, vp, pp):  # type: ignore[no-untyped-def]
    """Return the factor (l11, l21, l22) of a covariance of v and p."""
    l11 = math.sqrt(max(vv, 0.0))
    l21 = vp / l11 if l11 > 0.0 else 0.0
    return l11, l21, math.sqrt(max(pp - l21 * l21, 0.0))


@lean_njit()
def make_table(current, c, slow, levels, table, parts):  # type: ignore[no-untyped-def]
    """Write the rows j = 0 to `levels` for a photocurrent (fA); `parts`, (2, PARTS), is room to work in."""
    forget, added, sigma = receptor(current, c)
    # x <- A x + noise; noise of v: (1 - rho) of what is added to p, and its own.
    avv, avp, app = c.rho, (1.0 - c.rho) * forget, forget
    into_v = (1.0 - c.rho) * added
    vv, vp, pp = into_v * into_v + sigma * sigma, into_v * added, added * added
    for j in range(levels + 1):
        row = table[j]
        row[AVV], row[AVP], row[APP] = avv, avp, app
        row[L11], row[L21], row[L22] = cholesky(vv, vp, pp)
        # Twice as long: A <- A A, C <- A C A' + C
        next_vv = avv * (avv * vv + avp * vp) + avp * (avv * vp + avp * pp) + vv
        next_vp = app * (avv * vp + avp * pp) + vp
        next_pp = app * app * pp + pp
        if j < levels:
            _middle(row, table[j + 1], vv, vp, pp, next_vv, next_vp, next_pp)
        avv, avp, app = avv * avv, avp * (avv + app), app * app
        vv, vp, pp = next_vv, next_vp, next_pp
    for j in range(2, levels + 1):
        _bounds(table, j, parts)
        row = table[j]
        row[DEVIATION] = math.hypot(_deviation(table, j), slow[j, S_REST])
        row[LIMIT] = normal_above(0.0, RARE / ((1 << j) - 1))
        row[REACH] = row[LIMIT] * row[DEVIATION] + _REACH * math.hypot(row[L11], slow[j, S_STEP])
    table[0, REACH] = 0.0
    table[1, REACH] = 0.0


@lean_njit()
def _middle(half, row, vv, vp, pp, whole_vv, whole_vp, whole_pp):  # type: ignore[no-untyped-def]
    """Write the law in the middle of a block: ``K = C A' W^-1``, ``G0 = A - K A A``, ``G1 = K``, rest ``C - K A C``.

    C is the covariance of half the block, W of the whole, A the factors of half.
    """
    avv, avp, app = half[AVV], half[AVP], half[APP]
    # C A', whose second index is that of the end
    b_vv, b_vp = vv * avv + vp * avp, vp * app
    b_pv, b_pp = vp * avv + pp * avp, pp * app
    det = whole_vv * whole_pp - whole_vp * whole_vp
    if det > 1e-13 * whole_vv * whole_pp:
        k_vv, k_vp = (b_vv * whole_pp - b_vp * whole_vp) / det, (b_vp * whole_vv - b_vv * whole_vp) / det
        k_pv, k_pp = (b_pv * whole_pp - b_pp * whole_vp) / det, (b_pp * whole_vv - b_pv * whole_vp) / det
    else:  # nothing is random in p
        k_vv, k_vp, k_pv, k_pp = (b_vv / whole_vv if whole_vv > 0.0 else 0.0), 0.0, 0.0, 0.0
    row[G1], row[G1 + 1], row[G1 + 2], row[G1 + 3] = k_vv, k_vp, k_pv, k_pp
    a2_vv, a2_vp, a2_pp = avv * avv, avp * (avv + app), app * app
    row[G0], row[G0 + 1] = avv - k_vv * a2_vv, avp - k_vv * a2_vp - k_vp * a2_pp
    row[G0 + 2], row[G0 + 3] = -k_pv * a2_vv, app - k_pv * a2_vp - k_pp * a2_pp
    rest_vv = vv - k_vv * b_vv - k_vp * b_vp
    rest_vp = vp - k_vv * b_pv - k_vp * b_pp
    rest_pp = pp - k_pv * b_pv - k_pp * b_pp
    row[M11], row[M21], row[M22] = cholesky(rest_vv, rest_vp, rest_pp)


@lean_njit(forceinline=True)
def between(table, j, v0, p0, v1, p1):  # type: ignore[no-untyped-def]
    """Return the expected v and p in the middle of a block."""
    v = table[j, G0] * v0 + table[j, G0 + 1] * p0 + table[j, G1] * v1 + table[j, G1 + 1] * p1
    p = table[j, G0 + 2] * v0 + table[j, G0 + 3] * p0 + table[j, G1 + 2] * v1 + table[j, G1 + 3] * p1
    return v, p


@lean_njit()
def _bounds(table, j, parts):  # type: ignore[no-untyped-def]
    """Write by how much the expected output can leave the lines between its quarters, for each end's v and p.

    It is looked at in equal parts, and at all halvings towards both ends: what a low-pass much faster than the block
    does is over soon behind its start, or comes right before its end.
    """
    for which in range(4):
        # v and p at the start, v and p at the end
        ends = (
            1.0 if which == 0 else 0.0,
            1.0 if which == 1 else 0.0,
            1.0 if which == 2 else 0.0,
            1.0 if which == 3 else 0.0,
        )
        most = max(_in_parts(table, j, ends, parts), _towards_ends(table, j, ends))
        table[j, SLACK + which] = _BETWEEN_PARTS * most


@lean_njit()
def _in_parts(table, j, ends, room):  # type: ignore[no-untyped-def]
    """Return how far the expected output is from the lines between the quarters, at 2^DEPTH parts of a block."""
    depth = min(j, _DEPTH)
    parts = 1 << depth
    v, p = room[0], room[1]
    v[0], p[0], v[parts], p[parts] = ends
    step = parts
    for level in range(depth):
        for at in range(0, parts, step):
            w = at + step
            v[at + step // 2], p[at + step // 2] = between(table, j - level, v[at], p[at], v[w], p[w])
        step //= 2
    most = 0.0
    quarter = parts // 4
    for at in range(parts):
        low = at // quarter * quarter
        line = v[low] + (at - low) / quarter * (v[low + quarter] - v[low])
        most = max(most, abs(v[at] - line))
    return most


@lean_njit()
def _towards_ends(table, j, ends):  # type: ignore[no-untyped-def]
    """Return the same at the halvings of the first and of the last quarter, towards the ends of the block.

    Between two halvings stands the middle of both, so that no bump of one time constant falls in between.
    """
    most = 0.0
    for first in range(2):
        v0, p0, v1, p1 = ends
        for k in range(2):  # the quarter at this end
            vm, pm = between(table, j - k, v0, p0, v1, p1)
            if first:
                v1, p1 = vm, pm
            else:
                v0, p0 = vm, pm
        left, right = v0, v1
        share = 1.0
        for level in range(j - 2, 0, -1):
            vm, pm = between(table, level, v0, p0, v1, p1)
            share *= 0.5
            at = share if first else 1.0 - share
            most = max(most, abs(vm - (left + at * (right - left))))
            if level > 1:  # the middle of the half that is left behind
                if first:
                    vh, _ = between(table, level - 1, vm, pm, v1, p1)
                    at = 1.5 * share
                else:
                    vh, _ = between(table, level - 1, v0, p0, vm, pm)
                    at = 1.0 - 1.5 * share
                most = max(most, abs(vh - (left + at * (right - left))))
            if first:
                v1, p1 = vm, pm
            else:
                v0, p0 = vm, pm
    return most


@lean_njit()
def _deviation(table, j):  # type: ignore[no-untyped-def]
    """Return the largest conditional deviation of v in a block: of its middle and of its quarters."""
    row, half = table[j], table[j - 1]
    most = row[M11] ** 2
    for g in (G0, G1):  # the quarter behind the middle, and the one before it
        a = half[g] * row[M11] + half[g + 1] * row[M21]
        b = half[g + 1] * row[M22]
        most = max(most, half[M11] ** 2 + a * a + b * b)
    return 1.02 * math.sqrt(most)


@lean_njit(forceinline=True)
def clearance(table, slow, j, v0, p0, s0, v1, p1, s1, upper, lower):  # type: ignore[no-untyped-def]
    """Return how far both levels are, at least, from the expected output at any sample of a block of 2^j, j >= 2."""
    h = j - 1
    vm, pm = between(table, j, v0, p0, v1, p1)
    q = table[h, G0] * v0 + table[h, G0 + 1] * p0 + table[h, G1] * vm + table[h, G1 + 1] * pm
    r = table[h, G0] * vm + table[h, G0 + 1] * pm + table[h, G1] * v1 + table[h, G1 + 1] * p1
    slack = (
        table[j, SLACK] * abs(v0)
        + table[j, SLACK + 1] * abs(p0)
        + table[j, SLACK + 2] * abs(v1)
        + table[j, SLACK + 3] * abs(p1)
    )
    # The slow noise is expected between its ends, or nearer to 0: of two ends at the same level most in their middle.
    nearest = 2.0 * slow[j, S_MIDDLE]
    s_high, s_low = max(s0, s1), min(s0, s1)
    high = max(max(max(v0, v1), max(q, r)), vm) + (s_high if s_high > 0.0 else s_high * nearest)
    low = min(min(min(v0, v1), min(q, r)), vm) + (s_low if s_low < 0.0 else s_low * nearest)
    return upper - high - slack, low - slack - lower


@lean_njit(forceinline=True)
def draw_end(table, slow, j, v, p, s, z, used):  # type: ignore[no-untyped-def]
    """Return the state at the end of a block; three normal numbers."""
    z0, z1 = np.float64(z[used]), np.float64(z[used + 1])
    return (
        table[j, AVV] * v + table[j, AVP] * p + table[j, L11] * z0,
        table[j, APP] * p + table[j, L21] * z0 + table[j, L22] * z1,
        slow[j, S_FADE] * s + slow[j, S_STEP] * np.float64(z[used + 2]),
    )


@lean_njit(forceinline=True)
def draw_middle(table, slow, j, v0, p0, s0, v1, p1, s1, z, used):  # type: ignore[no-untyped-def]
    """Return the state in the middle of a block, given both ends; three normal numbers."""
    z0, z1 = np.float64(z[used]), np.float64(z[used + 1])
    v, p = between(table, j, v0, p0, v1, p1)
    return (
        v + table[j, M11] * z0,
        p + table[j, M21] * z0 + table[j, M22] * z1,
        slow[j, S_MIDDLE] * (s0 + s1) + slow[j, S_REST] * np.float64(z[used + 2]),
    )
