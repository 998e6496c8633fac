"""What a model expects of a run at some coordinates, and how far off that is."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.expected.catalogue import DELAYS
from bench.diagnosis.expected.parameters import ALIGNMENT
from bench.diagnosis.fitting import robust
from bench.diagnosis.fitting.fitted import prior_precision, whiten

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.diagnosis.expected.parameters import Free
    from bench.diagnosis.expected.problem import Problem, Slot
    from bench.diagnosis.expected.residuals import Expectation
    from bench.diagnosis.fitting.fitted import Fit
    from sim_backend.pixel.model import PixelModel

    Floats = npt.NDArray[np.float64]

__all__ = ["delays", "expect_roughly", "later", "loss_of", "loss_of_fit", "shifted"]

#: Effort of one expectation on the way to the minimum.
_ROUGH: Final = 0.06


def delays(free: Free) -> bool:
    """Return whether a number makes all events later by itself: what latencies do is known, see :func:`later`."""
    return free.owner == ALIGNMENT or (free.owner, free.name) in DELAYS


def later(problem: Problem, here: Expectation | Fit) -> Floats:
    """Return the changes when all events come later than the stimulus says, by second: latencies are longer."""
    change = np.zeros(len(here.value))
    known = [(i, label) for i, label in enumerate(problem.measured.labels) if np.isfinite(here.ratio[i])]
    spread = {label.group: float(here.ratio[i]) for i, label in known if label.view == "latency_spread"}
    # The mean of 1 / t where ln t is normal; a step from one latency to the next has twice its variance.
    inverse = {
        label.group: math.exp(-here.ratio[i] + 0.25 * spread.get(label.group, 0.0))
        for i, label in known if label.view == "latency"
    }  # fmt: skip
    for i, label in known:
        if label.view == "latency":
            change[i] = inverse[label.group]
        elif label.view == "latency_spread":
            change[i] = -2.0 * spread[label.group] * inverse.get(label.group, 0.0)
    return change


def expect_roughly(
    problem: Problem, model: PixelModel, slots: Sequence[Slot], xs: Sequence[Floats], seed: int
) -> list[Expectation]:
    """Return what is expected at some coordinates, with little effort and the same random numbers."""
    found = problem.glance([problem.models(model, slots, x) for x in xs], seed, _ROUGH)
    return [shifted(problem, problem.expect(sensors), slots, x) for sensors, x in zip(found, xs, strict=True)]


def shifted(problem: Problem, here: Expectation, slots: Sequence[Slot], x: Floats) -> Expectation:
    """Return what is expected when the events come later by the time offset among the coordinates.

    By as much of it as is known they were simulated later; the small rest is a straight line.
    """
    late: float = sum(c for slot, c in zip(slots, x, strict=True) if slot.free.owner == ALIGNMENT)
    late -= 1e-6 * problem.forward.late_us
    return replace(here, value=here.value + late * later(problem, here)) if late else here


def loss_of(problem: Problem, here: Expectation, slots: Sequence[Slot], at: Floats, start: Floats) -> float:
    """Return the loss of the independent residuals, and what the prior adds."""
    return _loss(problem, here.roots, here.value, slots, at - start)


def loss_of_fit(problem: Problem, one: Fit) -> float:
    """Return the loss of a fit, as that of a place on the way there."""
    return _loss(problem, one.roots, one.value, one.slots, one.x - one.start)


def _loss(
    problem: Problem, roots: Sequence[Floats], value: Floats, slots: Sequence[Slot], away: Floats
) -> float:  # fmt: skip
    residual = whiten(roots, problem.measured.value - value, problem.measured.points)
    return robust.loss(residual) + float(np.sum(prior_precision(slots) * away**2))
