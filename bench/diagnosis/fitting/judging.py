"""How good a fitted model is: its error, on unseen points too, its numbers with intervals, where it fails most."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.expected.parameters import ALIGNMENT
from bench.diagnosis.fitting.drawn import drawn_variance, is_share, share_interval
from bench.diagnosis.fitting.fitted import live, off_known, prior_precision, solve
from bench.diagnosis.fitting.robust import loss
from bench.diagnosis.result import Error, Misfit, Step, Value

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.diagnosis.expected.problem import Problem
    from bench.diagnosis.fitting.fitted import Fit
    from bench.diagnosis.result import Candidate

    Floats = npt.NDArray[np.float64]

__all__ = [
    "NEARLY_ALL",
    "deviance",
    "deviance_beside",
    "deviance_per_dof",
    "error_of",
    "excess",
    "freedom",
    "heldout",
    "is_far_off",
    "leaves_more_than_chance",
    "loss_left",
    "more_than_chance",
    "share",
    "share_of_loss",
    "step_of",
    "values_of",
    "worst_of",
]

_FOLDS: Final = 5
_WORST: Final = 5
#: 90 % of a normal law lie within so many standard deviations.
_NINETY: Final = 1.6449
#: The variance of a sum of squares is this much more than that of normal numbers: few events, correlated views.
_HEAVY: Final = 1.25
#: A deviance that is larger by so many standard deviations than that of a true model asks for another look.
_IN_DOUBT: Final = 2.0
#: Where it is larger by more of them straight lines do not tell the best effect: with 770 residuals an error of 1.3.
_FAR_OFF: Final = 5.3
#: Share of what is too much in the deviance that is nearly all of it.
NEARLY_ALL: Final = 0.8


def deviance(problem: Problem, one: Fit, scale: float | None = None) -> float:
    """Return the sum of squares of the independent residuals; of a true model it is the number of them.

    By how much the clock is further off than it was known to be is one of them: a delay looks like it, but for that.
    Models that are compared with each other want the same scale: each knows its own only roughly.
    """
    r, clock = one.whiten(one.residual, problem.measured.points), _of_the_clock(one)
    return float(r @ r) * one.caution / (one.scale if scale is None else scale) + float(clock @ clock)


def deviance_beside(problem: Problem, one: Fit, other: Fit) -> float:
    """Return the deviance that a fit would have with as many independent residuals as another one.

    Of rare events a model that is simulated with few pixels expects nothing that could be judged.
    """
    return deviance_per_dof(problem, one) * freedom(other)


def freedom(one: Fit) -> int:
    """Return the number of independent residuals less that of the fitted numbers."""
    return max(sum(int(live(root).sum()) for root in one.roots) + _of_the_clock(one).size - len(one.slots), 1)


def _of_the_clock(one: Fit) -> Floats:
    """Return by how many standard deviations time offsets are from what they were known to be."""
    return np.asarray(off_known(one)[[slot.free.owner == ALIGNMENT for slot in one.slots]])


def loss_left(problem: Problem, one: Fit) -> float:
    """Return the loss of the independent residuals of a fit, in which large ones count by their size."""
    clock = _of_the_clock(one)
    return loss(one.whiten(one.residual, problem.measured.points)) + float(clock @ clock)


def deviance_per_dof(problem: Problem, one: Fit) -> float:
    """Return the error of a fit: its deviance by degree of freedom, about 1 for a true model."""
    return deviance(problem, one) / freedom(one)


def is_far_off(problem: Problem, one: Fit) -> bool:
    """Return whether straight lines do not tell what is missing."""
    return excess(problem, one) > _FAR_OFF


def excess(problem: Problem, one: Fit) -> float:
    """Return by how many standard deviations the deviance is larger than that of a true model."""
    return more_than_chance(deviance(problem, one), freedom(one))


def leaves_more_than_chance(problem: Problem, one: Fit) -> bool:
    """Return whether the deviance may be that of a fit which is not at its minimum, or lacks a detail."""
    return excess(problem, one) >= _IN_DOUBT


def more_than_chance(squares: float, n: int) -> float:
    """Return by how many standard deviations a sum of `n` squares is larger than that of a true model's residuals."""
    return (squares - n) / math.sqrt(2.0 * n * _HEAVY)


def share(problem: Problem, before: Fit, left: float) -> float:
    """Return the share of what was too much in the deviance that an effect took away.

    Parameters
    ----------
    left
        The deviance with the effect.
    """
    now, n = deviance(problem, before), freedom(before)
    return (now - left) / max(now - n, math.sqrt(2.0 * n))


def share_of_loss(problem: Problem, before: Fit, after: Fit) -> float:
    """Return the share of what was too much in the loss that an effect took away.

    The deviance may be that of a few statistics, of which hardly anything was to be expected: an effect that lets a
    little more be expected of them takes most of it away, and they are as wrong as before.
    """
    one, other, n = loss_left(problem, before), loss_left(problem, after), freedom(before)
    return (one - other) / max(one - n, math.sqrt(2.0 * n))


def step_of(
    problem: Problem, one: Fit, number: int = 0, added: str | None = None, candidates: Sequence[Candidate] = ()
) -> Step:
    """Return a fitted model as a step of a diagnosis, with what it may lack."""
    effects = dict.fromkeys([*(s.free.owner for s in one.slots), *(e.id for e in one.model.effects)])
    return Step(
        number,
        added,
        tuple(effects),
        error_of(problem, one),
        values_of(problem, one),
        tuple(candidates),
        worst_of(problem, one),
    )


def error_of(problem: Problem, one: Fit) -> Error:
    """Return the error of a fitted model."""
    responses = [i for i, label in enumerate(problem.measured.labels) if label.view == "response"]
    apart = problem.measured.ratio[responses] - one.ratio[responses]
    return Error(
        deviance_per_dof=deviance_per_dof(problem, one),
        response_rmse=float(np.sqrt(np.nanmean(apart**2))) if responses else math.nan,
        heldout_deviance_per_dof=heldout(problem, one),
    )


def heldout(problem: Problem, one: Fit) -> float:
    """Return the deviance per statistic on points that the fit did not see: folds of whole points.

    The numbers are fitted again to the other points, along the changes by coordinate that are known at the solution.
    Where these ask for another solution for all points together, simulations have shown that it is none: only what
    changes from all points to the others counts. The clock counts as in the deviance. It is not a number where there
    is but one point.
    """
    points = problem.measured.points
    jacobian = one.jacobian.mean(axis=0)
    parts = [
        (root @ one.residual[where] / math.sqrt(one.scale), root @ jacobian[where] / math.sqrt(one.scale),
         int(live(root).sum()))
        for root, where in zip(one.roots, points, strict=True)
    ]  # fmt: skip
    squares, count = 0.0, 0
    prior = prior_precision(one.slots)

    def step_to(some: Sequence[tuple[Floats, Floats, int]]) -> Floats:
        left, columns = (np.concatenate([p[k] for p in some]) for k in (0, 1))
        return solve(columns, left, prior, one.start - one.x)

    of_all = step_to(parts)
    for fold in range(min(_FOLDS, len(points))):
        seen = [p for i, p in enumerate(parts) if i % _FOLDS != fold]
        unseen = [p for i, p in enumerate(parts) if i % _FOLDS == fold]
        if not seen or not unseen:
            continue
        delta = step_to(seen) - of_all
        squares += sum(float(np.sum((r - j @ delta) ** 2)) for r, j, _ in unseen)
        count += sum(n for _, _, n in unseen)
    clock = _of_the_clock(one)
    return (squares + float(clock @ clock)) / (count + clock.size) if count else math.nan


def values_of(problem: Problem, one: Fit) -> dict[str, Value]:
    """Return the fitted numbers with 90 % intervals: those of sensors of this kind, of which this one was drawn."""
    pixels = max(p.roi.pixels for p in problem.points)
    drawn = drawn_variance(one.slots, one.x, pixels)
    simulated = 0.0 if one.frozen is None else one.frozen
    sd = np.sqrt(np.diag(one.scatter(problem.measured.points)) + np.maximum(drawn - simulated, 0.0))
    found = {}
    for i, (slot, x, fitted_sd) in enumerate(zip(one.slots, one.x, sd, strict=True)):
        known = problem.known.get((slot.free.owner, slot.free.name))
        s = float(fitted_sd) if known is None else known.sd
        of_share = is_share(slot.free) and math.isfinite(s)
        around = share_interval(x, s, pixels, _NINETY) if of_share else (x - _NINETY * s, x + _NINETY * s)
        outer = np.clip(one.between.get(i, around), *slot.free.range)
        ends = sorted(slot.free.value(float(end)) for end in outer)
        found[slot.key(problem.settings)] = Value(slot.free.value(x), ends[0], ends[1], slot.free.unit)
    return found


def worst_of(problem: Problem, one: Fit) -> tuple[Misfit, ...]:
    """Return the statistics that are furthest off."""
    z = one.z
    found = []
    for i in np.argsort(-np.abs(z), kind="stable")[:_WORST]:
        label = problem.measured.labels[i]
        view = label.view if label.part == "both" else f"{label.view}_{label.part}"
        found.append(
            Misfit(
                view, label.point, label.baseline_lux, label.log_contrast,
                float(problem.measured.ratio[i]), float(one.ratio[i]), float(z[i]),
            )
        )  # fmt: skip
    return tuple(found)
