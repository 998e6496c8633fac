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
from bench.diagnosis.fitting.steps import with_coordinate
from bench.diagnosis.searching.race import other_sizes

if TYPE_CHECKING:
    from bench.diagnosis.expected.problem import Problem
    from bench.diagnosis.fitting.approach import Approach

__all__ = ["with_what_sets_in"]

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
    tries = product(other_sizes(one), coordinates)
    return scanned(problem, one, [with_coordinate(place, -1, last) for place, last in tries])
