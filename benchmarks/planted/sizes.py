"""How large a planted effect is, before anything is diagnosed: the root of the expected fall of the deviance.

The expectation of the truth with the effect stands for the measurement, and that of the truth without it for the
model; the base pixel's numbers take up what they can, along the changes that they make. Simulated expectations are
uncertain, and the square of a difference would count that as size: the product of two differences from sensors that
have nothing in common does not. What is still uncertain is told by how the two differ; an effect that does not stand
out of it is made larger until it does, and the size found goes down by as much: small effects are straight lines, as
far as what was seen of them lets them be.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.catalogue import candidates, probe_of, switches
from bench.diagnosis.parameters import base_parameters, get, move, put
from bench.diagnosis.recording import Frame, Recording
from bench.diagnosis.residuals import expectation, measured
from bench.diagnosis.summary import add, summarise
from bench.diagnosis.views.registry import VIEWS
from bench.models.simulation import on_sensor, recording_seed, simulate_point
from benchmarks.planted.runs import ROI, SENSOR, planned_points
from protocols.points import Roi
from sim_backend.pixel import FastEngine

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.diagnosis.residuals import Measured
    from bench.diagnosis.summary import Summary
    from bench.store.data import PointData
    from benchmarks.planted.cases import Case
    from sim_backend.pixel import PixelModel
    from sim_backend.pixel.effects.base import Effect

    Floats = npt.NDArray[np.float64]

__all__ = ["Sizes", "fall", "sizes_of", "uncertainty"]

_STEP_S: Final = 2e-5
#: Two sets of so many sensors; sets share no random numbers, models within a set share all of them.
_SENSORS: Final = 3
_SETS: Final = 2
#: Sensors of the set from which the changes by the base numbers are known, and those by what mimics an effect.
_OTHERS: Final = 2
#: Events and stimulus are known to be no further apart than this.
_TIMING_US: Final = 10
#: An effect whose fall stands out by fewer standard errors is made larger, by this factor, so many times in all.
_CLEARLY: Final = 6.0
_LARGER, _LARGEST = 4.0, 256.0
_BELIEVED: Final = 3.0  # standard errors that may be missing of a fall
_SLOW: Final = frozenset({"high_pass"})
_QUARTER: Final = Roi(ROI.x, ROI.y, ROI.width // 2, ROI.height // 2)


@dataclass(frozen=True, slots=True)
class Sizes:
    """What is known of a case before its diagnosis."""

    size: dict[str, float]  #: of each planted effect, beside the others: standard errors
    mimic: str | None = None  #: effect of the catalogue that comes nearest, and
    beyond_mimic: float | None = None  #: what is left of the size then


class _Bench:
    """The points of a case, and what simulated sensors of models show there.

    What only the reference engine knows is simulated in a quarter of the pixels, and sizes are made twice as large:
    they go with the root of the number of pixels.
    """

    def __init__(self, case: Case) -> None:
        slow = any(e.id in _SLOW or e.hooks() for e in case.model.effects)
        self.points: list[PointData] = planned_points(case)
        if slow:
            self.points = [replace(p, roi=_QUARTER) for p in self.points]
        self.scale = 2.0 if slow else 1.0
        self._seed = case.seed
        self._engine = FastEngine(_STEP_S, threads=1)

    def see(self, model: PixelModel, of_set: int, sensors: int, late_us: int = 0) -> list[list[Summary]]:
        """Return what each point shows, for each sensor of a set, when all events come somewhat late."""
        return [[self._look(p, model, of_set, sensor, late_us) for p in self.points] for sensor in range(sensors)]

    def _look(self, point: PointData, model: PixelModel, of_set: int, sensor: int, late_us: int) -> Summary:
        pixels = recording_seed(self._seed + of_set, sensor, 0)
        noise = recording_seed(self._seed + of_set, sensor, 1 + point.index)
        events = simulate_point(point, on_sensor(model, SENSOR), self._engine, sensor_seed=pixels, seed=noise)
        return summarise(Recording(Frame(point), (_later(e, late_us) for e in events)), VIEWS)


def _later(events: npt.NDArray[np.void], late_us: int) -> npt.NDArray[np.void]:
    moved = events.copy()
    moved["t"] += late_us
    return moved


class _Truth:
    """What is expected of the truth of a case, and how unlike others are."""

    def __init__(self, case: Case, model: PixelModel) -> None:
        self.bench = _Bench(case)
        seen = [self.bench.see(model, s, _SENSORS) for s in range(_SETS)]
        self.of: Measured = measured(seen[0][0])
        every = expectation(self.of, [add(c) for c in zip(*seen[0], *seen[1], strict=True)])
        more = math.sqrt(1.0 + 1.0 / every.recordings)
        self._roots = [root * more for root in every.roots]
        self._values = [self.value(one) for one in seen]

    def value(self, sensors: Sequence[Sequence[Summary]]) -> Floats:
        """Return the expected statistics."""
        return expectation(self.of, [add(c) for c in zip(*sensors, strict=True)]).value

    def whiten(self, values: Floats) -> Floats:
        """Return independent numbers of unit variance."""
        parts = [root @ values[where] for root, where in zip(self._roots, self.of.points, strict=True)]
        return np.concatenate(parts)

    def apart(self, model: PixelModel, truth: PixelModel | None = None) -> tuple[Floats, Floats]:
        """Return the truth, or another one in its place, less a model, from each set."""
        first, second = (
            self.whiten((mine if truth is None else self._seen(truth, s)) - self._seen(model, s))
            for s, mine in enumerate(self._values)
        )
        return first, second

    def _seen(self, model: PixelModel, of_set: int) -> Floats:
        return self.value(self.bench.see(model, of_set, _SENSORS))

    def changes(self, model: PixelModel, others: Sequence[PixelModel], steps: Sequence[float]) -> Floats:
        """(n, k) change from a model to each of the others, by unit of its step."""
        here = self.value(self.bench.see(model, _SETS, _OTHERS))
        columns = [
            self.whiten(self.value(self.bench.see(one, _SETS, _OTHERS)) - here) / step
            for one, step in zip(others, steps, strict=True)
        ]
        return np.stack(columns, axis=1)

    def delayed(self, model: PixelModel) -> Floats:
        """(n, 1) change when all events come as late as the clocks may be apart."""
        here = self.value(self.bench.see(model, _SETS, _OTHERS))
        return self.whiten(self.value(self.bench.see(model, _SETS, _OTHERS, _TIMING_US)) - here)[:, None]


def sizes_of(case: Case, *, mimics: bool = False) -> Sizes:
    """Return the size of each planted effect.

    Parameters
    ----------
    mimics
        Whether to look for the effect of the catalogue that comes nearest, for a case with one effect.
    """
    if not case.planted:
        return Sizes({})
    truth = _Truth(case, case.model)
    size: dict[str, float] = {}
    nearest: tuple[str | None, float | None] = None, None
    for effect_id in case.planted:
        rest = case.model.without(effect_id)
        apart = truth.apart(rest)
        base, prior = _base_changes(truth, rest)
        size[effect_id] = truth.bench.scale * _size(truth, rest, case.model.effect(effect_id), apart, base, prior)
        if mimics:
            nearest = _nearest(truth, rest, effect_id, base, prior, apart)
    return Sizes(size, *nearest)


def _size(
    truth: _Truth, rest: PixelModel, effect: Effect | None, apart: tuple[Floats, Floats], base: Floats, prior: Floats
) -> float:  # fmt: skip
    """Return the root of the fall, of an effect that is large enough to tell, by how much larger that is.

    Some effects set in beyond a size, and are nothing below: none is larger than what was seen of it lets be.
    """
    factor, most = 1.0, math.inf
    while True:
        found, doubt = fall(*apart, base, prior), uncertainty(*apart)
        if found >= _CLEARLY * doubt or effect is None or factor >= _LARGEST:
            break
        most = min(most, _root(found + _BELIEVED * doubt) / factor)
        larger = _larger(effect, factor * _LARGER)
        if larger is None:
            break
        factor *= _LARGER
        apart = truth.apart(rest, rest + larger)
    return min(_root(found) / factor, most)


def _larger(effect: Effect, factor: float) -> Effect | None:
    """Return the effect at so many times the coordinates that switch it on; None: that is out of bounds."""
    values = {}
    for free in switches(type(effect)):
        at = factor * free.coordinate(getattr(effect, free.field))
        if not free.range[0] <= at <= free.range[1]:
            return None
        values[free.field] = free.value(at)
    return replace(effect, **values) if values else None  # type: ignore[type-var]


def uncertainty(first: Floats, second: Floats) -> float:
    """Return the standard error of the product of two differences, from how the two differ."""
    chance = 0.5 * float(np.mean((first - second) ** 2))
    mean = 0.5 * (first + second)
    return math.sqrt(2.0 * chance * float(mean @ mean) + len(first) * chance**2)


def fall(first: Floats, second: Floats, columns: Floats, prior: Floats) -> float:
    """Return the product of two differences beyond what least squares takes up along some columns.

    Parameters
    ----------
    first, second
        (n,) whitened, with independent errors.
    columns
        (n, k) whitened change by each number that is free.
    prior
        (k,) precision with which each of them is known before.
    """
    if columns.shape[1] == 0:
        return float(first @ second)
    left = columns.T @ columns + np.diag(prior)
    taken = np.linalg.lstsq(left, columns.T @ second, rcond=1e-10)[0]
    return float(first @ second - (first @ columns) @ taken)


def _root(square: float) -> float:
    return math.sqrt(max(square, 0.0))


def _base_changes(truth: _Truth, model: PixelModel) -> tuple[Floats, Floats]:
    """Return the changes by the base pixel's numbers and the clock, and how well these are known before."""
    moved, steps, prior = [], [], []
    for free in base_parameters(refractory_known=True):
        at = free.coordinate(get(model, free))
        to = move(free, at)
        moved.append(put(model, [free], [to]))
        steps.append(to - at)
        prior.append(0.0 if math.isinf(free.prior_sd) else free.prior_sd**-2)
    columns = np.concatenate([truth.changes(model, moved, steps), truth.delayed(model)], axis=1)
    return columns, np.array([*prior, 1.0])


def _nearest(
    truth: _Truth, model: PixelModel, planted: str, base: Floats, prior: Floats, apart: tuple[Floats, Floats]
) -> tuple[str, float]:  # fmt: skip
    """Return the effect of the catalogue that leaves least of the difference, and how much that is.

    Slow ones are not asked.
    """
    known = [e for e in candidates(model, truth.bench.points) if e.id not in (planted, *_SLOW)]
    left: dict[str, float] = {}
    for cls in known:
        column = truth.changes(model, [model + probe_of(cls)], [1.0])
        rest = fall(*apart, np.concatenate([base, column], axis=1), np.append(prior, 0.0))
        if switches(cls)[0].range[0] >= 0.0 and not _is_along(column[:, 0], apart, base, prior):
            rest = fall(*apart, base, prior)
        left[cls.id] = _root(rest)
    best = min(left, key=lambda i: left[i])
    return best, truth.bench.scale * left[best]


def _is_along(column: Floats, apart: tuple[Floats, Floats], base: Floats, prior: Floats) -> bool:
    """Return whether the difference has the direction of a change that goes one way only."""
    return fall(0.5 * (apart[0] + apart[1]), column, base, prior) > 0.0
