"""A fit of what takes long to simulate, done again with as many pixels as that of a base pixel.

Of a ripple or a shot noise little is simulated on the way. In a narrow valley, where thresholds, noise and corner go
up together, that is too little: what chance does to a look is more than what a step along the valley gains.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from bench.diagnosis.fitting import robust
from bench.diagnosis.fitting.approach import Approach
from bench.diagnosis.fitting.cloud import Cloud
from bench.diagnosis.fitting.fit import finish
from bench.diagnosis.fitting.judging import deviance_per_dof, leaves_more_than_chance
from bench.diagnosis.fitting.looks import loss_of_fit

if TYPE_CHECKING:
    from bench.diagnosis.expected.problem import Problem
    from bench.diagnosis.fitting.fitted import Fit

__all__ = ["EXPLAINS", "NEARBY", "asks_for_more", "fitted_on", "from_here", "is_costly", "sharpened"]

#: A deviance that is larger than that of a true model by more than this factor is not that of too little effort.
NEARBY: Final = 2.0
#: A fit explains a run once its error is that of a true model, but for a tenth: a larger one may be that of too
#: little effort, be it within chance or not.
EXPLAINS: Final = 1.1
#: Models that take no longer than this, beside a base pixel, had as much of it already.
_CHEAP: Final = 1.5
#: Chance in the changes by which a fit goes to its minimum may keep it from there: so much more effort leads on.
_EFFORT: Final = 4.0


def asks_for_more(problem: Problem, found: Fit) -> bool:
    """Return whether little was simulated of a fit, and more is left than chance or an explanation leaves."""
    error = deviance_per_dof(problem, found)
    if error > NEARBY or not (error > EXPLAINS or leaves_more_than_chance(problem, found)):
        return False
    return is_costly(problem, found)


def is_costly(problem: Problem, found: Fit) -> bool:
    """Return whether little was simulated of a fit, since its model takes long."""
    return problem.cost(found.models(problem)) > _CHEAP


def sharpened(problem: Problem, found: Fit, seed: int) -> Fit:
    """Return the same model fitted on from where it is, with as many pixels as a base pixel."""
    return finish(problem, from_here(problem, found, seed), precise=True)


def fitted_on(problem: Problem, found: Fit, seed: int) -> Fit:
    """Return the same model fitted on from where it is, with four times the effort."""
    return finish(problem, from_here(problem, found, seed), effort=_EFFORT)


def from_here(problem: Problem, found: Fit, seed: int) -> Approach:
    """Return where a fit is as a place to go on from."""
    first, second = (found.whiten(half, problem.measured.points) for half in found.jacobian)
    return Approach(
        model=found.model, slots=found.slots, at=found.x, start=found.start,
        loss=loss_of_fit(problem, found), seed=seed,
        information=robust.shared(first, second), reach=0.0, cloud=Cloud(),
    )  # fmt: skip
