"""Fitting the free numbers of a model to a run: Gauss-Newton steps on simulated expectations.

Every expectation is simulated, so any effect can be fitted, a user's own too. The same random numbers are used for
all parameters of one step. What is simulated is uncertain: near the minimum it is simulated with more effort, and
what a step has changed in truth corrects the changes by coordinate. These come from two sensors, so that products of
one sensor's changes with the other's have no chance in them: squares would count it as information.
"""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.fitting import robust
from bench.diagnosis.fitting.along import looked_along
from bench.diagnosis.fitting.approach import approach, best_of
from bench.diagnosis.fitting.chance import frozen_of, pooled, scale_of
from bench.diagnosis.fitting.fitted import Fit, whiten
from bench.diagnosis.fitting.looks import loss_of, shifted
from bench.diagnosis.fitting.moving import FINE
from bench.diagnosis.fitting.slopes import Around, AsBefore, samples_around
from bench.diagnosis.fitting.steps import inside, shown, step_from
from bench.diagnosis.fitting.ways import directions, well_seen

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.diagnosis.expected.forward import Sensor
    from bench.diagnosis.expected.problem import Problem, Slot
    from bench.diagnosis.expected.residuals import Expectation
    from bench.diagnosis.fitting.approach import Approach
    from sim_backend.pixel.model import PixelModel

    Floats = npt.NDArray[np.float64]

__all__ = ["finish", "fit"]

_LOG = logging.getLogger(__name__)

#: Relative error that what is expected may have at the start of a fit.
_ANYWHERE: Final = 0.3
#: How many looks at the solution there are at the least, and how many steps at the most: what is expected is known
#: from all looks.
_VISITS: Final = 4
_POLISHINGS: Final = 6
#: A fit ends when a step would lower the loss by less than this.
_SMALL: Final = 1.0
#: Effort of one end of a difference, near the minimum and where the model is far off. With an effort of 0.4 steps to
#: the minimum were so much too short that most numbers ended outside their 90 % intervals.
_SHARP: Final = 1.0
_BLUNT: Final = 0.15
#: The loss of one look is known to about this, and to so many times what the chance of a simulation makes of it:
#: where it is larger by more than the least, the fit stays where it was.
_DOUBTFUL: Final = 15.0
_OF_CHANCE: Final = 1.5
#: and the next step is shorter.
_SHORTER: Final = 0.3
#: The longest last step, beside the longest of all.
_LAST: Final = 0.1
#: and of the last step of a fit that is far off, or ends.
_SHORTEST: Final = 0.02
#: A loss per statistic above this is no matter of effort, if so many steps did not lower it.
_HOPELESS: Final = 3.0
_ATTEMPTS: Final = 2
#: nor is one that is so many times the loss of another model.
_BEATEN: Final = 1.5
#: Lines are bent: where a good fit (its loss per statistic) has ended farther than this from the place around which
#: was looked, beside how far was looked, it is looked around again. Of slow noise, 1.5 away, the changes by its time
#: were a quarter too small, and its numbers up to twenty standard errors off; most fits end within 0.4.
_STRAYED: Final = 0.7
_GOOD: Final = 2.0
_OTHER_SEED: Final = 503
_SEED_ALONG: Final = 601
#: Directions of which less is seen, beside chance, are looked at again: so many times as far, with so many times the
#: effort.
_HARDLY: Final = 0.5
_FARTHER: Final = 3.0
_MORE: Final = 4.0


def fit(
    problem: Problem, model: PixelModel, slots: Sequence[Slot], starts: Sequence[Sequence[float]], *, seed: int
) -> Fit:
    """Return the model with its numbers fitted, from the best of some coordinates on; see :func:`approach`."""
    x = best_of(problem, model, slots, starts, seed=seed, wrong=_ANYWHERE)
    return finish(problem, approach(problem, model, slots, x, seed=seed, wrong=_ANYWHERE))


def finish(
    problem: Problem, near: Approach, *, precise: bool = False, beat: float = math.inf, effort: float = 1.0,
    known: Fit | None = None,
) -> Fit:  # fmt: skip
    """Go to the minimum with more effort, and return the fit there.

    Parameters
    ----------
    precise
        Of what takes long as many pixels are simulated as of the base pixel, however long that takes.
    beat
        The loss of the best of other models: what comes nowhere near it is not worth the effort.
    effort
        So many times as much is simulated as usual.
    known
        A fit of the same model whose changes by coordinate hold here; None: they are simulated.
    """
    model, slots, start = near.model, near.slots, near.start
    there = _minimum_seen(problem, near, precise, beat, effort, known)
    here, jacobian = there.expected, there.jacobian
    x, value = _last_step(problem, here, jacobian, slots, there.at, start, _LAST if there.close else _SHORTEST)
    models = problem.models(model, slots, x)
    found = Fit(
        model=problem.of_settings(model, slots, x)[0],
        slots=slots,
        x=x,
        start=start,
        value=value,
        ratio=here.ratio,
        roots=here.roots,
        deviation=here.deviation,
        jacobian=jacobian,
        scale=float(np.mean([scale_of(problem, here, sensors) for sensors in there.seen])),
        residual=problem.measured.value - value,
        common=(1.0 + problem.alike(models) / here.recordings) / here.more,
    )
    found = replace(found, frozen=frozen_of(problem, found, models, there.seen))
    return looked_along(problem, found, near.seed + _SEED_ALONG) if _is_good(problem, there.loss) else found


@dataclass(frozen=True)
class _Minimum:
    """A place from which no step promises much."""

    at: Floats  #: (k,) coordinates
    expected: Expectation
    jacobian: Floats  #: (2, n, k)
    seen: tuple[Sequence[Sensor], ...]  #: what was simulated there, and on the way
    close: bool  #: the model is not far off
    loss: float
    strayed: float  #: distance from the place around which was looked, beside how far was looked


def _minimum_seen(
    problem: Problem, near: Approach, precise: bool, beat: float, times: float, known: Fit | None
) -> _Minimum:  # fmt: skip
    """Return a minimum around which was looked, if the model is a good one there."""
    there = _minimum(problem, near, precise, beat, times, known)
    if there.strayed <= _STRAYED or not _is_good(problem, there.loss):
        return there
    return _minimum(problem, _going_on(problem, near, there), precise, beat, times, known)


def _is_good(problem: Problem, loss: float) -> bool:
    return loss < _GOOD * len(problem.measured.labels)


def _going_on(problem: Problem, near: Approach, there: _Minimum) -> Approach:
    """Return a minimum as a place to go on from, in other simulations."""
    first, second = (whiten(there.expected.roots, half, problem.measured.points) for half in there.jacobian)
    return replace(
        near, at=there.at, loss=there.loss, seed=near.seed + _OTHER_SEED, information=robust.shared(first, second)
    )


def _minimum(
    problem: Problem, near: Approach, precise: bool, beat: float, times: float, known: Fit | None
) -> _Minimum:  # fmt: skip
    """Go from place to place; what is expected is known from all that are close by, the better the more there are."""
    model, slots, at, start, seed = near.model, near.slots, near.at, near.start, near.seed + 1
    more = times * (max(problem.cost(problem.models(model, slots, at)), 1.0) if precise else 1.0)

    def look(x: Floats, number: int) -> tuple[Sequence[Sensor], Expectation]:
        found = problem.simulate([problem.models(model, slots, x)], seed + 10 * number, FINE * more)[0]
        return found, shifted(problem, problem.expect(found), slots, x)

    sensors, here = look(at, 0)
    least, radius = loss_of(problem, here, slots, at, start), 1.0
    # A model that is far off is not worth the effort.
    hopeless = _HOPELESS * len(problem.measured.labels)
    close = near.loss < hopeless and least < _BEATEN * beat
    # The larger the residuals, the less do changes need to be known to lower them.
    effort = max(_SHARP * hopeless / max(least, hopeless), _BLUNT) if close else _BLUNT
    around: Around | AsBefore
    if known is None:
        around = _looked_around(problem, near, here, close, effort * more)
    else:
        around = AsBefore(problem, slots, known)
    around.add(at, sensors)
    jacobian = around.slopes(at, here)
    visited, seen = [(at, here)], [sensors]
    for number in range(1, _POLISHINGS + 1 if close else 0):
        delta, gain = step_from(problem, here, jacobian, slots, at, start, radius)
        # Chance of the simulation alone promises about half a unit for each coordinate.
        if gain < _SMALL + 0.5 * len(slots) and len(visited) >= _VISITS:
            break
        if number > _ATTEMPTS and least > hopeless:
            break
        to = at + delta
        sensors, there = look(to, number)
        after = loss_of(problem, there, slots, to, start)
        _LOG.debug("polishing, loss %.5g to %.5g, gain %.4g, at %s", least, after, gain, shown(slots, to))
        around.add(to, sensors)
        visited.append((to, there))
        seen.append(sensors)
        if after < least + _doubt(there):
            at, least = to, min(least, after)
        else:
            radius *= _SHORTER
        jacobian = around.slopes(at, next(e for x, e in visited if x is at))
        here = pooled(problem, visited, jacobian, at)
    return _Minimum(at, here, jacobian, tuple(seen), close and least < hopeless, least, around.distance(at))


def _looked_around(problem: Problem, near: Approach, here: Expectation, close: bool, effort: float) -> Around:
    """Simulate around a place, to both sides of which everything is about equally well seen if it is close."""
    model, slots, at, seed = near.model, near.slots, near.at, near.seed + 1
    if close:
        ways = well_seen(problem, model, slots, at, here, near.information, seed + 2)
    else:
        ways = directions(slots, at, near.information)
    around = Around(problem, slots, samples_around(problem, model, slots, at, seed + 1, ways, effort), ways, at)
    if close and _is_good(problem, near.loss):
        for number in _hardly_seen(problem, around, here):
            around = around.farther(model, number, _FARTHER, seed + 3 + number, _MORE * effort)
    return around


def _hardly_seen(problem: Problem, around: Around, here: Expectation) -> list[int]:
    """Return the directions of which what is seen is mostly chance: those along a valley.

    The same chance is in all steps: they lead away from the minimum by as much as it makes of what is left over.
    """
    first, second = (
        whiten(here.roots, half, problem.measured.points) @ around.directions
        for half in around.slopes(around.centre, here)
    )
    seen, chance = np.sum(first * second, axis=0), 0.25 * np.sum((first - second) ** 2, axis=0)
    return [int(i) for i in np.flatnonzero(seen < _HARDLY * chance)]


def _doubt(there: Expectation) -> float:
    """Return by how much the loss of a look may be larger than that of another one at the same place.

    Of the variance of a residual a part is the simulation's; the sum of n squares varies by the root of 2 n.
    """
    part = 1.0 / (1.0 + there.recordings)
    return max(_DOUBTFUL, _OF_CHANCE * part * math.sqrt(2.0 * len(there.value)))


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
