"""An entrant of a race with a detail that sets in beyond some value: a queue loses events only if it is short.

With the usual value the effect does something else altogether, and would be left behind by one that loses events in
another way.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.expected.catalogue import details_of
from bench.diagnosis.expected.problem import Slot
from bench.diagnosis.fitting.approach import scanned
from bench.diagnosis.fitting.cloud import Cloud
from bench.diagnosis.fitting.steps import inside
from bench.diagnosis.searching.race import switches_of

if TYPE_CHECKING:
    from bench.diagnosis.expected.problem import Problem
    from bench.diagnosis.fitting.approach import Approach

__all__ = ["with_what_sets_in"]

#: Sizes of the effect, beside that of the catalogue, that are tried with each value.
_SIZES: Final = (0.03, 0.1, 0.25, 0.5, 1.0, 2.0, 4.0)
#: A loss lower by this share is that of another value, and not of chance.
_BETTER: Final = 0.1


def with_what_sets_in(problem: Problem, one: Approach) -> Approach:
    """Return an entrant, or one with a number more that is free, where the run is clearly nearer to that.

    Such a number is a detail of its effect that has no end: beyond some value nothing is lost.
    """
    added = one.model.effect(one.slots[-1].free.owner)
    details = [] if added is None else details_of(type(added))
    for free, values in details:
        if math.isinf(free.highest):
            slots = (*one.slots, Slot(free))
            usual = free.coordinate(float(getattr(added, free.field)))
            wider = replace(one, slots=slots, at=np.append(one.at, usual), start=np.append(one.start, usual),
                            information=np.zeros((len(slots), len(slots))))  # fmt: skip
            without = _best_size(problem, wider, (usual,))
            within = _best_size(problem, wider, tuple(free.coordinate(value) for value in values))
            if within.loss < (1.0 - _BETTER) * without.loss:
                one = replace(within, start=np.append(one.start, within.at[-1]), loss=math.inf, cloud=Cloud())
    return one


def _best_size(problem: Problem, one: Approach, coordinates: tuple[float, ...]) -> Approach:
    """Return the best of some sizes of an effect with some coordinates of its last number."""
    mine = switches_of(one)[:1]
    size = one.slots[mine[0]].free
    places = []
    for factor, last in product(_SIZES, coordinates):
        to = one.at.copy()
        to[mine] = factor * size.coordinate(size.probe)
        to[-1] = last
        places.append(inside(one.slots, to))
    return scanned(problem, one, places)
