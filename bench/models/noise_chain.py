"""The lasting rate of background events of a pixel with one pole, from the transition matrix on the grid of samples.

The output behind the low-pass, in units of its rms, is ``x <- rho x + s z`` with ``s = sqrt(1 - rho^2)``. The pixel
memorised r; it is compared at each sample, leaves (r - b, r + a) at some v, is blind for D samples, and memorises
``r' = rho^D v + sqrt(1 - rho^(2 D)) z``. So the memorised levels are a Markov chain, and the rate follows from its
stationary law mu: ``1 / (D + sum mu(r) T(r))`` per sample, T(r) the mean number of samples until the exit. Nothing is
drawn, and nothing is assumed of the dead time: bursts, in which one event brings the next, are in it.

Exits are solved on Gauss-Legendre nodes x_j of the interval: the mean number of visits g of each node obeys
``g = p + g P`` with the transition matrix P and the first step p from r; then ``T = 1 + sum g`` and the density of
the exit at v is ``phi(v; r) + sum_j g_j phi(v; x_j)``, phi the density of one step.
"""

from __future__ import annotations

import functools
import math
from functools import lru_cache
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]

__all__ = ["lasting_rate", "memory_chain", "nodes_needed", "settling_intervals"]

#: Mean distance of two nodes, in rms of one step; Gauss-Legendre nodes are at most pi/2 times as far apart.
_NODE_STEPS: Final = 0.5
#: Distance of the memorised levels, in units of the rms. Time to the exit is smooth over less than a third of it.
_LEVEL_STEP: Final = 0.1
#: How far beyond the farther threshold levels are followed: they are there once in 10^8 events or less.
_BEYOND: Final = 2.5
#: Nodes beyond each barrier for the place of an exit, and how far they reach, in rms of one step.
_EXIT_NODES: Final = 24
_EXIT_REACH: Final = 7.0
#: Above this rms the law of a memorised level is summed over the levels, below it with Gauss-Hermite nodes.
_WIDE: Final = 0.15
_HERMITE_NODES: Final = 15
_SPLINE_DEGREE: Final = 5
_MOST_INTERVALS: Final = 1024.0

_legendre = lru_cache(np.polynomial.legendre.leggauss)


def nodes_needed(on: float, off: float, rho: float) -> int:
    """Return the number of nodes of the transition matrix: what it costs grows with its third power."""
    return max(16, math.ceil((on + off) / (_NODE_STEPS * math.sqrt(1.0 - rho * rho))))


def lasting_rate(on: float, off: float, rho: float, dead: int) -> float:
    """Return the rate of events per sample, ON and OFF together, long after the start.

    Parameters
    ----------
    on, off
        Thresholds over the rms of the noise, above 0.
    rho
        What the low-pass keeps of its output in one sample, 0 to below 1.
    dead
        Samples for which the pixel is blind after an event.
    """
    _, samples, change = memory_chain(on, off, rho, dead)
    return _rate(samples, change, dead)


def settling_intervals(on: float, off: float, rho: float, dead: int, excess: float) -> float:
    """Return after how many mean intervals the rate is within the fraction `excess` of the lasting one.

    A recording begins with references of the noise at rest. Those far off go first, and the rate falls to the lasting
    one as fast as levels are exchanged, here as a Markov process in continuous time. Found to a factor of two.
    """
    from scipy.linalg import expm

    level, samples, change = memory_chain(on, off, rho, dead)
    rate = _rate(samples, change, dead)
    leaving = 1.0 / (samples + dead)
    later = expm((change - np.eye(len(level))) * (leaving / rate)[:, None])
    law = np.exp(-0.5 * level**2)
    law /= law.sum()
    intervals = 1.0
    while law @ later @ leaving > (1.0 + excess) * rate and intervals < _MOST_INTERVALS:
        later = later @ later
        intervals *= 2.0
    return intervals


def _rate(samples: Floats, change: Floats, dead: int) -> float:
    # mu (K - 1) = 0, sum mu = 1: one equation too many, and they agree.
    system = np.vstack([(change - np.eye(len(samples))).T, np.ones(len(samples))])
    law = np.linalg.lstsq(system, np.append(np.zeros(len(samples)), 1.0), rcond=None)[0]
    return float(1.0 / (dead + law @ samples))


def memory_chain(on: float, off: float, rho: float, dead: int) -> tuple[Floats, Floats, Floats]:
    """Return memorised levels r (n,), mean samples T until the exit (n,), and K (n, n): ``E[f(r') | r] = K f``.

    Levels are in units of the rms of the noise; the parameters are those of :func:`lasting_rate`.
    """
    most = max(on, off) + _BEYOND
    level = np.linspace(-most, most, 2 * math.ceil(most / _LEVEL_STEP) + 1)
    kept = rho**dead
    memorise = _memorise(level, kept, math.sqrt(1.0 - kept * kept))
    samples, change = np.empty(len(level)), np.empty((len(level), len(level)))
    for i, r in enumerate(level):
        samples[i], place, chance = _exit(r - off, r + on, float(r), rho)
        change[i] = chance @ memorise(place)
    return level, samples, change


def _memorise(level: Floats, kept: float, fresh: float) -> Callable[[Floats], Floats]:
    """Return M: ``M(v) f = E[f(r')]``, (m, n), with ``r' = kept v + fresh z`` and f known at the n levels."""
    if fresh > _WIDE:  # The levels are close enough for the law of r' to be summed over them.
        weight = functools.partial(_normal_on, level, fresh)
        return lambda place: weight(kept * place)
    from scipy.interpolate import make_interp_spline

    unit = make_interp_spline(level, np.eye(len(level)), k=_SPLINE_DEGREE)
    z, chance = np.polynomial.hermite_e.hermegauss(_HERMITE_NODES)

    def between(place: Floats) -> Floats:
        memorised = np.clip(kept * place[:, None] + fresh * z, level[0], level[-1])
        return np.asarray(np.tensordot(unit(memorised), chance / chance.sum(), axes=(1, 0)))

    return between


def _normal_on(level: Floats, rms: float, mean: Floats) -> Floats:
    """Return the weight of each level in a normal law around each mean, (m, n)."""
    weight = np.exp(-0.5 * ((level - np.clip(mean, level[0], level[-1])[:, None]) / rms) ** 2)
    return np.asarray(weight / weight.sum(axis=1, keepdims=True))


def _exit(low: float, high: float, start: float, rho: float) -> tuple[float, Floats, Floats]:
    """Return the mean number of samples until x leaves (low, high), where it then is, and with what probability."""
    s = math.sqrt(1.0 - rho * rho)
    unit, weight = _legendre(nodes_needed(high - start, start - low, rho))
    x = 0.5 * (high + low) + 0.5 * (high - low) * unit
    weight = 0.5 * (high - low) * weight

    def step(origin: Floats, to: Floats) -> Floats:
        """Return the density of one step, (to, origin)."""
        return np.asarray(np.exp(-0.5 * ((to[:, None] - rho * origin) / s) ** 2) / (s * math.sqrt(2.0 * math.pi)))

    first = weight * step(np.array([start]), x)[:, 0]
    visits = np.linalg.solve(np.eye(len(x)) - weight[:, None] * step(x, x), first)
    t, t_weight = _legendre(_EXIT_NODES)
    over = 0.5 * _EXIT_REACH * s * (t + 1.0)
    place = np.concatenate([low - over, high + over])
    density = step(np.append(x, start), place) @ np.append(visits, 1.0)
    chance = np.tile(0.5 * _EXIT_REACH * s * t_weight, 2) * density
    return 1.0 + float(visits.sum()), place, chance / chance.sum()
