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

__all__ = ["LANES", "survive"]

LANES = 12  # barriers side by side; a constant, so that the compiler makes one operation of several lanes
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


@njit(cache=True, nogil=True, error_model="numpy")
def _advance(a: float, low: Floats, up: Floats, mass: Floats, before: Floats, work: Floats, pivot: Floats) -> None:
    """Take one step of TR-BDF2 of dm/dt = L^T m; L moves mass down by the rates `up` and to the barrier by `low`.

    All arrays are flat, (n * LANES,); `a` is half of the step times 2 - sqrt(2).
    """
    size = _CELLS * LANES
    for q in range(size):
        before[q] = mass[q]
        pivot[q] = 1.0 + a * (low[q] + up[q])
    for q in range(size):
        mass[q] -= a * (low[q] + up[q]) * before[q]
    for q in range(size - LANES):
        mass[q + LANES] += a * up[q] * before[q]
    for q in range(size - LANES):
        mass[q] += a * low[q + LANES] * before[q + LANES]
    for k in range(LANES):
        pivot[k] = 1.0 / pivot[k]
    for i in range(1, _CELLS):
        row, above = i * LANES, (i - 1) * LANES
        for k in range(LANES):
            work[above + k] = -a * low[row + k] * pivot[above + k]
            pivot[row + k] = 1.0 / (pivot[row + k] + a * up[above + k] * work[above + k])
    _solve(a, up, mass, work, pivot)
    for q in range(size):
        mass[q] = (mass[q] - (1.0 - _TR_BDF2) ** 2 * before[q]) / (_TR_BDF2 * (2.0 - _TR_BDF2))
    _solve(a, up, mass, work, pivot)


@njit(cache=True, nogil=True, error_model="numpy")
def _solve(a: float, up: Floats, mass: Floats, work: Floats, pivot: Floats) -> None:
    """Solve the tridiagonal system of a stage, whose elimination is in `work` and `pivot`."""
    for k in range(LANES):
        mass[k] *= pivot[k]
    for i in range(1, _CELLS):
        row, above = i * LANES, (i - 1) * LANES
        for k in range(LANES):
            mass[row + k] = (mass[row + k] + a * up[above + k] * mass[above + k]) * pivot[row + k]
    for i in range(_CELLS - 2, -1, -1):
        row, below = i * LANES, (i + 1) * LANES
        for k in range(LANES):
            mass[row + k] -= work[row + k] * mass[below + k]


@njit(cache=True, nogil=True)
def survive(time: Floats, barrier: Floats, step: Floats, lag: Floats) -> Floats:
    """Return (m, LANES, t) the chance that the output has not reached each barrier by each time.

    Measured from the level at which it settles, the output of the low-pass obeys ``dy = -(y + C e^(-t/rho)) dt +
    sqrt(2) dW`` and starts at N(-C, 1). Forward equation for the depth below the barrier; TR-BDF2, with the push of
    the middle of each step.

    Parameters
    ----------
    time
        (t,) ascending from 0, units of tau.
    barrier
        (m, LANES) H, units of sigma.
    step, lag
        (m,) C, units of sigma, and rho, units of tau.
    """
    size = _CELLS * LANES
    left = np.ones((barrier.shape[0], LANES, time.size))
    depth, mass = np.empty((_CELLS, LANES)), np.empty((_CELLS, LANES))
    lower, upper = np.empty((_CELLS, LANES)), np.empty((_CELLS, LANES))
    slope_low, slope_up = np.empty((_CELLS, LANES)), np.empty((_CELLS, LANES))
    low, up, before, work, pivot = (np.empty(size), np.empty(size), np.empty(size), np.empty(size), np.empty(size))
    for m in range(barrier.shape[0]):
        _grid(barrier[m] + step[m], depth, mass)
        _geometry(depth, lower, upper, slope_low, slope_up)
        away, here = (barrier[m] - depth).reshape(size), mass.reshape(size)
        for j in range(1, time.size):
            push = step[m] * math.exp(-0.5 * (time[j] + time[j - 1]) / lag[m])
            _rates(away, push, lower.reshape(size), slope_low.reshape(size), low)
            _rates(away, push, upper.reshape(size), slope_up.reshape(size), up)
            _advance(0.5 * _TR_BDF2 * (time[j] - time[j - 1]), low, up, here, before, work, pivot)
            for k in range(LANES):
                rest = 0.0
                for i in range(_CELLS):
                    rest += here[i * LANES + k]
                left[m, k, j] = min(max(rest, 0.0), left[m, k, j - 1])
    return left


@njit(cache=True, nogil=True)
def _rates(away: Floats, push: float, still: Floats, slope: Floats, rate: Floats) -> None:
    """Write the rates of all cells with the drift that they have now."""
    for q in range(rate.size):
        rate[q] = still[q] + (away[q] + push) * slope[q]
