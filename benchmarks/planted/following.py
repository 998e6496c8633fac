"""The free numbers of a model follow what a truth shows: straight lines lead near to where they leave least of it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.expected.catalogue import free_of
from bench.diagnosis.expected.parameters import base_parameters, get, move, put
from benchmarks.planted.falls import beside, fall, taken_up, uncertainty
from benchmarks.planted.truth import TIMING_US

if TYPE_CHECKING:
    import numpy.typing as npt

    from bench.diagnosis.expected.parameters import Free
    from benchmarks.planted.falls import Pair
    from benchmarks.planted.truth import Truth
    from sim_backend.pixel import PixelModel

    Floats = npt.NDArray[np.float64]

__all__ = ["Least", "Place", "changes_by", "least_left", "left_along"]

#: Straight lines lead no farther than this, in ln units, or in what is known of the clock.
_FARTHEST: Final = 4.0
#: Steps at the most, as long as straight lines promise to leave less by a share of what is left; of a way that leads
#: too far, shares.
_STEPS: Final = 6
_WORTH_IT: Final = 0.05
_SHARES: Final = (1.0, 0.5, 0.25)


@dataclass(frozen=True, slots=True)
class Place:
    """A model whose numbers, and clock, have gone some way from where they were known to be."""

    model: PixelModel
    moved: Floats  #: (k,) by how much each has gone: coordinates, and the clock in units of what is known of it

    @classmethod
    def of(cls, model: PixelModel) -> Place:
        """Return the place of a model whose numbers have not gone anywhere."""
        return cls(model, np.zeros(len(_numbers(model)) + 1))

    @property
    def late_us(self) -> int:
        """By how much the events come late."""
        return round(TIMING_US * float(self.moved[-1]))

    def left(self, apart: Pair, prior: Floats) -> float:
        """Return what is left of a difference here, and of what is known of the numbers."""
        return float(apart[0] @ apart[1]) + self.known(prior)

    def known(self, prior: Floats) -> float:
        """Return the part of it that is for how far the numbers have gone from where they are known to be."""
        return float(prior @ self.moved**2)

    def follow(self, apart: Pair, changes: Pair, prior: Floats, share: float = 1.0) -> Place:
        """Return where straight lines say that the numbers take up most, or the place a share of the way there."""
        by = taken_up(apart, changes, prior, self.moved)
        by *= share * min(1.0, _FARTHEST / float(np.max(np.abs(by), initial=_FARTHEST)))
        moved = self.moved + by
        moved[-1] = round(TIMING_US * moved[-1]) / TIMING_US
        numbers = _numbers(self.model)
        places = [free.coordinate(get(self.model, free)) + step for free, step in zip(numbers, by[:-1], strict=True)]
        return Place(put(self.model, numbers, places), moved)  # within the bounds of each number


@dataclass(frozen=True, slots=True)
class Least:
    """The place that leaves least of a truth."""

    place: Place
    left: float  #: fall of the deviance
    doubt: float  #: its standard error
    known: float  #: part that is for how far numbers have gone from where they are known to be: it is in no doubt


def changes_by(truth: Truth, model: PixelModel) -> tuple[Pair, Floats]:
    """Return the changes by the numbers of a model and the clock, and how well these are known before."""
    moved, steps, prior = [], [], []
    for free in _numbers(model):
        at = free.coordinate(get(model, free))
        to = move(free, at)
        moved.append(put(model, [free], [to]))
        steps.append(to - at)
        prior.append(0.0 if math.isinf(free.prior_sd) else free.prior_sd**-2)
    changes = beside(truth.changes(model, moved, steps), truth.delayed(model))
    return changes, np.array([*prior, 1.0])


def least_left(truth: Truth, place: Place) -> Least:
    """Return what of the truth is left when all numbers of a model have followed it, from place to place.

    What straight lines promise counts where that is next to nothing, or chance; of more, only what was found there.
    """
    apart = truth.apart(place.model, None, place.late_us)
    for _ in range(_STEPS):
        changes, prior = changes_by(truth, place.model)
        closer = _closer(truth, None, place, apart, changes, prior)
        if closer is None:
            break
        place, apart = closer
    promised = fall(apart, changes, prior, place.moved)
    left = promised if _is_there(place, apart, changes, prior) else place.left(apart, prior)
    return Least(place, left, uncertainty(*apart), place.known(prior))


def left_along(
    truth: Truth, model: PixelModel, other: PixelModel | None, apart: Pair, changes: Pair, prior: Floats
) -> Least:  # fmt: skip
    """Return what of a truth is left when the numbers of a model have followed it, and go on changing it alike.

    That takes a small part of the time of looking at each place at what they change, and what they change is less
    certain than where they lead.

    Parameters
    ----------
    other
        Stands for the truth, if any does.
    apart
        It, less the model.
    """
    place = Place.of(model)
    for _ in range(_STEPS):
        closer = _closer(truth, other, place, apart, changes, prior)
        if closer is None:
            break
        place, apart = closer
    return Least(place, fall(apart, changes, prior, place.moved), uncertainty(*apart), place.known(prior))


def _closer(
    truth: Truth, other: PixelModel | None, place: Place, apart: Pair, changes: Pair, prior: Floats
) -> tuple[Place, Pair] | None:  # fmt: skip
    """Return a place that is closer, and what is apart there; None where straight lines lead to none."""
    if _is_there(place, apart, changes, prior):
        return None
    for share in _SHARES:
        further = place.follow(apart, changes, prior, share)
        there = truth.apart(further.model, other, further.late_us)
        if further.left(there, prior) < place.left(apart, prior):
            return further, there
    return None


def _is_there(place: Place, apart: Pair, changes: Pair, prior: Floats) -> bool:
    """Return whether straight lines promise next to nothing, or what may be chance."""
    here, promised = place.left(apart, prior), fall(apart, changes, prior, place.moved)
    return here - promised < max(_WORTH_IT * here, uncertainty(*apart))


def _numbers(model: PixelModel) -> list[Free]:
    """Return the numbers of a model that are free; those of its other effects take up what they can, too."""
    effects = [free for effect in model.effects for free in free_of(type(effect))]
    return [*base_parameters(refractory_known=True), *effects]
