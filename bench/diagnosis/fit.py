"""Fitting the free numbers of a model to a run: Gauss-Newton steps on simulated expectations.

Every expectation is simulated, so any effect can be fitted, a user's own too. The same random numbers are used for
all parameters of one step. What is simulated is uncertain: near the minimum it is simulated with more effort, and
what a step has changed in truth corrects the changes by coordinate. These come from two sensors, so that products of
one sensor's changes with the other's have no chance in them: squares would count it as information.
"""

from __future__ import annotations

import logging
import math
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.approach import approach, best_of
from bench.diagnosis.catalogue import cost_of
from bench.diagnosis.chance import frozen_of, pooled, scale_of
from bench.diagnosis.fitted import Fit, prior_precision
from bench.diagnosis.looks import loss_of, shifted
from bench.diagnosis.parameters import ALIGNMENT
from bench.diagnosis.slopes import sample_of, samples_around, slopes
from bench.diagnosis.steps import inside, longest_of, shown, step_from

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.diagnosis.approach import Approach
    from bench.diagnosis.problem import Problem, Slot
    from bench.diagnosis.residuals import Expectation
    from sim_backend.pixel.model import PixelModel

    Floats = npt.NDArray[np.float64]

__all__ = ["finish", "fit"]

_LOG = logging.getLogger(__name__)

#: Relative error that what is expected may have at the start of a fit.
_ANYWHERE: Final = 0.3
#: Effort of one expectation at the solution, and how often it is looked for there. A model that takes longer than the
#: base pixel gets more effort, by the root of its cost, unless it is far off: what few pixels let expect tells little
#: apart.
_FINE: Final = 3.0
_POLISHINGS: Final = 6
#: A fit ends when a step would lower the loss by less than this.
_SMALL: Final = 1.0
#: After a step that makes the loss larger the next is shorter.
_SHORTER: Final = 0.3
#: Effort of one end of a difference, near the minimum and where the model is far off. They are so far apart that all
#: statistics together move by so many standard errors, to either side, if that is no more than a share of the longest
#: step: chance is small beside that, and lines are straight. With an effort of 0.4 steps to the minimum were so much
#: too short that most numbers ended outside their 90 % intervals.
_SHARP: Final = 1.0
_BLUNT: Final = 0.15
_MOVED: Final = 60.0
_FARTHEST: Final = 0.3
#: A loss is known to about this: where no more was promised, and it did not fall, the fit is there.
_DOUBTFUL: Final = 15.0
#: The longest last step, beside the longest of all.
_LAST: Final = 0.1
#: and of the last step of a fit that is far off, or ends.
_SHORTEST: Final = 0.02
#: A loss per statistic above this is no matter of effort.
_HOPELESS: Final = 3.0


def fit(
    problem: Problem, model: PixelModel, slots: Sequence[Slot], starts: Sequence[Sequence[float]], *, seed: int
) -> Fit:
    """Return the model with its numbers fitted, from the best of some coordinates on; see :func:`approach`."""
    x = best_of(problem, model, slots, starts, seed=seed, wrong=_ANYWHERE)
    return finish(problem, approach(problem, model, slots, x, seed=seed, wrong=_ANYWHERE))


def finish(problem: Problem, near: Approach) -> Fit:
    """Go to the minimum with more effort, and return the fit there."""
    model, slots, at, start, seed = near.model, near.slots, near.at, near.start, near.seed + 1
    # A model that is far off is not worth the effort.
    close = near.loss < _HOPELESS * len(problem.measured.labels)
    ways = _directions(near)
    more = math.sqrt(cost_of(model)) if close else 1.0
    samples = samples_around(problem, model, slots, at, seed + 1, ways, more * _SHARP if close else _BLUNT)
    fine = more * _FINE
    simulated = problem.simulate([problem.models(model, slots, at)], seed, fine)[0]
    samples.append(sample_of(problem, at, simulated))
    here = shifted(problem, problem.expect(simulated), slots, at)
    jacobian = slopes(problem, slots, at, here, samples, ways)
    close = close and loss_of(problem, here, slots, at, start) < _HOPELESS * len(here.value)
    visited = [(at, here)]
    seen = [simulated]
    radius = 1.0
    for k in range(_POLISHINGS if close else 0):
        delta, gain = step_from(problem, here, jacobian, slots, at, start, radius)
        # Chance of the simulation alone promises about half a unit for each coordinate.
        if gain < _SMALL + 0.5 * len(slots):
            break
        to = at + delta
        again = problem.simulate([problem.models(model, slots, to)], seed + 10 * (k + 1), fine)[0]
        samples.append(sample_of(problem, to, again))
        there = shifted(problem, problem.expect(again), slots, to)
        before, after = loss_of(problem, here, slots, at, start), loss_of(problem, there, slots, to, start)
        _LOG.debug("polishing, loss %.5g to %.5g, gain %.4g, at %s", before, after, gain, shown(slots, to))
        visited.append((to, there))
        seen.append(again)
        if after < before:
            at, here, simulated = to, there, again
        elif gain < _DOUBTFUL:
            break
        else:
            radius *= _SHORTER
        jacobian = slopes(problem, slots, at, here, samples, ways)
    here = pooled(problem, visited, jacobian, slots, at, start)
    last, value = _last_step(problem, here, jacobian, slots, at, start, _LAST if close else _SHORTEST)
    models = problem.models(model, slots, last)
    found = Fit(
        model=problem.of_settings(model, slots, last)[0],
        slots=slots,
        x=last,
        start=start,
        value=value,
        ratio=here.ratio,
        roots=here.roots,
        deviation=here.deviation,
        jacobian=jacobian,
        scale=scale_of(problem, simulated),
        residual=problem.measured.value - value,
        common=(1.0 + problem.alike(models) / here.recordings) / here.more,
    )
    return replace(found, frozen=frozen_of(problem, found, models, seen))


def _last_step(
    problem: Problem, here: Expectation, jacobian: Floats, slots: Sequence[Slot], at: Floats, start: Floats,
    radius: float,
) -> tuple[Floats, Floats]:  # fmt: skip
    """Return coordinates and what is expected there, after a small step: it follows from the changes by coordinate.

    A step that allows for chance in the changes may lead to where they, with that chance, expect a larger loss. There
    it is nothing but chance.
    """
    last = inside(slots, at + step_from(problem, here, jacobian, slots, at, start, radius)[0])
    value = here.value + jacobian.mean(axis=0) @ (last - at)
    before = loss_of(problem, here, slots, at, start)
    after = loss_of(problem, replace(here, value=value), slots, last, start)
    _LOG.debug("last, loss %.5g to %.5g, at %s", before, after, shown(slots, last))
    return (last, value) if after < before else (at, here.value)


def _directions(near: Approach) -> Floats:
    """Return (k, m) along which differences are taken: all of them about equally well seen, in all statistics."""
    simulated = np.array([slot.free.owner != ALIGNMENT for slot in near.slots])
    scale = longest_of(near.slots, near.at)[simulated]
    known = near.information + np.diag(prior_precision(near.slots))
    values, vectors = np.linalg.eigh(known[np.ix_(simulated, simulated)] * np.outer(scale, scale))
    far = np.minimum(_MOVED / np.sqrt(np.maximum(values, _MOVED**2 * 1e-6)), _FARTHEST)
    found = np.zeros((len(near.slots), len(scale)))
    found[simulated] = scale[:, None] * vectors * far
    return found
