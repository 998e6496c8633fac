"""How large a planted effect is, whatever a diagnosis says: the root of the expected fall of the deviance.

The expectation of the truth with the effect stands for the measurement, and that of the truth without it for the
model; the numbers of the base pixel and of other effects take up what they can, along the changes that they make.
Simulated expectations are uncertain, and the square of a difference would count that as size: the product of two
differences from sensors that have nothing in common does not. So it is with the changes: with chance in them they
would take up less than they do, and what is but a later clock would count as size. What is still uncertain is told by
how the two differences differ; an effect that does not stand out of it is made larger until it does, and the size
found goes down by as much: small effects are straight lines, as far as what was seen of them lets them be.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.catalogue import candidates, free_of, probe_of, switches
from bench.diagnosis.forward import engine_of
from bench.diagnosis.parameters import base_parameters, get, move, put
from bench.diagnosis.recording import Frame, Recording
from bench.diagnosis.residuals import expectation, measured
from bench.diagnosis.summary import add, summarise
from bench.diagnosis.views.registry import VIEWS
from bench.models.simulation import on_sensor, recording_seed, simulate_point
from benchmarks.planted.runs import ROI, SENSOR, planned_points
from protocols.points import Roi

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.diagnosis.parameters import Free
    from bench.diagnosis.residuals import Measured
    from bench.diagnosis.summary import Summary
    from bench.store.data import PointData
    from benchmarks.planted.cases import Case
    from sim_backend.pixel import PixelModel
    from sim_backend.pixel.effects.base import Effect

    Floats = npt.NDArray[np.float64]
    Pair = tuple[Floats, Floats]  #: of sets of sensors that have no random numbers in common

__all__ = ["Sizes", "fall", "sizes_of", "uncertainty"]

_STEP_S: Final = 2e-5
#: Two sets of so many sensors; sets share no random numbers, models within a set share all of them.
_SENSORS: Final = 3
_SETS: Final = 2
#: Sets of so many sensors from which the changes by the base numbers are known, and those by what mimics an effect.
_OTHER_SETS: Final = (2, 3)
_OTHERS: Final = 2
#: Straight lines lead no farther than this, in ln units, or in what is known of the clock.
_FARTHEST: Final = 4.0
#: Of a direction with a smaller share of what they do, changes are not known well enough to take up anything.
_NO_DIRECTION: Final = 3e-3
#: Events and stimulus are known to be no further apart than this.
_TIMING_US: Final = 10
#: An effect whose fall stands out by fewer standard errors is made larger, by this factor, so many times in all.
_CLEARLY: Final = 6.0
_LARGER, _LARGEST = 4.0, 256.0
#: Of two sizes the one of the smaller effect holds where they are more standard errors apart; changes by a number
#: count where they stand out by as many.
_BELIEVED: Final = 3.0
_SLOW: Final = frozenset({"high_pass"})
_QUARTER: Final = Roi(ROI.x, ROI.y, ROI.width // 2, ROI.height // 2)


@dataclass(frozen=True, slots=True)
class Sizes:
    """What is known of a case without a diagnosis."""

    size: dict[str, float]  #: of each planted effect, beside the others: standard errors
    mimic: str | None = None  #: effect of the catalogue that comes nearest, and
    beyond_mimic: float | None = None  #: what is left of the size then


class _Bench:
    """The points of a case, and what simulated sensors of models show there.

    What takes long is simulated in a quarter of the pixels, and sizes are made twice as large: they go with the root
    of the number of pixels.
    """

    def __init__(self, case: Case) -> None:
        slow = any(e.id in _SLOW or e.hooks() for e in case.model.effects)
        self.points: list[PointData] = planned_points(case)
        if slow:
            self.points = [replace(p, roi=_QUARTER) for p in self.points]
        self.scale = 2.0 if slow else 1.0
        self._seed = case.seed
        self._engine = engine_of(_STEP_S)

    def see(self, model: PixelModel, of_set: int, sensors: int, late_us: int = 0) -> list[list[Summary]]:
        """Return what each point shows, for each sensor of a set, when all events come somewhat late."""
        return [[self._look(p, model, of_set, sensor, late_us) for p in self.points] for sensor in range(sensors)]

    def _look(self, point: PointData, model: PixelModel, of_set: int, sensor: int, late_us: int) -> Summary:
        pixels = recording_seed(self._seed + of_set, sensor, 0)
        noise = recording_seed(self._seed + of_set, sensor, 1 + point.index)
        events = simulate_point(point, on_sensor(model, SENSOR), self._engine, sensor_seed=pixels, seed=noise)
        return summarise(Recording(Frame(point), (_later(e, late_us) for e in events)), VIEWS)


def _believed(first: Floats, second: Floats) -> Pair:
    """Return changes, without those by numbers of which nothing shows that stands out of chance.

    It would be in need of long ways to take anything up, and would seem to take up much.
    """
    seen = [a @ b > _BELIEVED * uncertainty(a, b) for a, b in zip(first.T, second.T, strict=True)]
    return first * seen, second * seen


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
        self._known: dict[tuple[PixelModel, int], Floats] = {}

    def value(self, sensors: Sequence[Sequence[Summary]]) -> Floats:
        """Return the expected statistics."""
        return expectation(self.of, [add(c) for c in zip(*sensors, strict=True)]).value

    def whiten(self, values: Floats) -> Floats:
        """Return independent numbers of unit variance."""
        parts = [root @ values[where] for root, where in zip(self._roots, self.of.points, strict=True)]
        return np.concatenate(parts)

    def apart(self, model: PixelModel, truth: PixelModel | None = None, late_us: int = 0) -> Pair:
        """Return the truth, or another one in its place, less a model whose events come somewhat late."""
        first, second = (
            self.whiten((mine if truth is None else self._seen(truth, s)) - self._seen(model, s, late_us))
            for s, mine in enumerate(self._values)
        )
        return first, second

    def _seen(self, model: PixelModel, of_set: int, late_us: int = 0) -> Floats:
        return self.value(self.bench.see(model, of_set, _SENSORS, late_us))

    def changes(self, model: PixelModel, others: Sequence[PixelModel], steps: Sequence[float]) -> Pair:
        """(n, k) change from a model to each of the others, by unit of its step, from each of two sets."""
        return _believed(*(self._changes(model, others, steps, s) for s in _OTHER_SETS))

    def _changes(
        self, model: PixelModel, others: Sequence[PixelModel], steps: Sequence[float], of_set: int
    ) -> Floats:  # fmt: skip
        here = self._here(model, of_set)
        columns = [
            self.whiten(self.value(self.bench.see(one, of_set, _OTHERS)) - here) / step
            for one, step in zip(others, steps, strict=True)
        ]
        return np.stack(columns, axis=1)

    def delayed(self, model: PixelModel) -> Pair:
        """(n, 1) change when all events come as late as the clocks may be apart, from each of two sets."""
        return _believed(*(self._delayed(model, s)[:, None] for s in _OTHER_SETS))

    def _delayed(self, model: PixelModel, of_set: int) -> Floats:
        late = self.value(self.bench.see(model, of_set, _OTHERS, _TIMING_US))
        return self.whiten(late - self._here(model, of_set))

    def _here(self, model: PixelModel, of_set: int) -> Floats:
        """Return what is expected of a model; many are laid beside the same one."""
        if (model, of_set) not in self._known:
            self._known[model, of_set] = self.value(self.bench.see(model, of_set, _OTHERS))
        return self._known[model, of_set]


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
    truth: _Truth, rest: PixelModel, effect: Effect | None, apart: Pair, base: Pair, prior: Floats
) -> float:  # fmt: skip
    """Return the root of the fall, of an effect that is large enough to tell, by how much larger that is.

    Some effects set in beyond a size, and some are taken up by base numbers that are known as long as they are small:
    where that says clearly more than what was seen of a smaller one, the smaller one is right.
    """
    factor, larger, seen = 1.0, None, []
    while True:
        found, doubt = _left(truth, rest, None if larger is None else rest + larger, apart, base, prior)
        if found >= _CLEARLY * doubt or effect is None or factor >= _LARGEST:
            break
        larger = _larger(effect, factor * _LARGER)
        if larger is None:
            break
        seen.append((found, doubt, factor))
        factor *= _LARGER
        apart = truth.apart(rest, rest + larger)
    size = _root(found) / factor
    for smaller, doubt, at in reversed(seen):
        if (size * at) ** 2 > smaller + _BELIEVED * doubt:
            size = _root(smaller + doubt) / at
    return size


def _left(
    truth: _Truth, rest: PixelModel, other: PixelModel | None, apart: Pair, base: Pair, prior: Floats
) -> tuple[float, float]:  # fmt: skip
    """Return the fall of the deviance, and its standard error: the base numbers take up what they can.

    Straight lines lead near to where they do; from there they lead on, if the truth has come closer.
    """
    if not base[0].shape[1]:
        return fall(apart, base, prior), uncertainty(*apart)
    moved = np.clip(taken_up(apart, base, prior), -_FARTHEST, _FARTHEST)
    late_us = round(_TIMING_US * moved[-1])
    moved[-1] = late_us / _TIMING_US
    numbers = _numbers(rest)
    places = [
        min(max(free.coordinate(get(rest, free)) + by, free.range[0]), free.range[1])
        for free, by in zip(numbers, moved[:-1], strict=True)
    ]
    closer = truth.apart(put(rest, numbers, places), other, late_us)
    if closer[0] @ closer[1] + prior @ moved**2 > apart[0] @ apart[1]:
        return fall(apart, base, prior), uncertainty(*apart)
    return fall(closer, base, prior, moved), uncertainty(*closer)


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


def fall(apart: Pair, changes: Pair, prior: Floats, moved: Floats | None = None) -> float:
    """Return the product of two differences beyond what least squares takes up along some changes.

    Parameters
    ----------
    apart
        (n,) whitened, with independent errors.
    changes
        (n, k) whitened, by each number that is free, with errors that are independent of each other and of those.
    prior
        (k,) precision with which each of them is known before.
    moved
        (k,) by how much each is elsewhere than where it is known to be.
    """
    moved = np.zeros(len(prior)) if moved is None else moved
    right = _along(apart, changes) - prior * moved
    before = apart[0] @ apart[1] + prior @ moved**2
    return float(before - right @ taken_up(apart, changes, prior, moved))


def taken_up(apart: Pair, changes: Pair, prior: Floats, moved: Floats | float = 0.0) -> Floats:
    """Return (k,) how much of each change explains most of a difference; see :func:`fall`."""
    first, second = changes
    left = first.T @ second
    left = 0.5 * (left + left.T) + np.diag(prior)
    scale = np.sqrt(np.maximum(np.diag(left), 0.0))
    unit = np.divide(1.0, scale, out=np.zeros_like(scale), where=scale > 0.0)
    values, vectors = np.linalg.eigh(left * np.outer(unit, unit))
    kept = values > _NO_DIRECTION
    inverse = (vectors[:, kept] / values[kept]) @ vectors[:, kept].T
    return np.asarray(unit * (inverse @ (unit * (_along(apart, changes) - prior * moved))))


def _along(apart: Pair, changes: Pair) -> Floats:
    return np.asarray(0.5 * (changes[0].T @ apart[1] + changes[1].T @ apart[0]))


def _root(square: float) -> float:
    return math.sqrt(max(square, 0.0))


def _numbers(model: PixelModel) -> list[Free]:
    """Return the numbers of a model that are free; those of its other effects take up what they can, too."""
    effects = [free for effect in model.effects for free in free_of(type(effect))]
    return [*base_parameters(refractory_known=True), *effects]


def _base_changes(truth: _Truth, model: PixelModel) -> tuple[Pair, Floats]:
    """Return the changes by the numbers of a model and the clock, and how well these are known before."""
    moved, steps, prior = [], [], []
    for free in _numbers(model):
        at = free.coordinate(get(model, free))
        to = move(free, at)
        moved.append(put(model, [free], [to]))
        steps.append(to - at)
        prior.append(0.0 if math.isinf(free.prior_sd) else free.prior_sd**-2)
    changes = _beside(truth.changes(model, moved, steps), truth.delayed(model))
    return changes, np.array([*prior, 1.0])


def _beside(some: Pair, others: Pair) -> Pair:
    first, second = (np.concatenate(both, axis=1) for both in zip(some, others, strict=True))
    return first, second


def _nearest(
    truth: _Truth, model: PixelModel, planted: str, base: Pair, prior: Floats, apart: Pair
) -> tuple[str, float]:  # fmt: skip
    """Return the effect of the catalogue that leaves least of the difference, and how much that is.

    Slow ones are not asked. An effect that goes one way only takes up nothing of what goes the other way.
    """
    known = [e for e in candidates(model, truth.bench.points) if e.id not in (planted, *_SLOW)]
    alone = fall(apart, base, prior)
    left: dict[str, float] = {}
    for cls in known:
        changes = _beside(base, truth.changes(model, [model + probe_of(cls)], [1.0]))
        more = np.append(prior, 0.0)
        against = switches(cls)[0].range[0] >= 0.0 and taken_up(apart, changes, more)[-1] < 0.0
        left[cls.id] = _root(alone if against else fall(apart, changes, more))
    best = min(left, key=lambda i: left[i])
    return best, truth.bench.scale * left[best]
