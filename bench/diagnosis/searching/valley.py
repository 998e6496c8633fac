"""A model with an effect more whose other numbers follow its size, from small to large: a way through a bent valley.

While an effect is missing, others stand in for it: noise of the resets makes thresholds and noise of the floor seem
larger by half. From there steps along straight lines lead nowhere, however far: with the effect at the size that it
has, and the other numbers where they were, all is much worse than without it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.expected.parameters import put
from bench.diagnosis.fitting.approach import approach, scanned
from bench.diagnosis.fitting.steps import inside
from bench.diagnosis.searching.race import switches_of

if TYPE_CHECKING:
    from bench.diagnosis.expected.problem import Problem
    from bench.diagnosis.fitting.approach import Approach

__all__ = ["through_the_valley"]

#: Sizes of the effect, beside that of the catalogue, and steps that the others follow by at each.
_SIZES: Final = (0.25, 0.5, 1.0, 2.0, 4.0)
_STEPS: Final = 5
#: Relative error that what is expected may have there.
_WRONG: Final = 0.1
#: The end of the valley is gone to from a place with a loss lower by this share: so many steps, the first so short.
_BETTER: Final = 0.1
_TO_THE_END: Final = 8
_LESS_WRONG: Final = 0.03
_SHORT: Final = 0.2


def through_the_valley(problem: Problem, way: Approach) -> Approach | None:
    """Return where a way goes on from another size of its effect, which all its other numbers have followed.

    Parameters
    ----------
    way
        Where the model is near a minimum, as far as steps from there tell.

    Returns
    -------
    Approach or None
        None: no other size is clearly better.
    """
    mine = switches_of(way)
    others = [i for i in range(len(way.slots)) if i not in mine]
    switches = [way.slots[i].free for i in mine]
    probes = [free.coordinate(free.probe) for free in switches]
    at, places = way.at.copy(), []
    for size in _SIZES:
        at[mine] = np.copysign(np.multiply(size, probes), way.at[mine])
        at = inside(way.slots, at)
        near = approach(
            problem, put(way.model, switches, list(at[mine])), [way.slots[i] for i in others], list(at[others]),
            seed=way.seed, iterations=_STEPS, wrong=_WRONG, prior=way.start[others],
        )  # fmt: skip
        at[others] = near.at
        places.append(at.copy())
    seen = scanned(problem, way, places)
    if seen.loss > (1.0 - _BETTER) * way.loss:
        return None
    again = approach(
        problem, seen.model, seen.slots, list(seen.at), seed=seen.seed, iterations=_TO_THE_END, wrong=_LESS_WRONG,
        prior=seen.start, cloud=seen.cloud, reach=_SHORT,
    )  # fmt: skip
    return min(seen, again, key=lambda one: one.loss)
