"""The way down to the numbers of a sensor under which its family of S-curves is least surprising.

Derivatives are dear. They are brought forward from step to step by what the step itself showed (C. G. Broyden, "A
class of methods for solving nonlinear simultaneous equations", Math. Comp. 19, 1965), and worked out again where a
step did not keep its promise, and before the fit is called done.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from bench.characterize.family_model import Family
    from bench.characterize.family_problem import Problem

    Floats = npt.NDArray[np.float64]

__all__ = ["held_at", "minimum", "scale_of", "slopes_of"]

_MOST_STEPS: Final = 40
_REACH, _FARTHEST = 4.0, 12.0  # of a step of the fit, in scales: of the first one, and at the most
_LITTLE: Final = 0.01  # of chi-square: a fit that promises no more is there
_KEPT: Final = 0.5  # of the promised fall: derivatives that did no better are worked out again
#: Steps, and what is little, where one number is held: nothing but chi-square is wanted.
_HELD_STEPS, _LITTLE_HELD = 8, 0.03
_STEP: Final = 0.1  # of the scale of a number, for derivatives
#: Of the low-pass's time constant: as much as a photoreceptor may be too fast by chance, at the dimmest level.
_LITTLE_LAG: Final = 0.15
#: Nothing is answered before the light has changed, but for how well its edges are known, s.
_EARLY_S: Final = 1e-4
_TINY: Final = 1e-12


def minimum(problem: Problem, x: Floats, scale: Floats) -> Floats:
    """Return the numbers with the least chi-square; each mean then counts as these numbers let expect."""
    moving = np.ones(x.size, np.bool_)
    slopes, worked_out, reach = slopes_of(problem, x, scale), True, _REACH
    for _ in range(_MOST_STEPS):
        to, promised = _next(problem, x, reach * scale, slopes, moving)
        at, fell = _downhill(problem, x, to) if promised > _LITTLE else (x, 0.0)
        if worked_out and fell < _LITTLE:
            break
        worked_out = fell < _KEPT * promised
        reach = max(0.5 * reach, 1.0) if worked_out else min(2.0 * reach, _FARTHEST)
        slopes = slopes_of(problem, at, scale) if worked_out else _learned(problem, slopes, (x, at), scale)
        x = at
        problem.weigh(problem.family(x))
    return x


def held_at(problem: Problem, x: Floats, place: int, slopes: Floats, scale: Floats) -> tuple[Floats, float]:
    """Return the numbers with the least chi-square where one of them stays as it is, and that chi-square.

    Parameters
    ----------
    x
        (f,) where to begin.
    place
        Of the number that stays.
    slopes
        (s + k, f) derivatives of what is expected, somewhere near.
    """
    moving = np.arange(x.size) != place
    for _ in range(_HELD_STEPS):
        to, promised = _next(problem, x, _REACH * scale, slopes, moving)
        at, fell = _downhill(problem, x, to) if promised > _LITTLE_HELD else (x, 0.0)
        if fell < _LITTLE_HELD:
            break
        slopes = _learned(problem, slopes, (x, at), scale)
        x = at
    residual = problem.residuals(x)
    return x, float(residual @ residual)


def _next(
    problem: Problem, x: Floats, reach: Floats, slopes: Floats, moving: npt.NDArray[np.bool_]
) -> tuple[Floats, float]:  # fmt: skip
    """Return where a straight-line model has its least squares, within bounds and reach, and by how much less."""
    from scipy.optimize import lsq_linear

    low, high = _bounds(problem)
    residual = problem.residuals(x)
    down, up = np.maximum(low - x, -reach) / reach, np.minimum(high - x, reach) / reach
    columns = (problem.jacobian(slopes) * reach)[:, moving]
    step = lsq_linear(columns, -residual, ((down - _TINY)[moving], (up + _TINY)[moving]))
    to = x.copy()
    to[moving] += step.x * reach[moving]
    return to, float(residual @ residual) - 2.0 * float(step.cost)


def _downhill(problem: Problem, x: Floats, to: Floats) -> tuple[Floats, float]:
    """Return the end of a step, shortened until it goes downhill, and by how much chi-square fell."""
    residual = problem.residuals(x)
    before = float(residual @ residual)
    for part in (1.0, 0.4, 0.15, 0.05):
        at = x + part * (to - x)
        there = problem.residuals(at)
        if float(there @ there) < before:
            return at, before - float(there @ there)
    return x, 0.0


def _bounds(problem: Problem) -> tuple[Floats, Floats]:
    dimmest = min(level.key.baseline_lux for level in problem.levels)
    bounds = {
        "theta": (0.1 * problem.start.theta, 10.0),
        "noise_rms": (1e-3, 2.0),
        "delay_s": (-_EARLY_S, math.inf),
        "dark_lux": (-0.5 * dimmest, math.inf),
        "dark_spread2": (-1.0, 2.0),
        "slow_s_lux": (-_LITTLE_LAG * math.exp(problem.start.ln_tau) * (dimmest + problem.start.dark_lux), math.inf),
        "filter_od": (-1.0, 1.0),
    }
    low, high = zip(*(bounds.get(name, (-math.inf, math.inf)) for name in problem.free), strict=True)
    return np.array(low), np.array(high)


def scale_of(name: str, start: Family) -> float:
    """Return a step of a number that changes curves by a little."""
    return {
        "theta": 0.2 * start.noise_rms,
        "noise_rms": 0.1 * start.noise_rms,
        "mismatch2": (0.3 * start.noise_rms) ** 2,
        "ln_tau": 0.1,
        "delay_s": 0.1 * math.exp(start.ln_tau),
        "dark_lux": 0.1 * max(start.dark_lux, 0.02),
        "dark_spread2": 0.01,
        "shot_lux": 0.2 * start.noise_rms**2 * 0.2,
        "slow_s_lux": max(0.2 * start.slow_s_lux, 0.1 * math.exp(start.ln_tau)),
        "filter_od": 0.02,
    }[name]


def slopes_of(problem: Problem, x: Floats, scale: Floats) -> Floats:
    """Return (s + k, f) the derivatives of what is expected."""
    here = problem.means(x)
    steps = _STEP * scale
    return np.stack(
        [(problem.means(x + np.eye(x.size)[i] * steps[i]) - here) / steps[i] for i in range(x.size)], axis=1
    )


def _learned(problem: Problem, slopes: Floats, step: tuple[Floats, Floats], scale: Floats) -> Floats:
    """Return derivatives that would have foretold a step from one place to the next: Broyden's, by the scales."""
    before, after = step
    moved = (after - before) / scale
    missed = problem.means(after) - problem.means(before) - slopes @ (after - before)
    return np.asarray(slopes + np.outer(missed / float(moved @ moved), moved / scale))
