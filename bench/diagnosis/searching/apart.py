"""How far two models are apart, from several simulations of both that have no chance in common."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.searching.probing import reliable

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.diagnosis.expected.problem import Problem
    from bench.diagnosis.fitting.fitted import Fit
    from sim_backend.pixel.model import PixelModel

    Floats = npt.NDArray[np.float64]

__all__ = ["SURELY", "differences", "least_product", "product"]

#: Standard errors of a separation that are taken off: it is a lower limit.
SURELY: Final = 2.0
#: Seeds of simulations that are to differ are so far apart.
_OTHER_SEED: Final = 7919


def differences(
    problem: Problem, fit: Fit, base: Sequence[PixelModel], others: Sequence[Sequence[PixelModel]], seed: int,
    effort: float, times: int, *, plain: bool = False,
) -> list[Floats]:  # fmt: skip
    """Return how some models differ from a base model: (times, n) whitened for each, once for every simulation.

    Parameters
    ----------
    base, others
        A model for each point.
    effort
        Of one simulation.
    plain
        Keep what is mostly chance. Without it the difference has less chance, and is too small where the models do
        not share their random numbers, as with an effect that draws its own.
    """
    found: list[list[Floats]] = [[] for _ in others]
    for number in range(times):
        changes = problem.changes(base, others, seed + _OTHER_SEED * number, effort)
        for known, both in zip(found, changes, strict=True):
            halves = np.where(fit.known, both.halves, 0.0) if plain else reliable(problem, fit, both)
            known.append(fit.whiten(halves.mean(axis=0), problem.measured.points))
    return [np.stack(known) for known in found]


def product(some: Floats, others: Floats) -> float:
    """Return the product of two changes, (times, n) each, without that of the chance that one simulation has in both.

    What two sensors of one simulation have in common decided how much of it is believed: their product is too large,
    by far where little is simulated.
    """
    whole = float(some.sum(axis=0) @ others.sum(axis=0)) - float(np.sum(some * others))
    return whole / (len(some) * (len(some) - 1))


def least_product(some: Floats, others: Floats) -> float:
    """Return the least that the product of two changes is, given its chance (jackknife by simulation)."""
    without = [product(np.delete(some, i, axis=0), np.delete(others, i, axis=0)) for i in range(len(some))]
    chance = math.sqrt((len(some) - 1) * float(np.var(without)))
    return product(some, others) - SURELY * chance
