"""What a model expects of a run at some coordinates, and how that changes by coordinate."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis import robust
from bench.diagnosis.fitted import prior_precision, whiten
from bench.diagnosis.parameters import ALIGNMENT, move

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.diagnosis.problem import Problem, Slot
    from bench.diagnosis.residuals import Expectation
    from sim_backend.pixel.model import PixelModel

    Floats = npt.NDArray[np.float64]

__all__ = ["expect_roughly", "later", "look", "loss_of", "seen_by", "shifted"]

#: Effort of one expectation on the way to the minimum, and near it.
_ROUGH: Final = 0.15
_SHARP: Final = 0.4


def look(
    problem: Problem, model: PixelModel, slots: Sequence[Slot], at: Floats, seed: int, span: float,
    widest: Floats | None = None,
) -> tuple[Expectation, Floats]:  # fmt: skip
    """Return what is expected at these coordinates, and (2, n, k) how that changes, from each of two sensors.

    `span` is the difference between coordinates over which a change is taken, in usual steps. With `widest`, (k,)
    the largest such differences, it is a sharp look: to both sides, with more effort.
    """
    sharp = widest is not None
    simulated = [i for i, slot in enumerate(slots) if slot.free.owner != ALIGNMENT]
    ends = []
    for i in simulated:
        to = at.copy()
        to[i] = move(slots[i].free, at[i], span)
        if widest is not None:
            to[i] = at[i] + min(max(to[i] - at[i], -widest[i]), widest[i])
        opposite = at.copy()
        opposite[i] = max(2.0 * at[i] - to[i], slots[i].free.range[0]) if sharp else at[i]
        ends.append((opposite, to))
    places = [at, *(to for _, to in ends), *(back for back, _ in ends if sharp)]
    found = problem.simulate([problem.models(model, slots, x) for x in places], seed, _SHARP if sharp else _ROUGH)
    here = shifted(problem, problem.expect(found[0]), slots, at)
    out = np.zeros((2, len(here.value), len(slots)))
    for i, slot in enumerate(slots):
        if slot.free.owner == ALIGNMENT:
            out[:, :, i] = later(problem, here)
    above = found[1 : 1 + len(ends)]
    below = found[1 + len(ends) :] if sharp else [found[0]] * len(ends)
    for half in range(2):
        for i, up, down, (back, to) in zip(simulated, above, below, ends, strict=True):
            apart = problem.expect(up[half::2]).value - problem.expect(down[half::2]).value
            out[half, :, i] = apart / (to[i] - back[i])
    return here, out


def later(problem: Problem, here: Expectation) -> Floats:
    """Return the changes when all events come later than the stimulus says, by second: latencies are longer."""
    change = np.zeros(len(here.value))
    for i, label in enumerate(problem.measured.labels):
        if label.view == "latency" and np.isfinite(here.ratio[i]):
            change[i] = math.exp(-here.ratio[i])
            last = change[i]
        elif label.view == "latency_spread" and np.isfinite(here.ratio[i]):
            change[i] = -2.0 * here.ratio[i] * last
    return change


def expect_roughly(
    problem: Problem, model: PixelModel, slots: Sequence[Slot], xs: Sequence[Floats], seed: int
) -> list[Expectation]:
    """Return what is expected at some coordinates, with little effort and the same random numbers."""
    found = problem.simulate([problem.models(model, slots, x) for x in xs], seed, _ROUGH)
    return [shifted(problem, problem.expect(sensors), slots, x) for sensors, x in zip(found, xs, strict=True)]


def shifted(problem: Problem, here: Expectation, slots: Sequence[Slot], x: Floats) -> Expectation:
    """Return what is expected when the events come later by the time offset among the coordinates."""
    late: float = sum(c for slot, c in zip(slots, x, strict=True) if slot.free.owner == ALIGNMENT)
    return replace(here, value=here.value + late * later(problem, here)) if late else here


def loss_of(problem: Problem, here: Expectation, slots: Sequence[Slot], at: Floats, start: Floats) -> float:
    """Return the loss of the independent residuals, and what the prior adds."""
    residual = whiten(here.roots, problem.measured.value - here.value, problem.measured.points)
    return robust.loss(residual) + float(np.sum(prior_precision(slots) * (at - start) ** 2))


def seen_by(problem: Problem, here: Expectation, jacobian: Floats) -> Floats:
    """(k,) standard errors by which all statistics together move, by coordinate; chance counts for nothing."""
    first, second = (whiten(here.roots, half, problem.measured.points) for half in jacobian)
    return np.asarray(np.sqrt(np.maximum(np.sum(first * second, axis=0), 0.0)))
