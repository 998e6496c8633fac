"""What an effect would explain of the residuals of a fit, if all went along straight lines."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from bench.diagnosis.fitting import robust
from bench.diagnosis.fitting.fitted import prior_precision, whiten
from bench.diagnosis.fitting.steps import longest_of

if TYPE_CHECKING:
    import numpy.typing as npt

    from bench.diagnosis.expected.problem import Problem
    from bench.diagnosis.fitting.fitted import Fit
    from bench.diagnosis.fitting.probe import Probe

    Floats = npt.NDArray[np.float64]

__all__ = ["BEYOND", "Explained", "explain", "followed"]

#: A probe says something about effects up to so many times its size.
BEYOND: Final = 2.0


class Explained(NamedTuple):
    """What is expected of a fit with an effect more."""

    base: Floats  #: (b,) change of the free numbers
    size: Floats  #: (k,) coordinates of the effect
    fall: float  #: of the loss


def explain(fit: Fit, columns: Floats, residual: Floats, one: Probe | None) -> Explained:
    """Return what is expected with an effect more.

    Parameters
    ----------
    columns
        (n, b) whitened changes by the free numbers.
    residual
        (n,) whitened.
    one
        The effect; None: none.
    """
    longest = longest_of(fit.slots, fit.x)
    low, high = (np.array([s.free.range[end] for s in fit.slots]) for end in (0, 1))
    lowest, highest = np.maximum(low - fit.x, -longest), np.minimum(high - fit.x, longest)
    precision, towards = prior_precision(fit.slots), fit.start - fit.x
    if one is not None:
        m = len(one.free)
        columns = np.concatenate([columns, one.change.mean(axis=0)], axis=1)
        signed = np.array([f.signed for f in one.free])
        lowest = np.append(lowest, np.where(signed, -BEYOND, 0.0))
        highest = np.append(highest, np.full(m, BEYOND))
        precision, towards = np.append(precision, np.zeros(m)), np.append(towards, np.zeros(m))
    c, fall = robust.solve(columns, residual, precision, towards, lowest, highest)
    k, at = len(longest), np.array(one.at if one is not None else ())
    return Explained(c[:k], c[k:] * at, fall)


def followed(
    problem: Problem, fit: Fit, value: Floats, *, holding: int | None = None
) -> tuple[float, Floats]:  # fmt: skip
    """Return the loss beside what is expected once the free numbers have followed, and how far (b,) they go.

    Parameters
    ----------
    value
        (n,) expected while they stay.
    holding
        Place of a number that stays.
    """
    points = problem.measured.points
    residual = whiten(fit.roots, problem.measured.value - value, points)
    columns = whiten(fit.roots, fit.jacobian.mean(axis=0), points)
    if holding is not None:
        columns[:, holding] = 0.0
    moved = explain(fit, columns, residual, None)
    return robust.loss(residual) - moved.fall, moved.base
