"""One step towards the minimum: the best one where all changes are linear, and no longer than that holds."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.expected.parameters import ALIGNMENT
from bench.diagnosis.fitting import robust
from bench.diagnosis.fitting.fitted import prior_precision, whiten

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.diagnosis.expected.problem import Problem, Slot
    from bench.diagnosis.expected.residuals import Expectation

    Floats = npt.NDArray[np.float64]

__all__ = ["inside", "longest_of", "shown", "step_from", "with_coordinate"]

#: No step is longer than this: in ln units for a threshold, and for other numbers of the base pixel.
_LONGEST_THRESHOLD: Final = 0.3
_LONGEST_BASE: Final = 0.7
#: and for the time offset, in the standard deviation that is expected of it.
_LONGEST_OFFSET: Final = 4.0


def step_from(
    problem: Problem, here: Expectation, jacobian: Floats, slots: Sequence[Slot], at: Floats, start: Floats,
    radius: float,
) -> tuple[Floats, float]:  # fmt: skip
    """Return the step that lowers the loss most where all changes are linear, and by how much; not a long one.

    Chance in the changes would make them look larger, and the step shorter, than they are; what two sensors differ by
    tells how much of it there is. Half of that is taken off: all of it might leave next to nothing, and a step to
    anywhere.
    """
    points, roots = problem.measured.points, here.roots
    longest = radius * longest_of(slots, at)
    differ = math.sqrt(0.125) * whiten(roots, jacobian[0] - jacobian[1], points)
    low, high = (np.array([s.free.range[end] for s in slots]) for end in (0, 1))
    delta, gain = robust.solve(
        whiten(roots, jacobian.mean(axis=0), points),
        whiten(roots, problem.measured.value - here.value, points),
        prior_precision(slots),
        start - at,
        np.maximum(low - at, -longest),
        np.minimum(high - at, longest),
        chance=lambda w: differ.T @ (w[:, None] * differ),
    )
    return delta, gain


def longest_of(slots: Sequence[Slot], at: Floats) -> Floats:
    """(k,) how far each coordinate may go from here before straight lines say nothing."""
    return np.array([_longest(s, a) for s, a in zip(slots, at, strict=True)])


def _longest(slot: Slot, at: float) -> float:
    free = slot.free
    if free.owner == ALIGNMENT:
        return _LONGEST_OFFSET * free.prior_sd
    if not free.effect:
        return _LONGEST_THRESHOLD if free.owner == "thresholds" else _LONGEST_BASE
    if free.scale == "log":
        return 1.0
    probe = abs(free.coordinate(free.probe))
    return max(abs(at), probe)


def inside(slots: Sequence[Slot], x: Floats) -> Floats:
    """Return the coordinates, none beyond its bounds."""
    return np.array([min(max(c, s.free.range[0]), s.free.range[1]) for s, c in zip(slots, x, strict=True)])


def with_coordinate(x: Floats, i: int, value: float) -> Floats:
    """Return the coordinates with another one at a place."""
    to = x.copy()
    to[i] = value
    return to


def shown(slots: Sequence[Slot], at: Floats) -> str:
    """Return the numbers at some coordinates, for the log."""
    return " ".join(f"{s.free.name}={s.free.value(x):.5g}" for s, x in zip(slots, at, strict=True))
