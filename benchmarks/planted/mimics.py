"""Which effect of the catalogue comes nearest to one from outside it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.catalogue import candidates, sized, switches
from benchmarks.planted.falls import beside, fall, taken_up
from benchmarks.planted.truth import SLOW

if TYPE_CHECKING:
    import numpy.typing as npt

    from benchmarks.planted.falls import Pair
    from benchmarks.planted.truth import Truth
    from sim_backend.pixel import PixelModel
    from sim_backend.pixel.effects.base import Effect

    Floats = npt.NDArray[np.float64]

__all__ = ["nearest"]

#: Steps to the size that comes nearest, none of which changes it by more than a factor, until one changes it by a
#: small share.
_STEPS: Final = 8
_FACTOR: Final = 10.0
_THERE: Final = 0.2


def nearest(
    truth: Truth, model: PixelModel, planted: str, base: Pair, prior: Floats, apart: Pair
) -> tuple[str, PixelModel, float]:  # fmt: skip
    """Return the effect of the catalogue that leaves least of a difference, the model with it, and what it leaves.

    Slow ones are not asked.

    Parameters
    ----------
    model
        The truth without the planted effect.
    base, prior
        Changes by what else is free, and how well it is known before; see :func:`~benchmarks.planted.falls.fall`.
    apart
        (n,) each: the truth less the model.
    """
    known = [e for e in candidates(model, truth.bench.points) if e.id not in (planted, *SLOW)]
    found = {e.id: _with(e, truth, model, base, prior, apart) for e in known}
    best = min(found, key=lambda i: found[i][1])
    return best, *found[best]


def _with(
    effect: type[Effect], truth: Truth, model: PixelModel, base: Pair, prior: Floats, apart: Pair
) -> tuple[PixelModel, float]:  # fmt: skip
    """Return the model with an effect in the size in which it leaves least of the fall, and what that is.

    What it does is a straight line over a small range of sizes only: each leads to the next, until they agree. There
    the model with it is laid beside the truth itself, in the same sensors: what is the same light leaves nothing. An
    effect that goes one way only takes up nothing of what goes the other way.
    """
    alone = fall(apart, base, prior)
    more = np.append(prior, 0.0)
    one_way = switches(effect)[0].range[0] >= 0.0
    size = 1.0
    for _ in range(_STEPS):
        mimic = model + sized(effect, size)
        changes = beside(base, truth.changes(model, [mimic], [1.0]))
        share = float(taken_up(apart, changes, more)[-1])
        if share == 0.0 or (one_way and share < 0.0):
            break
        if abs(share - 1.0) < _THERE:
            left = fall(truth.apart(mimic), changes, more)
            return (mimic, left) if left < alone else (model, alone)
        size *= math.copysign(min(max(abs(share), 1.0 / _FACTOR), _FACTOR), share)
    return model, alone
