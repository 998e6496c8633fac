"""What an effect of some size does to all statistics, of a size at which that can be told.

Too small an effect drowns in the chance of the simulation; what a gross one does is no straight line. So it is first
found out how well each is seen; then it is probed at the size that would explain what is left, or that is just well
seen.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.catalogue import probe_of, switches
from bench.diagnosis.judging import deviance, freedom

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import numpy.typing as npt

    from bench.diagnosis.fitted import Fit
    from bench.diagnosis.parameters import Free
    from bench.diagnosis.problem import Problem
    from sim_backend.pixel.effects.base import Effect

    Floats = npt.NDArray[np.float64]

__all__ = ["Probe", "Probed", "closer", "probes_at", "reliable", "sizes_for", "visible"]

#: Size, beside that of the catalogue, at which it is found out how well an effect is seen, and the effort.
_FIRST: Final = 0.25
_FIRST_EFFORT: Final = 0.1
#: A probe that moves all statistics by more than this is tried again at a share of its size, so often at the most; no
#: statistic counts for more standard errors than the limit.
_GROSS: Final = 60.0
_SMALLER: Final = 0.15
_TRIALS: Final = 4
_MOST: Final = 5.0
#: Standard errors by which a probe moves all statistics, at the least; sizes beside those of the catalogue.
_WELL_SEEN: Final = 25.0
_SMALLEST: Final = 1e-4
_LARGEST: Final = 4.0

#: Of each number that switches an effect on: standard errors by which the size of the catalogue moves all statistics.
Probed = dict[tuple[str, str], float]


@dataclass(frozen=True)
class Probe:
    """An effect at some size, and what it does to all statistics."""

    effect: type[Effect]
    free: tuple[Free, ...]  #: the numbers that switch it on, each probed by itself
    at: tuple[float, ...]  #: coordinate of each
    change: Floats  #: (2, n, k) whitened change of the statistics for each, from two sensors


def visible(problem: Problem, fit: Fit, effects: Sequence[type[Effect]], seed: int) -> Probed:
    """Return how well each number of some effects is seen: from ever smaller probes, until they are not gross."""
    found: Probed = {}
    left, factor = list(effects), _FIRST
    for _ in range(_TRIALS):
        wanted = [(e, [(factor,) * len(switches(e))]) for e in left]
        probes = [several[0] for several in probes_at(problem, fit, wanted, seed, _FIRST_EFFORT)]
        gross = set()
        for one in probes:
            for i, free in enumerate(one.free):
                seen = _seen(*one.change[:, :, i])
                found[free.owner, free.name] = seen / factor
                if seen > _GROSS:
                    gross.add(free.owner)
        left, factor = [e for e in left if e.id in gross], factor * _SMALLER
        if not left:
            break
    return found


def _seen(a: Floats, b: Floats) -> float:
    """Return by how many standard errors an effect moves all statistics, none of which counts for more than a few.

    What could be chance of the simulation is not seen.
    """
    chance = float(np.sum((a - b) ** 2)) / (2.0 * math.sqrt(len(a)))
    return math.sqrt(max(float(np.sum(np.clip(a * b, -(_MOST**2), _MOST**2))), chance))


def sizes_for(
    problem: Problem, fit: Fit, effect: type[Effect], seen: Mapping[tuple[str, str], float]
) -> tuple[float, ...]:
    """Return the size at which to probe each number of an effect, beside that of the catalogue."""
    missing = math.sqrt(max(deviance(problem, fit) - freedom(fit), 0.0))
    wanted = max(missing, _WELL_SEEN)
    known = [seen[f.owner, f.name] for f in switches(effect)]
    return tuple(min(max(wanted / s, _SMALLEST), _LARGEST) if s > 0.0 else 1.0 for s in known)


def probes_at(
    problem: Problem, fit: Fit, wanted: Sequence[tuple[type[Effect], Sequence[Sequence[float]]]], seed: int,
    effort: float,
) -> list[list[Probe]]:  # fmt: skip
    """Return the probes of effects, each at some sizes of its numbers beside those of the catalogue."""
    base = problem.models(fit.model, fit.slots, fit.x)
    places: list[tuple[int, tuple[float, ...]]] = []
    models = []
    for number, (effect, sizes) in enumerate(wanted):
        for factors in sizes:
            at = tuple(_coordinate(f, factor) for f, factor in zip(switches(effect), factors, strict=True))
            places.append((number, at))
            for free, coordinate in zip(switches(effect), at, strict=True):
                off = {f.name: _null(effect, f) for f in switches(effect) if f is not free}
                values = {**off, free.name: free.value(coordinate)}
                one = probe_of(effect, values, problem.given.get(effect.id))
                models.append([m + one for m in base])
    changes = (reliable(problem, fit, both) for both in problem.changes(base, models, seed, effort))
    found: list[list[Probe]] = [[] for _ in wanted]
    for number, at in places:
        columns = np.stack([next(changes) for _ in at], axis=2)
        whitened = np.stack([fit.whiten(half, problem.measured.points) for half in columns])
        effect = wanted[number][0]
        found[number].append(Probe(effect, switches(effect), at, whitened))
    return found


def closer(problem: Problem, fit: Fit, probes: Sequence[Probe], seed: int, effort: float) -> list[Probe]:
    """Return probes of the same sizes, looked at with another effort."""
    wanted = []
    for one in probes:
        usual = [free.coordinate(free.probe) for free in one.free]
        wanted.append((one.effect, [tuple(at / u for at, u in zip(one.at, usual, strict=True))]))
    return [several[0] for several in probes_at(problem, fit, wanted, seed, effort)]


def reliable(problem: Problem, fit: Fit, both: Floats) -> Floats:
    """Return the change of all statistics in two sensors, (2, n), less of it where it is mostly chance.

    An effect shows in some views, at some lights, and everywhere else there is nothing but the chance of the
    simulation. What both sensors have in common tells how much of a family of statistics is to be believed.

    Source: W. James, C. Stein, "Estimation with quadratic loss", Proc. 4th Berkeley Symp. Math. Statist. Prob.
    (1961), for each family.
    """
    a, b = np.where(fit.known, both / fit.deviation, 0.0)
    family = problem.measured.families
    common, whole = (np.bincount(family, weights=w) for w in (a * b, (0.5 * (a + b)) ** 2))
    believed = np.clip(np.divide(common, whole, out=np.zeros_like(common), where=whole > 0.0), 0.0, 1.0)
    return np.asarray(both * believed[family])


def _coordinate(free: Free, factor: float) -> float:
    low, high = free.range
    return min(max(free.coordinate(free.probe) * factor, low), high)


def _null(effect: type[Effect], free: Free) -> float:
    null = next(p.null for p in effect.parameters() if p.name == free.name)
    return 0.0 if null is None else null
