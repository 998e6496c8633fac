"""When a noisy pixel answers a step of light: first passage of low-pass noise over the threshold.

Behind a first-order low-pass of time constant tau the output after a step c at 0 is ``V(t) = c (1 - e^(-t/tau)) +
n(t)``, n stationary Gaussian noise of rms sigma. Measured from the level at which it will settle, ``y = (V - c) /
sigma`` is an Ornstein-Uhlenbeck process of unit variance that starts at ``n(0) / sigma - C``, with C = c / sigma. The
pixel memorised its level r = N(0, sigma) around the baseline, so it answers when y first reaches the barrier ``H
= (theta + r) / sigma - C``, which does not move. Time in units of tau and levels in units of sigma, one table of the
chance S(t; H, C) that y has not reached H by t therefore holds for every pixel there is.

S is found from the backward Kolmogorov equation ``dS/dt = d2S/dy2 - y dS/dy``, S = 0 at y = H, S = 1 at t = 0 (L. M.
Ricciardi and S. Sato, "First-passage-time density and moments of the Ornstein-Uhlenbeck process", J. Appl. Prob. 25,
1988), averaged over the start.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt
    from scipy.interpolate import CubicSpline

    Floats = npt.NDArray[np.float64]

__all__ = ["ArmedPixel", "SurvivalTable", "grid_shift", "survival_table"]

_BARRIERS: Final = (-12.0, 9.0, 0.25)  # lowest, highest, distance; units of sigma
_STEPS: Final = (0.0, 20.0, 0.4)  # the same for C
_DEPTH: Final = 34.0  # how far below the barrier the equation is solved, sigma
_CELLS: Final = 320
_STRETCH: Final = 5.0  # the cells grow as sinh from the barrier down
_TR_BDF2: Final = 2.0 - math.sqrt(2.0)
_REACH: Final = 6.0  # where a normal density ends, sigma
_NOTHING: Final = 1e-300  # no chance at all; its logarithm is finite
_FINE: Final = 0.002  # distance of the nodes of the density of r, sigma
_COARSE: Final = 0.1  # the same where the density is only summed

#: -zeta(1/2) / sqrt(2 pi): a barrier that is looked at every dt acts as one this many steps of the noise higher
#: (D. Siegmund, Sequential Analysis, 1985; M. Broadie, P. Glasserman, S. Kou, Math. Finance 7, 1997).
_OVERSHOOT: Final = 0.5825971579


def grid_shift(step: float) -> float:
    """Return by how much a barrier looked at every `step` (units of tau) acts higher, in units of sigma."""
    return _OVERSHOOT * math.sqrt(2.0 * step)


@dataclass(frozen=True, slots=True)
class SurvivalTable:
    """The chance that the output has not reached a barrier; times in tau, levels in sigma."""

    time: Floats  #: (t,) ascending from 0
    barrier: Floats  #: (h,) H, equally spaced
    step: Floats  #: (c,) C, equally spaced from 0
    survival: Floats  #: (t, h, c)

    def at(self, time: float) -> Floats:
        """Return (h, c) the survival at one time.

        Between two times, and beyond the last, the hazard is taken as constant: late, when it matters, it is.
        """
        i = int(np.clip(np.searchsorted(self.time, time, side="right") - 1, 0, self.time.size - 2))
        part = (time - self.time[i]) / (self.time[i + 1] - self.time[i])
        before, after = np.maximum(self.survival[i : i + 2], _NOTHING)
        return np.asarray(before * np.exp(part * np.log(after / before)), np.float64)

    def from_steps(self, time: float, step: Floats) -> Floats:
        """Return (m, h) the survival at one time for each of m values of C.

        An output that starts deeper than the table reaches the table's deepest start ln(C / deepest) later.
        """
        deepest = float(self.step[-1])
        survival = self._between(step) @ self.at(time).T
        for j in np.flatnonzero(step > deepest):
            survival[j] = self.at(max(0.0, time - math.log(step[j] / deepest)))[:, -1]
        return np.clip(survival, 0.0, 1.0)

    def over_time(self, step: Floats) -> Floats:
        """Return (m, h, t) the survival at all times of the table for each of m values of C, deeper ones as above."""
        near = np.tensordot(self._between(step), self.survival, axes=(1, 2))
        for j in np.flatnonzero(step > self.step[-1]):
            earlier = self.time - math.log(step[j] / self.step[-1])
            near[j] = [self.at(t)[:, -1] if t > 0.0 else np.ones(self.barrier.size) for t in earlier]
        return np.clip(near.transpose(0, 2, 1), 0.0, 1.0)

    def _between(self, step: Floats) -> Floats:
        """Return (m, c) the weights of the table's C in a cubic interpolation to m values."""
        return np.asarray(_unit_splines()(np.minimum(step, self.step[-1])), np.float64)


@lru_cache(maxsize=1)
def _unit_splines() -> CubicSpline:
    from scipy.interpolate import CubicSpline

    step = _range(_STEPS)
    return CubicSpline(step, np.eye(step.size))


def _times() -> Floats:
    early, rise, late = np.geomspace(1e-4, 0.02, 12), np.arange(0.04, 3.0, 0.02), np.geomspace(3.0, 40.0, 45)
    return np.asarray(np.concatenate((np.zeros(1), early, rise, late)), np.float64)


def _range(bounds: tuple[float, float, float]) -> Floats:
    low, high, distance = bounds
    return np.linspace(low, high, round((high - low) / distance) + 1)


@lru_cache(maxsize=1)
def survival_table() -> SurvivalTable:
    """Return the table; it is made once in a process, in less than a second."""
    barrier, step, time = _range(_BARRIERS), _range(_STEPS), _times()
    depth = _DEPTH * np.sinh(_STRETCH * np.linspace(0.0, 1.0, _CELLS + 1)) / math.sinh(_STRETCH)
    start = _start_weights(depth, barrier, step)
    survival = np.ones((time.size, barrier.size, step.size))
    for k, state in enumerate(_solve(depth, barrier, time)):
        survival[k + 1] = np.matmul(start, state[:, :, None])[:, :, 0]
    survival = np.minimum.accumulate(np.clip(survival, 0.0, 1.0), axis=0)  # rounding only
    return SurvivalTable(time, barrier, step, survival)


def _start_weights(depth: Floats, barrier: Floats, step: Floats) -> Floats:
    """Return (h, c, cells) the law of the start, N(-C, 1) below the barrier, on the cells below the first."""
    width = np.gradient(depth)
    width[[0, -1]] /= 2.0
    y = barrier[:, None, None] - depth
    weight = np.exp(-0.5 * (y + step[None, :, None]) ** 2) * width
    return np.asarray((weight / weight.sum(axis=2, keepdims=True))[:, :, 1:])


def _operator(depth: Floats, barrier: Floats) -> tuple[Floats, Floats, Floats]:
    """Return (h, cells) the lower, middle and upper diagonal of d2/dz2 + (H - z) d/dz, z = H - y the depth.

    S is 0 at the barrier, which has no cell of its own, and flat at the lowest cell.
    """
    below = np.diff(depth)
    above = np.append(below[1:], below[-1])
    drift = barrier[:, None] - depth[1:]
    lower = (2.0 - drift * above) / (below * (below + above))
    upper = (2.0 + drift * below) / (above * (below + above))
    middle = -lower - upper
    middle[:, -1] += upper[:, -1]
    lower[:, 0] = 0.0
    upper[:, -1] = 0.0
    return lower, middle, upper


def _solve(depth: Floats, barrier: Floats, time: Floats) -> list[Floats]:
    """Return S at each time but the first, (h, cells) each; the method is TR-BDF2, all barriers side by side."""
    from scipy.linalg import solve_banded

    lower, middle, upper = _operator(depth, barrier)
    state, states = np.ones_like(middle), []
    banded = np.zeros((3, middle.size))
    for dt in np.diff(time):
        a = 0.5 * _TR_BDF2 * dt
        banded[0, 1:] = -a * upper.ravel()[:-1]
        banded[1] = 1.0 - a * middle.ravel()
        banded[2, :-1] = -a * lower.ravel()[1:]
        slope = middle * state
        slope[:, 1:] += lower[:, 1:] * state[:, :-1]
        slope[:, :-1] += upper[:, :-1] * state[:, 1:]
        half = solve_banded((1, 1), banded, (state + a * slope).ravel()).reshape(state.shape)
        right = (half - (1.0 - _TR_BDF2) ** 2 * state) / (_TR_BDF2 * (2.0 - _TR_BDF2))
        state = solve_banded((1, 1), banded, right.ravel()).reshape(state.shape)
        states.append(state)
    return states


@lru_cache(maxsize=8)
def _quiet(wait: float) -> tuple[Floats, Floats]:
    """Return barriers, close together, and the chance of no event over each while a pixel waits."""
    from scipy.interpolate import CubicSpline

    table = survival_table()
    fine = np.arange(table.barrier[0], table.barrier[-1], _FINE)
    return fine, np.clip(CubicSpline(table.barrier, table.at(wait)[:, 0])(fine), 0.0, 1.0)


class ArmedPixel:
    """A pixel that waited with its reference at r, and then sees a step.

    Not every r is still there at the step: a pixel whose r lies close to one of its thresholds has had a noise event
    while it waited. The density of r at the step is ``N(r; 0, 1) S_same(r) S_other(r)``, the last two the chance of
    no event over the wait over each threshold.

    Parameters
    ----------
    wait
        Time between the memorising of the reference and the step, units of tau.
    other
        (theta of the polarity that is not tested) / sigma.
    """

    def __init__(self, wait: float, other: float) -> None:
        self._barrier = survival_table().barrier
        self._fine, self._same = _quiet(wait)
        self._r = np.arange(-_REACH, _REACH + 0.5 * _FINE, _FINE)
        normal = np.exp(-0.5 * self._r**2) / math.sqrt(2.0 * math.pi)
        self._density = normal * np.interp(other - self._r, self._fine, self._same)

    def unanswered(self, threshold: Floats, step: Floats, survival: Floats) -> Floats:
        """Average a survival over r.

        Parameters
        ----------
        threshold
            (n,) theta / sigma; (n, m) where it differs from step to step.
        step
            (m,) C.
        survival
            (m, h) or (m, h, t) survival for each step, on the barriers of the table.

        Returns
        -------
        Floats
            (n, m) or (n, m, t) chance of no answer.
        """
        h = self._barrier
        threshold = threshold[:, None] if threshold.ndim == 1 else threshold
        r = h[None, None, :] + step[None, :, None] - threshold[:, :, None]
        weight = self._weight(r, h[None, :] + step[:, None]) * (h[1] - h[0])
        total = self._total(threshold)
        # References above the highest barrier of the table never answer. The rest of the sum then runs to +6 sigma.
        cut = threshold - step[None, :] > h[-1] - _REACH
        above = np.where(cut, total - weight.sum(axis=2), 0.0)
        mean = np.einsum("nmh,mh...->nm...", weight, survival)
        later = (...,) + (None,) * (survival.ndim - 2)
        return np.asarray((mean + above[later]) / total[later])

    def _weight(self, r: Floats, barrier: Floats) -> Floats:
        density = np.interp(r, self._r, self._density, left=0.0, right=0.0)
        return np.asarray(density * np.interp(barrier, self._fine, self._same))

    def _total(self, threshold: Floats) -> Floats:
        r = self._r[:: round(_COARSE / _FINE)]
        weight = self._weight(r, threshold[..., None] + r)
        return np.asarray(weight.sum(axis=-1) * (r[1] - r[0]))
