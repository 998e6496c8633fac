"""The first passage of noise over barriers that a slow step approaches, compiled.

Several barriers are worked out side by side: the solution of a tridiagonal system is a chain of divisions, and the
processor does those of a few chains at once.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from drivers.jit import njit

if TYPE_CHECKING:
    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]

__all__ = ["survive"]

_CELLS = 90
_STRETCH = 4.5  # cells grow as sinh from the barrier down
_BELOW = 7.0  # sigma below the start, where nothing is any more
_TR_BDF2 = 2.0 - math.sqrt(2.0)


@njit(cache=True, nogil=True)
def _grid(start: Floats, depth: Floats, mass: Floats) -> None:
    """Write the cells (n, k) below each barrier, and the law of the start, N(start, 1) in depth, with sum 1."""
    n = depth.shape[0]
    for k in range(start.size):
        deepest = max(start[k], 0.0) + _BELOW
        for i in range(n):
            depth[i, k] = deepest * math.sinh(_STRETCH * (i + 1) / n) / math.sinh(_STRETCH)
        total = 0.0
        for i in range(n):
            width = 0.5 * (depth[min(i + 1, n - 1), k] - (depth[i - 1, k] if i else 0.0))
            mass[i, k] = math.exp(-0.5 * (depth[i, k] - start[k]) ** 2) * width
            total += mass[i, k]
        for i in range(n):
            mass[i, k] = mass[i, k] / total if total > 0.0 else 0.0


@njit(cache=True, nogil=True)
def _geometry(depth: Floats, lower: Floats, upper: Floats, slope_low: Floats, slope_up: Floats) -> None:
    """Write the rates from each cell to its neighbours without a drift, and by how much a drift changes them."""
    n = depth.shape[0]
    for i in range(n):
        for k in range(depth.shape[1]):
            below = depth[i, k] - (depth[i - 1, k] if i else 0.0)
            above = depth[i + 1, k] - depth[i, k] if i < n - 1 else below
            lower[i, k], slope_low[i, k] = 2.0 / (below * (below + above)), -above / (below * (below + above))
            upper[i, k], slope_up[i, k] = 2.0 / (above * (below + above)), below / (above * (below + above))
    upper[n - 1] = slope_up[n - 1] = 0.0  # nothing is lost at the bottom


@njit(cache=True, nogil=True)
def _advance(dt: float, low: Floats, up: Floats, mass: Floats, before: Floats, work: Floats, pivot: Floats) -> None:
    """Take one step of TR-BDF2 of dm/dt = L^T m; L moves mass down by the rates `up` and to the barrier by `low`."""
    n, lanes = mass.shape
    a = 0.5 * _TR_BDF2 * dt
    before[:] = mass
    for i in range(n):
        for k in range(lanes):
            flow = -(low[i, k] + up[i, k]) * before[i, k]
            if i:
                flow += up[i - 1, k] * before[i - 1, k]
            if i < n - 1:
                flow += low[i + 1, k] * before[i + 1, k]
            mass[i, k] += a * flow
    for k in range(lanes):
        pivot[0, k] = 1.0 / (1.0 + a * (low[0, k] + up[0, k]))
    for i in range(1, n):
        for k in range(lanes):
            work[i - 1, k] = -a * low[i, k] * pivot[i - 1, k]
            pivot[i, k] = 1.0 / (1.0 + a * (low[i, k] + up[i, k]) + a * up[i - 1, k] * work[i - 1, k])
    for stage in range(2):
        if stage:
            for i in range(n):
                for k in range(lanes):
                    mass[i, k] = (mass[i, k] - (1.0 - _TR_BDF2) ** 2 * before[i, k]) / (_TR_BDF2 * (2.0 - _TR_BDF2))
        for k in range(lanes):
            mass[0, k] *= pivot[0, k]
        for i in range(1, n):
            for k in range(lanes):
                mass[i, k] = (mass[i, k] + a * up[i - 1, k] * mass[i - 1, k]) * pivot[i, k]
        for i in range(n - 2, -1, -1):
            for k in range(lanes):
                mass[i, k] -= work[i, k] * mass[i + 1, k]


@njit(cache=True, nogil=True)
def survive(time: Floats, barrier: Floats, step: Floats, lag: Floats) -> Floats:
    """Return (m, k, t) the chance that the output has not reached each barrier by each time.

    Measured from the level at which it settles, the output of the low-pass obeys ``dy = -(y + C e^(-t/rho)) dt +
    sqrt(2) dW`` and starts at N(-C, 1). Forward equation for the depth below the barrier; TR-BDF2, with the push of
    the middle of each step.

    Parameters
    ----------
    time
        (t,) ascending from 0, units of tau.
    barrier
        (m, k) H, units of sigma.
    step, lag
        (m,) C, units of sigma, and rho, units of tau.
    """
    lanes = barrier.shape[1]
    shape = (_CELLS, lanes)
    left = np.ones((barrier.shape[0], lanes, time.size))
    depth, mass, before, work, pivot = (
        np.empty(shape),
        np.empty(shape),
        np.empty(shape),
        np.empty(shape),
        np.empty(shape),
    )
    lower, upper, slope_low, slope_up = np.empty(shape), np.empty(shape), np.empty(shape), np.empty(shape)
    low, up = np.empty(shape), np.empty(shape)
    for m in range(barrier.shape[0]):
        _grid(barrier[m] + step[m], depth, mass)
        _geometry(depth, lower, upper, slope_low, slope_up)
        for j in range(1, time.size):
            push = step[m] * math.exp(-0.5 * (time[j] + time[j - 1]) / lag[m])
            for i in range(_CELLS):
                for k in range(lanes):
                    drift = barrier[m, k] - depth[i, k] + push
                    low[i, k] = lower[i, k] + drift * slope_low[i, k]
                    up[i, k] = upper[i, k] + drift * slope_up[i, k]
            _advance(time[j] - time[j - 1], low, up, mass, before, work, pivot)
            for k in range(lanes):
                rest = 0.0
                for i in range(_CELLS):
                    rest += mass[i, k]
                left[m, k, j] = min(max(rest, 0.0), left[m, k, j - 1])
    return left
