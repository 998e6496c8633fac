"""Whether a run like this one would tell two effects apart."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.expected.catalogue import is_of_few, sized, switches
from bench.diagnosis.fitting.fitted import off_known
from bench.diagnosis.searching.apart import SURELY, differences, least_product, product
from bench.diagnosis.searching.screen import basis_of, beyond, extended

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.diagnosis.expected.problem import Problem, Slot
    from bench.diagnosis.fitting.fitted import Fit
    from bench.diagnosis.searching.refit import Found
    from sim_backend.pixel.effects.base import Effect
    from sim_backend.pixel.model import PixelModel

    Floats = npt.NDArray[np.float64]

__all__ = ["TIED", "closest", "nearer", "separation", "stand_in"]

#: Separation, in standard errors, below which two effects cannot be told apart.
TIED: Final = 2.0
#: Effort of a simulation of two models, and how many there are; and both where these leave it in doubt, and chance
#: is small enough then that none of it needs to be taken off.
_EFFORT: Final = 1.0
_TIMES: Final = 4
_DOUBTFUL: Final = (10.0, 4)
_OTHER_SEED: Final = 3
#: No residual of the sum of two, and no statistic of a difference, counts for more standard errors.
_MOST: Final = 10.0
#: Sizes at which an effect may come closest to another, beside that of the catalogue, with little effort; then steps
#: to the size that a straight line from no effect lets expect, none of which changes it by more than a factor, until
#: one changes it by a small share; both models are simulated twice for each.
_SIZES: Final = (0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0)
_ROUGH: Final = 0.2
_STEPS: Final = 3
_TWICE: Final = 2
_FACTOR: Final = 3.0
_THERE: Final = 0.1
#: What is further apart with little effort is so with more; by how much does not matter.
_CLEAR: Final = 30.0
#: At the end the size may still change by this share; until it does not ask for more, it is looked at so often.
_LAST_SHARE: Final = 0.5
_LOOKS: Final = 3


def separation(problem: Problem, one: Found, other: Found, seed: int) -> float:
    """Return by how many standard errors a run like this one would tell two fitted models apart.

    What the free numbers of the first could take up is left out, but for those of its effect. It is a lower limit:
    what may be chance of the simulation tells nothing apart.
    """
    models = other.fit.models(problem)
    basis = basis_of(one.fit, problem, without=one.effect)
    change = _apart(problem, one, basis, [models], seed, _EFFORT, _TIMES)[0]
    if _is_doubtful(change):
        change = _apart(problem, one, basis, [models], seed + _OTHER_SEED, *_DOUBTFUL, plain=True)[0]
    return _length(change)


def nearer(problem: Problem, one: Found, other: Found, seed: int, *, surely: bool = False) -> float:
    """Return by how much the run is nearer to another fitted model than to the first: as a fall of the deviance.

    The deviances of two models differ by the chance of all statistics in both simulations. Along the line from one
    model to the other there is hardly any: so far and no further are the residuals of both looked at (D. R. Cox,
    "Tests of separate families of hypotheses", Proc. 4th Berkeley Symp. Math. Statist. Prob., 1961).

    Parameters
    ----------
    surely
        Return what is left of it when two standard errors of the simulations are taken off.
    """
    fit, points = one.fit, problem.measured.points
    basis = basis_of(fit, problem, without=one.effect)
    models = other.fit.models(problem)
    # Of what few pixels have a simulated sensor has none, or twice as much.
    few = any(is_of_few(effect.id) for model in (fit.model, other.fit.model) for effect in model.effects)
    apart = _apart(problem, one, basis, [models], seed, _DOUBTFUL[0] if few else _EFFORT, _TIMES)[0]
    both = fit.whiten(fit.residual + other.fit.residual, points)
    left = beyond(basis, np.concatenate([both, off_known(fit) + _off_known(other.fit, fit)])[:, None])[:, 0]
    each = apart @ _clipped(left) / fit.common
    chance = float(each.std(ddof=1)) / math.sqrt(_TIMES)
    return float(each.mean()) - (SURELY * chance if surely else 0.0)


def _off_known(one: Fit, like: Fit) -> Floats:
    """Return by how much a fit is off what is known before, for each number of another one; 0 where it lacks that."""
    off = dict(zip(map(_key, one.slots), off_known(one), strict=True))
    return np.array([off.get(_key(slot), 0.0) for slot in like.slots])


def _key(slot: Slot) -> tuple[str, str, int | None]:
    return slot.free.owner, slot.free.name, slot.setting


def closest(problem: Problem, one: Found, other: type[Effect], seed: int) -> float:
    """Return by how many standard errors a run tells a model from the best of another effect; no more than 30.

    The other effect stands in the place of the first one. The other numbers stay, as far as they could not take up
    the difference. A fit of the other effect that has not come to its minimum looks different where the effect is
    not.
    """
    place = _Place(problem, one, other)
    size, rough = place.size(seed)
    if rough is not None and product(_clipped(rough), _clipped(rough)) > _CLEAR**2:
        return _CLEAR
    size, null, here = place.looked_at(size, seed + 1, _EFFORT, _TIMES)
    best = _at_its_best(null, here, _LAST_SHARE)
    if _is_doubtful(best):
        _, null, here = place.looked_at(size, seed + _LOOKS + _OTHER_SEED, *_DOUBTFUL, plain=True)
        best = _at_its_best(null, here)
    return min(_length(best), _CLEAR)


def stand_in(problem: Problem, one: Found, other: type[Effect], seed: int) -> PixelModel:
    """Return the first model with another effect in the place of its own, in the size that comes closest."""
    place = _Place(problem, one, other)
    return place.models(place.size(seed)[0])[0]


class _Place:
    """The place of an effect in a fitted model, which another one takes; sizes are beside that of the catalogue."""

    def __init__(self, problem: Problem, one: Found, other: type[Effect]) -> None:
        self._problem, self._one, self._other = problem, one, other
        self._basis = basis_of(one.fit, problem, without=one.effect)
        kept = [i for i, slot in enumerate(one.fit.slots) if slot.free.owner != one.effect]
        self._slots, self._numbers = [one.fit.slots[i] for i in kept], one.fit.x[kept]

    def models(self, size: float) -> list[PixelModel]:
        """Return the models of all points; without either effect at a size of 0."""
        model = self._one.fit.model.without(self._one.effect)
        if size:
            model += sized(self._other, size, self._problem.given.get(self._other.id))
        return self._problem.models(model, self._slots, self._numbers)

    def apart(
        self, sizes: Sequence[float], seed: int, effort: float, times: int, *, plain: bool = False
    ) -> list[Floats]:
        """Return for each size (times, n) how the models differ from the fitted one."""
        others = [self.models(size) for size in sizes]
        return _apart(self._problem, self._one, self._basis, others, seed, effort, times, plain=plain)

    def size(self, seed: int) -> tuple[float, Floats | None]:
        """Return the size at which the other effect comes closest, and (times, n) how the models differ there.

        It follows from no effect and one at about that size; None where that size is farther away.
        """
        signs = (1.0, -1.0) if all(f.signed for f in switches(self._other)) else (1.0,)
        tried = [sign * f for f in _SIZES for sign in signs]
        looks = self.apart(tried, seed, _ROUGH, _TWICE)
        size = tried[int(np.argmin([product(look, look) for look in looks]))]
        for _ in range(_STEPS):
            null, here = self.apart((0.0, size), seed, _ROUGH, _TWICE)
            share = _share(null, here)
            size *= _factor(share)
            if abs(share) < _THERE:
                break
        return size, here + share * (here - null) if -1.0 <= share < _THERE else None

    def looked_at(
        self, size: float, seed: int, effort: float, times: int, *, plain: bool = False
    ) -> tuple[float, Floats, Floats]:  # fmt: skip
        """Return a size, or one that comes closer with such effort, and how the models differ without and there."""
        for number in range(_LOOKS):
            null, here = self.apart((0.0, size), seed + number, effort, times, plain=plain)
            share = _share(null, here)
            if abs(share) <= _LAST_SHARE or number == _LOOKS - 1:
                break
            size *= _factor(share)
        return size, null, here


def _factor(share: float) -> float:
    """Return by which factor a size changes that wants to change by a share of itself."""
    return float(np.clip(1.0 + share, 1.0 / _FACTOR, _FACTOR))


def _at_its_best(null: Floats, here: Floats, most: float = math.inf) -> Floats:
    """Return how the models differ at the size that comes closest; no farther than a share from the one looked at.

    What is so small that it is in doubt goes along a straight line, however far.
    """
    share = _share(null, here)
    share = max(-1.0, float(np.clip(share, -most, most))) if math.isfinite(share) else 0.0
    return np.asarray(here + share * (here - null))


def _share(null: Floats, here: Floats) -> float:
    """Return by what share of itself a size wants to change, if all goes along the line from no effect.

    It is infinite where nothing of the effect is seen.
    """
    along = here - null
    length = product(along, along)
    seen = length if len(along) <= _TWICE else least_product(along, along)
    return -product(here, along) / length if seen > 0.0 else math.inf


def _apart(
    problem: Problem, one: Found, basis: Floats, others: Sequence[Sequence[PixelModel]], seed: int, effort: float,
    times: int, *, plain: bool = False,
) -> list[Floats]:  # fmt: skip
    """Return (times, n) how some models differ from a fitted one beyond a basis, whitened."""
    base = one.fit.models(problem)
    found = differences(problem, one.fit, base, others, seed, effort, times, plain=plain)
    return [beyond(basis, extended(one.fit, change.T)).T for change in found]


def _length(change: Floats) -> float:
    """Return the least length that a change surely has; where it is gross, chance is gross, too."""
    change = _clipped(change)
    return math.sqrt(max(least_product(change, change), 0.0))


def _is_doubtful(change: Floats) -> bool:
    """Return whether two models look different, and that may be chance: of few simulations it is hardly known."""
    change = _clipped(change)
    return product(change, change) > TIED**2 > least_product(change, change)


def _clipped(change: Floats) -> Floats:
    return np.clip(change, -_MOST, _MOST)
