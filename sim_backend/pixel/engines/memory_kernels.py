"""Compiled part of light in stairs: what a high-pass remembers of it, level by level."""

from __future__ import annotations

import math
from typing import Final

from drivers.jit import lean_njit

#: Two rates that are closer, relatively, are taken to be so far apart; the fastest, in a sample.
_NOT_THE_SAME: Final = 0.01
_FASTEST: Final = 100.0


@lean_njit()
def apart(rate, other):  # type: ignore[no-untyped-def]
    """Return a rate that is not that of another: the solutions are sums of different exponentials."""
    return rate if abs(rate / other - 1.0) > _NOT_THE_SAME else other * (1.0 + _NOT_THE_SAME)


@lean_njit()
def remember(w, c, receptor, settled, samples, slopes):  # type: ignore[no-untyped-def]
    """Write the slope of what is remembered in each level.

    Parameters
    ----------
    w, c
        Rates of the high-pass and of the source follower, per sample.
    receptor
        (m,) that of the photoreceptor in each level.
    settled
        (m,) the settled level u, ln units.
    samples
        (m,) how long each is.
    slopes
        (m,) is filled: ln units per sample.
    """
    c = apart(c, w)
    p = v = remembered = settled[0]
    for i in range(len(settled)):
        u, n = settled[i], samples[i]
        r = apart(apart(min(receptor[i], _FASTEST), w), c)
        slow, fast, first = math.exp(-w * n), math.exp(-c * n), math.exp(-r * n)
        of_p = (p - u) * c / (c - r)
        of_v = v - u - of_p
        rest = remembered - u - of_v * w / (w - c) - of_p * w / (w - r)
        end = u + rest * slow + of_v * w / (w - c) * fast + of_p * w / (w - r) * first
        slopes[i] = (end - remembered) / n if n > 0 else 0.0
        p, v, remembered = u + (p - u) * first, u + of_v * fast + of_p * first, end
