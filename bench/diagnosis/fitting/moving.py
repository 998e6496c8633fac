"""A fit at other coordinates than those where it ended."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

from bench.diagnosis.fitting.looks import shifted

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from bench.diagnosis.expected.problem import Problem
    from bench.diagnosis.fitting.fitted import Fit

    Floats = npt.NDArray[np.float64]

__all__ = ["FINE", "moved"]

#: Effort of one look at a solution.
FINE: Final = 3.0


def moved(problem: Problem, found: Fit, x: Floats, seed: int, effort: float = 1.0) -> Fit:
    """Return a fit at other coordinates, or beside other phases: what it expects is simulated there, once.

    How that changes by coordinate, and how residuals scatter, is what it was.

    Parameters
    ----------
    effort
        So many times that of a look of a fit.
    """
    models = problem.models(found.model, found.slots, x)
    here = shifted(problem, problem.expect(problem.simulate([models], seed, FINE * effort)[0]), found.slots, x)
    return replace(
        found,
        model=problem.of_settings(found.model, found.slots, x)[0],
        x=x,
        value=here.value,
        ratio=here.ratio,
        roots=here.roots,
        deviation=here.deviation,
        residual=problem.measured.value - here.value,
        common=(1.0 + problem.alike(models) / here.recordings) / here.more,
    )
