"""Which effects of the catalogue come nearest to one from outside it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.expected.catalogue import candidates, sized, switches
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

#: So many are told.
_NEAREST: Final = 3
#: Steps to the size that comes nearest, none of which changes it by more than a factor, until one changes it by a
#: small share.
_STEPS: Final = 8
_FACTOR: Final = 10.0
_THERE: Final = 0.2


def nearest(
    truth: Truth, model: PixelModel, planted: str, base: Pair, prior: Floats, apart: Pair
) -> dict[str, PixelModel]:  # fmt: skip
    """Return the effects of the catalogue that leave least of a difference, if any leaves less, and models with them.

    Along straight lines, and as far as chance lets it be told: so they are more than one. Slow ones are not asked.

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
    alone = fall(apart, base, prior)
    nearer = {i: left for i, (_, left) in found.items() if left < alone}
    return {i: found[i][0] for i in sorted(nearer, key=lambda i: nearer[i])[:_NEAREST]}


def _with(
    effect: type[Effect], truth: Truth, model: PixelModel, base: Pair, prior: Floats, apart: Pair
) -> tuple[PixelModel, float]:  # fmt: skip
    """Return the model with an effect in the size in which it leaves least of the fall, and what that is.

    What it does is a straight line over a small range of sizes only: each leads to the next, until they agree, or
    until it is too small to be seen. There the model with it is laid beside the truth itself, in the same sensors:
    what is the same light leaves nothing. An effect that goes one way only takes up nothing of what goes the other
    way.
    """
    more = np.append(prior, 0.0)
    one_way = switches(effect)[0].range[0] >= 0.0
    size, seen = 1.0, False
    for _ in range(_STEPS):
        mimic = model + sized(effect, size)
        changes = beside(base, truth.changes(model, [mimic], [1.0]))
        share = float(taken_up(apart, changes, more)[-1])
        if share == 0.0 and not seen and sized(effect, _FACTOR * size) != sized(effect, size):
            size *= _FACTOR  # it does too little to be seen
            continue
        if (share == 0.0 and not seen) or (one_way and share < 0.0):
            break
        if share == 0.0 or abs(share - 1.0) < _THERE:
            return mimic, fall(truth.apart(mimic), changes, more)
        seen = True
        size *= math.copysign(min(max(abs(share), 1.0 / _FACTOR), _FACTOR), share)
    return model, fall(apart, base, prior)
