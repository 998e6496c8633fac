"""The noisy pixel behind a photoreceptor that is slower than the step.

The photoreceptor follows the light with a time constant of its own, rho times that of the low-pass behind it.
Measured from the level at which it will settle, in units of the noise and of the low-pass's time, the output obeys
``dy = -(y + C e^(-t/rho)) dt + sqrt(2) dW`` instead of the ``dy = -y dt + sqrt(2) dW`` of
:mod:`bench.analysis.first_passage`: the same start, the same barrier that does not move, and a push that dies away.
There is no universal table of it; the chance of no answer is worked out for the steps at hand, at a few barriers, and
interpolated between them on a scale of hazards.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.analysis.first_passage import survival_table

if TYPE_CHECKING:
    import numpy.typing as npt
    from scipy.interpolate import CubicSpline

    Floats = npt.NDArray[np.float64]

__all__ = ["SlowStep", "reached", "slow_step"]

_LONGEST: Final = 1.5  # step of time, units of tau; late ones grow with the time
_EARLY: Final = 12.0
_GROW: Final = 20.0
_MOVED: Final = 0.5  # by which the mean output moves in a step of time at the most, sigma
_BARRIERS: Final = np.linspace(-5.5, 5.5, 12)  # `LANES` of them, around the one that half of the pixels reach, sigma
_HALF: Final = 2.2  # by which that lies above the highest mean output, about
_FINE: Final = 4001
_SMALLEST: Final = 1e-6  # rho
_SMALL: Final = 1e-15  # a chance below this is taken as this


class SlowStep:
    """Chances of no answer to some steps; takes the place of a :class:`~bench.analysis.first_passage.SurvivalTable`.

    Parameters
    ----------
    step
        (m,) C: the steps, in units of the noise.
    lag
        (m,) rho: time constant of the photoreceptor at each, in units of tau.
    end
        Until when, in units of tau.
    """

    def __init__(self, step: Floats, lag: Floats, end: float) -> None:
        from bench.characterize.slow_step_kernels import survive

        self._step = step
        self._known = survival_table().barrier
        slow = np.maximum(lag, _SMALLEST)
        self.time = _times(end, float(slow.min()), float(step.max()))
        short = step * (reached(end, slow) - 1.0)
        nodes = short[:, None] + _HALF + _BARRIERS
        self._survival = _on_barriers(self._known, nodes, survive(self.time, nodes, step, slow))

    def from_steps(self, time: float, step: Floats) -> Floats:
        """Return (m, h) the survival at one time for some of the steps, on the barriers of the universal table."""
        found = self._survival[self._places(step)]
        at = float(np.clip(time, self.time[0], self.time[-1]))
        i = min(int(np.searchsorted(self.time, at, side="right")) - 1, self.time.size - 2)
        part = (at - self.time[i]) / (self.time[i + 1] - self.time[i])
        return np.asarray((1.0 - part) * found[:, :, i] + part * found[:, :, i + 1])

    def over_time(self, step: Floats) -> Floats:
        """Return (m, h, t) the survival at all times for some of the steps."""
        return np.asarray(self._survival[self._places(step)])

    def _places(self, step: Floats) -> npt.NDArray[np.intp]:
        return np.asarray(np.abs(self._step - step[:, None]).argmin(axis=1))


@lru_cache(maxsize=32)
def slow_step(step: tuple[float, ...], lag: tuple[float, ...], end: float) -> SlowStep:
    """Return the chances for some steps; those that were asked for lately are not worked out again."""
    return SlowStep(np.array(step), np.array(lag), end)


def reached(time: float | Floats, lag: Floats) -> Floats:
    """Return the part of a step that the mean output has done by a time: two low-passes, one behind the other."""
    apart = np.where(np.abs(lag - 1.0) < 1e-6, 1.0 + 1e-6, lag)
    return np.asarray(1.0 - (apart * np.exp(-time / apart) - np.exp(-time)) / (apart - 1.0))


def _times(end: float, lag: float, step: float) -> Floats:
    """Return times, close together while the output of the largest, fastest step moves."""
    fine = np.linspace(0.0, end, _FINE)
    moved = step * reached(fine, np.asarray(lag)) / _MOVED + np.minimum(fine, _EARLY) / _LONGEST
    moved += _GROW * np.log1p(np.maximum(fine - _EARLY, 0.0) / (_GROW * _LONGEST))
    # Chances are even early on, and hardly change before the output moves: the first step may be like the others.
    count = math.ceil(float(moved[-1]))
    return np.interp(np.linspace(0.0, float(moved[-1]), count + 1), moved, fine)


def _on_barriers(known: Floats, nodes: Floats, left: Floats) -> Floats:
    """Return (m, h, t) chances on the barriers `known`, from those (m, n, t) at the equally spaced nodes (m, n).

    What is interpolated is the logarithm of the cumulative hazard, ``ln(-ln S)``. Late, that is ``ln(rate t)``, in
    which the barrier goes about as its square however small S is.
    """
    from scipy.special import ndtr, ndtri

    hazard = np.log(-np.log(np.clip(left, _SMALL, 1.0 - _SMALL)))
    place = (known - nodes[:, :1]) / (nodes[0, 1] - nodes[0, 0])
    inside = np.clip(place, 0.0, nodes.shape[1] - 1.0)
    found = np.exp(-np.exp(_unit_splines(nodes.shape[1])(inside) @ hazard))
    # Beyond the nodes one sigma of the barrier is one of the score: all the more certain.
    beyond = (place - inside) * (nodes[0, 1] - nodes[0, 0])
    outside = beyond != 0.0
    score = ndtri(np.clip(found[outside], _SMALL, 1.0 - _SMALL))
    found[outside] = ndtr(score + beyond[outside][:, None])
    return np.asarray(found)


@lru_cache(maxsize=2)
def _unit_splines(number: int) -> CubicSpline:
    from scipy.interpolate import CubicSpline

    return CubicSpline(np.arange(number, dtype=np.float64), np.eye(number))
