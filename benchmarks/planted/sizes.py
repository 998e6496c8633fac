"""How large a planted effect is, whatever a diagnosis says: the root of the expected fall of the deviance.

The expectation of the truth with the effect stands for the measurement, and that of the truth without it for the
model; the numbers of the base pixel and of other effects take up what they can, along the changes that they make.
Simulated expectations are uncertain, and the square of a difference would count that as size: the product of two
differences from sensors that have nothing in common does not. So it is with the changes: with chance in them they
would take up less than they do, and what is but a later clock would count as size. What is still uncertain is told by
how the two differences differ; an effect that does not stand out of it is made larger until it does, and the size
found goes down by as much: small effects are straight lines, as far as what was seen of them lets them be. Some are
bent from nothing on: a jitter of time stamps adds its square to the spread of latencies. So it is looked at once
more, larger, and what grows faster falls faster.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

from bench.diagnosis.expected.catalogue import switches
from benchmarks.planted.falls import fall
from benchmarks.planted.following import Place, changes_by, least_left, left_along
from benchmarks.planted.mimics import nearest
from benchmarks.planted.truth import Truth

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from benchmarks.planted.cases import Case
    from benchmarks.planted.falls import Pair
    from benchmarks.planted.following import Least
    from sim_backend.pixel import PixelModel
    from sim_backend.pixel.effects.base import Effect

    Floats = npt.NDArray[np.float64]

__all__ = ["ALIKE", "Sizes", "sizes_of"]

#: One effect mimics another where it leaves less than this of it, in standard errors.
ALIKE: Final = 3.0
#: An effect whose fall stands out by fewer standard errors is made larger, by this factor, so many times in all.
_CLEARLY: Final = 6.0
_LARGER, _LARGEST = 4.0, 256.0
#: Share of a size that is most of it.
_MOSTLY: Final = 0.5
#: Sizes go with the square at the most.
_STEEPEST: Final = 2.0
#: Of two sizes the one of the smaller effect holds where they are more standard errors apart.
_BELIEVED: Final = 3.0
#: Sensors in each set where it is close whether one effect is alike another.
_MANY_SENSORS: Final = 12


@dataclass(frozen=True, slots=True)
class Sizes:
    """What is known of a case without a diagnosis."""

    size: dict[str, float]  #: of each planted effect, beside the others: standard errors
    mimic: str | None = None  #: effect of the catalogue that comes nearest, and
    beyond_mimic: float | None = None  #: what is left of the size then


def sizes_of(case: Case, *, mimics: bool = False) -> Sizes:
    """Return the size of each planted effect.

    Parameters
    ----------
    mimics
        Whether to look for the effect of the catalogue that comes nearest, for a case with one effect.
    """
    if not case.planted:
        return Sizes({})
    truth = Truth(case, case.model)
    size: dict[str, float] = {}
    mimic: tuple[str | None, float | None] = None, None
    for effect_id in case.planted:
        rest = case.model.without(effect_id)
        apart = truth.apart(rest)
        base, prior = changes_by(truth, rest)
        size[effect_id] = truth.bench.scale * _size(truth, rest, case.model.effect(effect_id), apart, base, prior)
        if mimics and size[effect_id] >= ALIKE:  # of a smaller one no more than that can be left
            mimic = _mimic(case, truth, rest, effect_id, base, prior, apart)
    return Sizes(size, *mimic)


def _mimic(
    case: Case, truth: Truth, rest: PixelModel, planted: str, base: Pair, prior: Floats, apart: Pair
) -> tuple[str | None, float]:  # fmt: skip
    """Return the effect of the catalogue that comes nearest, and the size that is left when all numbers follow.

    Where chance may put that on the other side of what counts as alike, more sensors tell.
    """
    near = nearest(truth, rest, planted, base, prior, apart)
    if not near:
        return None, truth.bench.scale * _root(fall(apart, base, prior))
    least = {name: least_left(truth, Place.of(model)) for name, model in near.items()}
    name, best = min(least.items(), key=lambda one: one[1].left)
    if abs(best.left - (ALIKE / truth.bench.scale) ** 2) < _BELIEVED * best.doubt:
        sharper = Truth(case, case.model, _MANY_SENSORS)
        close = {n: one.place for n, one in least.items() if one.left - best.left < _BELIEVED * best.doubt}
        least = {n: least_left(sharper, place) for n, place in close.items()}
        name, best = min(least.items(), key=lambda one: one[1].left)
    return name, truth.bench.scale * _root(best.left)


def _size(
    truth: Truth, rest: PixelModel, effect: Effect | None, apart: Pair, base: Pair, prior: Floats
) -> float:  # fmt: skip
    """Return the root of the fall, of an effect that is large enough to tell, by how much larger that is.

    Some effects set in beyond a size, and some are taken up by base numbers that are known as long as they are small:
    where that says clearly more than what was seen of a smaller one, the smaller one is right.
    """
    factor, larger, seen = 1.0, None, []
    while True:
        least = left_along(truth, rest, None if larger is None else rest + larger, apart, base, prior)
        found, doubt = max(least.left, least.known), least.doubt
        is_clear = found >= _CLEARLY * doubt or _is_known(least)
        if is_clear or effect is None or factor >= _LARGEST:
            break
        larger = _larger(effect, factor * _LARGER)
        if larger is None:
            break
        seen.append((found, doubt, factor))
        factor *= _LARGER
        apart = truth.apart(rest, rest + larger)
    power = 1.0 if _is_known(least) else _power(truth, rest, effect, factor, found, base, prior)
    size = _root(found) / math.pow(factor, power)
    for smaller, doubt, at in reversed(seen):
        if (size * math.pow(at, power)) ** 2 > smaller + _BELIEVED * doubt:
            size = _root(smaller + doubt) / math.pow(at, power)
    return size


def _power(
    truth: Truth, rest: PixelModel, effect: Effect | None, factor: float, found: float, base: Pair, prior: Floats
) -> float:  # fmt: skip
    """Return with which power of how large an effect is its size goes, where it had to be made larger."""
    larger = None if effect is None or factor == 1.0 else _larger(effect, factor * _LARGER)
    if larger is None or found <= 0.0:
        return 1.0
    more = left_along(truth, rest, rest + larger, truth.apart(rest, rest + larger), base, prior)
    # What may be chance makes no power: the least that it may well have grown by counts.
    grown = _root(more.left - more.doubt) / _root(found)
    return min(max(math.log(grown) / math.log(_LARGER), 1.0), _STEEPEST) if grown > 0.0 else 1.0


def _is_known(least: Least) -> bool:
    """Return whether a size is mostly that of how far numbers have gone from where they are known to be.

    That is in no doubt, and goes with the size of the effect.
    """
    return least.known >= max(1.0, _MOSTLY * least.left)


def _larger(effect: Effect, factor: float) -> Effect | None:
    """Return the effect at so many times the coordinates that switch it on; None: that is out of bounds."""
    values = {}
    for free in switches(type(effect)):
        at = factor * free.coordinate(getattr(effect, free.field))
        if not free.range[0] <= at <= free.range[1]:
            return None
        values[free.field] = free.value(at)
    return replace(effect, **values) if values else None  # type: ignore[type-var]


def _root(square: float) -> float:
    return math.sqrt(max(square, 0.0))
