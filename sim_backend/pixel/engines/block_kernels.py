"""Compiled parts of the fast engine: blocks of samples that are skipped unless the pixel can cross in them.

With ``s = exp(2 t / tau)`` the noise is ``w(t) = W(s) / sqrt(s)``, W Brownian. A level b >= 0 is the curve
``b sqrt(s)``, above its chord over the block. For b < 0 the curve is above its tangent in the middle, which is the
chord of the level ``b cosh(x / 2)``, x the length of the block over tau. Between drawn ends w0 and w1 the bridge of W
reaches that line, c its level, with the probability ``exp(-(c - w0)(c - w1) / sinh x)``; no sample can have crossed
unless it does.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from drivers.jit import lean_njit
from sim_backend.pixel.engines.draws_kernels import DRAWS, exponential

# Columns of what a block of n samples needs, x its length in time constants
FADE: Final = 0  #: exp(-x)
SPREAD: Final = 1  #: sqrt(1 - exp(-2 x))
TANGENT: Final = 2  #: cosh(x / 2)
STEEPNESS: Final = 3  #: 1 / sinh(x)
FACTORS: Final = 4  #: how many columns

#: The longest block is ``sqrt(distance / (factor level))`` time constants, for a level beyond zero and on this side.
_FAR: Final = 0.1
_NEAR: Final = 0.5

#: A path is taken never to reach a line if the exponent of the probability is beyond this: 1 in 10^11.
_NO_HIT: Final = 25.0

#: Within so many rms of one sample's step from a level, so many samples are drawn one by one: a block would be hit.
_CLOSE_STEPS: Final = 3.0
_CLOSE_SAMPLES: Final = 16

MOST_DRAWS: Final = 17  #: normal numbers of one step at the most


@lean_njit(forceinline=True)
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
    to_x = 1.0 / x
    slow = abs(y) * to_x
    z *= to_x
    half = 0.5 * span * z * z
    inverse = slow + half + math.sqrt(half * (2.0 * slow + half))
    if e1 * slow >= e2 * inverse:
        inverse = slow * slow / inverse
    return 1.0 / (1.0 + inverse)


@lean_njit(forceinline=True)
def behind_hit(w, end, c, samples, rate, factors, e, z, used):  # type: ignore[no-untyped-def]
    """Return the samples to the first one behind the hit of the line of level c from below, and the output there.

    Four normal numbers are used, and an exponential number e.
    """
    growth = 1.0 / factors[samples, FADE]
    span = growth * growth - 1.0
    part = first_hit(c - w, (c - end) * growth, span, np.float64(z[used]), e, exponential(z, used + 1))
    line = c * (1.0 + (growth - 1.0) * part)
    squared = 1.0 + span * part  # the hit's s, that of the start being 1
    gone = min(int(math.log(squared) / (2.0 * rate)) + 1, samples)
    fade = factors[gone, FADE]
    variance = 1.0 - fade * fade * squared
    return gone, fade * line + math.sqrt(max(variance, 0.0)) * np.float64(z[used + 3])


@lean_njit(forceinline=True)
def block(w, upper, lower, samples, rate, factors, z, used):  # type: ignore[no-untyped-def]
    """Take an armed pixel up to `samples` on, or to the first sample behind the first time at which it may cross.

    A path that reaches the lines of both levels is counted for the upper one: less than 1 in 10^8, since blocks are
    short beside the distance of the two.

    Parameters
    ----------
    w, upper, lower
        Start, and the levels at which an event is made.
    samples, rate
        Length of the block; inverse of the time constant, per sample.
    factors
        (longest + 1, FACTORS) what a block of n samples needs.
    z, used
        Normal numbers in store, and how many of them are used.

    Returns
    -------
    Samples gone, output there, and normal numbers used.
    """
    end = factors[samples, FADE] * w + factors[samples, SPREAD] * np.float64(z[used])
    used += 1
    if samples == 1:
        return samples, end, used
    tangent = factors[samples, TANGENT]
    up = max(upper, 0.0) + min(upper, 0.0) * tangent
    down = max(-lower, 0.0) + min(-lower, 0.0) * tangent
    steepness = factors[samples, STEEPNESS]
    up_exponent = steepness * (up - w) * (up - end)
    down_exponent = steepness * (down + w) * (down + end)
    # An exponential number beyond the exponent is a hit. What it is beyond it is an exponential number again. An end
    # beyond the line has a negative exponent: a hit in any case, which says nothing of the number.
    if up_exponent <= _NO_HIT:
        beyond = exponential(z, used) - max(up_exponent, 0.0)
        used += 2
        if beyond >= 0.0:
            gone, w = behind_hit(w, end, up, samples, rate, factors, beyond, z, used)
            return gone, w, used + 4
    if down_exponent <= _NO_HIT:
        beyond = exponential(z, used) - max(down_exponent, 0.0)
        used += 2
        if beyond >= 0.0:
            gone, w = behind_hit(-w, -end, down, samples, rate, factors, beyond, z, used)
            return gone, -w, used + 4
    return samples, end, used


@lean_njit(forceinline=True)
def inverse_reach(level):  # type: ignore[no-untyped-def]
    """Return one over the distance from a level at which a block may last a time constant.

    For a level on this side of zero the line leaves it at both ends, by half of the pixel's distance at the most:
    ``x^2 <= 2 distance / |level|``. Beyond zero it leaves it only inside; ``x^2 <= 10 distance / level``
    was fastest.

    Parameters
    ----------
    level
        Beyond zero, seen from the pixel: positive.
    """
    return 1.0 / (_FAR * max(level, 0.0) - _NEAR * min(level, 0.0))


@lean_njit(forceinline=True)
def choose_block(w, upper, lower, most, scale):  # type: ignore[no-untyped-def]
    """Return the samples of the next block, from 1 to `most`."""
    squared = min((upper - w) * inverse_reach(upper), (w - lower) * inverse_reach(-lower))
    return max(int(min(scale * math.sqrt(max(squared, 0.0)), float(most))), 1)


@lean_njit(forceinline=True)
def nearest(upper, lower, slope, samples):  # type: ignore[no-untyped-def]
    """Return both levels where a leak takes them nearest to the pixel in a block."""
    return upper - max(slope, 0.0) * samples, lower - min(slope, 0.0) * samples


@lean_njit(forceinline=True)
def one_by_one(w, upper, lower, samples, factors, z, used):  # type: ignore[no-untyped-def]
    """Take an armed pixel to the first sample beyond a level, or `samples` on; as :func:`block`."""
    fade = factors[1, FADE]
    spread = factors[1, SPREAD]
    for gone in range(1, samples + 1):
        w = fade * w + spread * np.float64(z[used])
        used += 1
        if w >= upper or w <= lower:
            return gone, w, used
    return samples, w, used


@lean_njit()
def until_event(w, upper, lower, most, longest, rate, factors, z, used):  # type: ignore[no-untyped-def]
    """Take an armed pixel to its next event, or `most` samples on, or to where normal numbers run out.

    Both levels stay where they are. `longest` is that of a block; otherwise as :func:`block`.
    """
    scale = 1.0 / rate
    to_upper = inverse_reach(upper)
    to_lower = inverse_reach(-lower)
    close = _CLOSE_STEPS * factors[1, SPREAD]
    gone = 0
    while gone < most and used <= DRAWS - MOST_DRAWS:
        left = min(most - gone, longest)
        above = upper - w
        below = w - lower
        if min(above, below) < close:
            took, w, used = one_by_one(w, upper, lower, min(left, _CLOSE_SAMPLES), factors, z, used)
        else:
            squared = min(above * to_upper, below * to_lower)
            samples = left
            if squared < (rate * left) ** 2:
                samples = max(int(scale * math.sqrt(squared)), 1)
            took, w, used = block(w, upper, lower, samples, rate, factors, z, used)
        gone += took
        if w >= upper or w <= lower:
            break
    return gone, w, used
