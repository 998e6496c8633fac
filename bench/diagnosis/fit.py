"""Fitting the free numbers of a model to a run: Gauss-Newton steps on simulated expectations.

Every expectation is simulated, so any effect can be fitted, a user's own too. The same random numbers are used for
all parameters of one step. What is simulated is uncertain: near the minimum it is simulated with more effort, and
what a step has changed in truth corrects the changes by coordinate. These come from two sensors, so that products of
one sensor's changes with the other's have no chance in them: squares would count it as information.
"""

from __future__ import annotations

import logging
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.approach import CHANCE, SMALL, approach
from bench.diagnosis.chance import frozen_of, pooled, scale_of
from bench.diagnosis.fitted import Fit
from bench.diagnosis.looks import look, loss_of, shifted
from bench.diagnosis.parameters import ALIGNMENT
from bench.diagnosis.steps import corrected, inside, longest_of, shown, step_from

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.diagnosis.approach import Approach
    from bench.diagnosis.problem import Problem, Slot
    from sim_backend.pixel.model import PixelModel

    Floats = npt.NDArray[np.float64]

__all__ = ["finish", "fit"]

_LOG = logging.getLogger(__name__)

#: Effort of one expectation at the solution, and how often it is looked for there.
_FINE: Final = 3.0
_POLISHINGS: Final = 6
#: A step that makes the loss so many times larger went wrong, and the next is shorter.
_WORSE: Final = 1.2
_SHORTER: Final = 0.3
#: Width of a sharp look, in usual steps, at the most; no wider than that all statistics together move by so many
#: standard errors, and not narrower than so many samples: chance is small beside that, and lines are straight.
_SPAN: Final = 2.0
_MOVED: Final = 60.0
_SAMPLES: Final = 4.0
#: The longest last step, beside the longest of all.
_LAST: Final = 0.1
#: and of the last step of a fit that is far off, or ends.
_SHORTEST: Final = 0.02
#: A loss per statistic above this is no matter of effort.
_HOPELESS: Final = 3.0


def fit(problem: Problem, model: PixelModel, slots: Sequence[Slot], x: Sequence[float], *, seed: int) -> Fit:
    """Return the model with its numbers fitted, from the coordinates `x` on; see :func:`approach`."""
    return finish(problem, approach(problem, model, slots, x, seed=seed))


def finish(problem: Problem, near: Approach) -> Fit:
    """Go to the minimum with more effort, and return the fit there."""
    model, slots, at, start, seed = near.model, near.slots, near.at, near.start, near.seed + 1
    # A model that is far off is not worth the effort.
    close = near.loss < _HOPELESS * len(problem.measured.labels)
    widest = _widest(problem, near) if close else None
    looked = look(problem, model, slots, at, seed + 1, _SPAN if close else 1.0, widest)[1]
    jacobian = looked
    simulated = problem.simulate([problem.models(model, slots, at)], seed, _FINE)[0]
    here = shifted(problem, problem.expect(simulated), slots, at)
    close = close and loss_of(problem, here, slots, at, start) < _HOPELESS * len(here.value)
    visited = [(at, here)]
    seen = [simulated]
    radius = 1.0
    for k in range(_POLISHINGS if close else 0):
        delta, gain = step_from(problem, here, jacobian, slots, at, start, radius)
        # Chance of the simulation alone promises about half a unit for each coordinate.
        if gain < SMALL + 0.5 * len(slots):
            break
        to = at + delta
        again = problem.simulate([problem.models(model, slots, to)], seed + 10 * (k + 1), _FINE)[0]
        there = shifted(problem, problem.expect(again), slots, to)
        before, after = loss_of(problem, here, slots, at, start), loss_of(problem, there, slots, to, start)
        _LOG.debug("polishing, loss %.5g to %.5g, gain %.4g, at %s", before, after, gain, shown(slots, to))
        visited.append((to, there))
        seen.append(again)
        if after < before + CHANCE:
            at, here, simulated = to, there, again
        else:
            radius *= _SHORTER
        if after > _WORSE * before:
            jacobian = corrected(jacobian, delta, there.value - here.value, longest_of(slots, at))
    here = pooled(problem, visited, jacobian, slots, at, start)
    # The last step is small: what is expected there follows from the changes by coordinate.
    last = inside(slots, at + step_from(problem, here, jacobian, slots, at, start, _LAST if close else _SHORTEST)[0])
    value = here.value + jacobian.mean(axis=0) @ (last - at)
    _LOG.debug("last, loss %.5g to %.5g, at %s", loss_of(problem, here, slots, at, start),
               loss_of(problem, replace(here, value=value), slots, last, start), shown(slots, last))  # fmt: skip
    models = problem.models(model, slots, last)
    found = Fit(
        model=models[0],
        slots=slots,
        x=last,
        start=start,
        value=value,
        ratio=here.ratio,
        roots=here.roots,
        deviation=here.deviation,
        jacobian=looked,
        scale=scale_of(problem, simulated),
        residual=problem.measured.value - value,
        common=(1.0 + problem.alike(models) / here.recordings) / here.more,
    )
    return replace(found, frozen=frozen_of(problem, found, models, seen))


def _widest(problem: Problem, near: Approach) -> Floats:
    """Return over how large a difference of each coordinate changes are taken at the most."""
    widest = _MOVED / np.maximum(near.seen, 1e-300)
    for i, (slot, x) in enumerate(zip(near.slots, near.at, strict=True)):
        if slot.free.unit == "s" and slot.free.owner != ALIGNMENT:
            least = _SAMPLES * problem.forward.dt_s
            widest[i] = max(widest[i], slot.free.coordinate(slot.free.value(x) + least) - x)
    return widest
