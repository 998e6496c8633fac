"""The way to the minimum, with little effort."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.looks import expect_roughly, look, loss_of, seen_by
from bench.diagnosis.steps import corrected, inside, longest_of, shown, step_from

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.diagnosis.problem import Problem, Slot
    from sim_backend.pixel.model import PixelModel

    Floats = npt.NDArray[np.float64]

__all__ = ["CHANCE", "SMALL", "Approach", "approach", "further", "losses_at"]

_LOG = logging.getLogger(__name__)

_ITERATIONS: Final = 16
#: The loss is known to about this. A fit has settled, as far as little effort tells, when a step lowers it by no
#: more, or by a small share.
CHANCE: Final = 30.0
_LITTLE: Final = 0.05
#: Parts of the longest step within which one is looked for; below the limit the fit ends.
_RADII: Final = (1.0, 0.3, 0.1)
_SHORTEST: Final = 0.02
#: After so many steps the changes by coordinate are simulated again.
_LOOKS: Final = 2
#: After the longest of them was the best, the next may be longer.
_GROWS: Final = 4.0
#: Changes by coordinate are first taken over so many steps, then over fewer: far away chance in them counts more.
_WIDE: Final = 4.0
_NARROWER: Final = 0.5
#: A fit ends when a step would lower the loss by less than this.
SMALL: Final = 1.0


@dataclass(frozen=True)
class Approach:
    """A model near the minimum, as far as little effort tells."""

    model: PixelModel
    slots: tuple[Slot, ...]
    at: Floats  #: (k,) coordinates
    start: Floats  #: (k,) of the prior
    loss: float
    seed: int
    seen: Floats  #: (k,) standard errors by which all statistics together move, by coordinate


def approach(
    problem: Problem, model: PixelModel, slots: Sequence[Slot], x: Sequence[float], *, seed: int,
    iterations: int = _ITERATIONS, span: float = _WIDE, prior: Floats | None = None,
) -> Approach:  # fmt: skip
    """Go near the minimum with little effort.

    Parameters
    ----------
    x
        Coordinates to start from.
    seed
        Of the simulations.
    iterations
        Steps at the most.
    span
        Changes by coordinate are first taken over so many steps: several where the start may be far off.
    prior
        Coordinates that are expected before; None: those to start from.
    """
    slots = tuple(slots)
    at = np.array(x, dtype=np.float64)
    start = at.copy() if prior is None else prior
    radius = 1.0
    here, jacobian = look(problem, model, slots, at, seed, span)
    now = loss_of(problem, here, slots, at, start)
    for step in range(iterations):
        deltas, gains = zip(
            *(
                step_from(problem, here, jacobian, slots, at, start, radius * part, hold=span > 1.0)
                for part in _RADII
            ),
            strict=True,
        )
        _LOG.debug("step %d, radius %.2g, loss %.5g, gain %.4g, at %s", step, radius, now, gains[0], shown(slots, at))
        if span <= 1.0 and gains[0] < SMALL:
            break
        tries = [inside(slots, at + delta) for delta in deltas]
        found = expect_roughly(problem, model, slots, tries, seed)
        losses = [loss_of(problem, e, slots, t, start) for e, t in zip(found, tries, strict=True)]
        best = int(np.argmin(losses))
        better = losses[best] < now
        radius = min(radius * (_GROWS if best == 0 else _RADII[best]), 1.0) if better else radius * _RADII[-1]
        span = max(span * _NARROWER, 1.0)
        settled = best == 0 and span <= 1.0 and 0.0 < now - losses[best] < max(CHANCE, _LITTLE * now)
        if better:
            there = found[best]
            jacobian = corrected(jacobian, tries[best] - at, there.value - here.value, longest_of(slots, at))
            at, now, here = tries[best], losses[best], there
        if radius < _SHORTEST or settled:
            break
        if step < iterations - 1 and (not better or step % _LOOKS == _LOOKS - 1):
            here, jacobian = look(problem, model, slots, at, seed, span)
    return Approach(model, slots, at, start, now, seed, seen_by(problem, here, jacobian))


def further(problem: Problem, near: Approach, iterations: int) -> Approach:
    """Go on."""
    return approach(
        problem, near.model, near.slots, list(near.at), seed=near.seed, iterations=iterations, span=1.0,
        prior=near.start,
    )  # fmt: skip


def losses_at(problem: Problem, near: Approach, places: Sequence[Floats], seed: int) -> list[float]:
    """Return the loss at some coordinates, with little effort."""
    found = expect_roughly(problem, near.model, near.slots, places, seed)
    return [loss_of(problem, e, near.slots, x, near.start) for e, x in zip(found, places, strict=True)]
