"""Effects in several sizes beside a fitted model, where lines from no effect do not tell what they do."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, NamedTuple

from bench.diagnosis.expected.catalogue import sized, switches
from bench.diagnosis.fitting import robust
from bench.diagnosis.fitting.fitted import whiten
from bench.diagnosis.fitting.looks import shifted

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bench.diagnosis.expected.problem import Problem
    from bench.diagnosis.fitting.fitted import Fit
    from sim_backend.pixel.effects.base import Effect

__all__ = ["Seen", "best_seen"]

#: Sizes beside that of the catalogue; and the effort for each.
_SIZES: Final = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0)
_EFFORT: Final = 0.06


class Seen(NamedTuple):
    """An effect in the size that explains most."""

    factor: float  #: beside the size of the catalogue
    fall: float  #: of the loss, beside that without the effect


def best_seen(problem: Problem, fit: Fit, effects: Sequence[type[Effect]], seed: int) -> list[Seen]:
    """Return for each effect the size that lowers the loss most, while all other numbers stay."""
    base = fit.models(problem)
    tried = [(number, factor) for number, effect in enumerate(effects) for factor in _factors(effect)]
    ones = [sized(effects[n], factor, problem.given.get(effects[n].id)) for n, factor in tried]
    models = [problem.of_points([m + one for m in base]) for one in ones]
    here, *there = (
        shifted(problem, problem.expect(sensors), fit.slots, fit.x)
        for sensors in problem.glance([base, *models], seed, _EFFORT)
    )
    # An effect that makes everything uncertain explains nothing: all are judged with the same standard errors.
    points, caution = problem.measured.points, math.sqrt(fit.caution)
    values = [e.value_or(here.value) for e in (here, *there)]
    left = [whiten(here.roots, problem.measured.value - value, points) / caution for value in values]
    alone, *losses = (robust.loss(residual) for residual in left)
    best = [Seen(1.0, 0.0)] * len(effects)
    for (number, factor), loss in zip(tried, losses, strict=True):
        if alone - loss > best[number].fall:
            best[number] = Seen(factor, alone - loss)
    return best


def _factors(effect: type[Effect]) -> tuple[float, ...]:
    signed = all(free.signed for free in switches(effect))
    return (*_SIZES, *(-f for f in _SIZES)) if signed else _SIZES
