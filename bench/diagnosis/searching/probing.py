"""What an effect of some size does to all statistics, of a size at which that can be told.

Too small an effect drowns in the chance of the simulation; what a gross one does is no straight line. So each is
tried until it is probed at about the size that would explain what is left, or that is just well seen.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.expected.catalogue import least_size, probe_of, switches
from bench.diagnosis.fitting.judging import deviance, freedom
from bench.diagnosis.fitting.looks import delays, later
from bench.diagnosis.fitting.probe import Probe
from bench.diagnosis.searching.screen import basis_of, beyond, extended

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import numpy.typing as npt

    from bench.diagnosis.expected.parameters import Free
    from bench.diagnosis.expected.problem import Change, Problem
    from bench.diagnosis.fitting.fitted import Fit
    from sim_backend.pixel.effects.base import Effect

    Floats = npt.NDArray[np.float64]

__all__ = [
    "GROSS",
    "WELL_SEEN",
    "Probed",
    "closer",
    "fainter",
    "looks_of",
    "probes_at",
    "reliable",
    "seen_of",
    "sizes_for",
    "well_sized",
]

#: Size, beside that of the catalogue, at which an effect is tried of which nothing is known.
_FIRST: Final = 0.25
#: A probe that moves all statistics by more than this is tried again at a share of its size, and any whose size is
#: not the wanted one to within a factor, so often at the most; no statistic counts for more standard errors than the
#: limit.
GROSS: Final = 60.0
_SMALLER: Final = 0.15
_ABOUT: Final = 3.0
#: An effect that stands out of chance by fewer standard errors is tried at so many times its size.
_CLEARLY: Final = 4.0
_GROWTH: Final = 4.0
#: Half of the squares of standard normal numbers are smaller.
_MEDIAN_SQUARE: Final = 0.455
_TRIALS: Final = 4
_MOST: Final = 5.0
#: Standard errors by which a probe moves all statistics, at the least; sizes beside those of the catalogue.
WELL_SEEN: Final = 25.0
_SMALLEST: Final = 1e-4
_LARGEST: Final = 4.0

#: Of each number that switches an effect on: standard errors by which the size of the catalogue moves all statistics.
Probed = dict[tuple[str, str], float]


def well_sized(
    problem: Problem, fit: Fit, effects: Sequence[type[Effect]], seed: int, effort: float, seen: Probed
) -> list[Probe]:  # fmt: skip
    """Return a probe of each effect of about the size that is wanted: see :func:`sizes_for`.

    Parameters
    ----------
    seen
        How well effects are seen, as far as that is known; what is found out is added.
    """
    basis = basis_of(fit, problem)
    found: dict[str, Probe] = {}
    left = {e: sizes_for(problem, fit, e, seen) for e in effects}
    for _ in range(_TRIALS):
        probes = probes_at(problem, fit, list(left.items()), seed, effort)
        again = {}
        for one, (effect, sizes) in zip(probes, left.items(), strict=True):
            found[effect.id] = one
            halves = [beyond(basis, extended(fit, half)) for half in one.change]
            looks = _looks(halves)
            clear = [stands_out(*(half[:, i] for half in halves)) for i in range(len(sizes))]
            seen |= {(f.owner, f.name): n / size for f, n, size in zip(one.free, looks, sizes, strict=True)}
            wanted = sizes_for(problem, fit, effect, seen)
            # What is gross is seen even better than it looks: no statistic counts for more than a few.
            # What may be chance is looked at in a larger size.
            least = least_size(effect, _SMALLEST)
            others = tuple(
                max(min(new, _SMALLER * size), least) if n > GROSS else new if sure else min(_GROWTH * size, _LARGEST)
                for new, size, n, sure in zip(wanted, sizes, looks, clear, strict=True)
            )
            if any(not 1.0 / _ABOUT <= size / new <= _ABOUT for size, new in zip(sizes, others, strict=True)):
                again[effect] = others
        left = again
        if not left:
            break
    return [found[e.id] for e in effects]


def fainter(problem: Problem, fit: Fit, one: Probe, seen: Probed) -> Floats:
    """(k,) how many times larger the numbers of a probe are to be to be seen as well as is wanted; 1 if they are.

    Parameters
    ----------
    seen
        How well effects are seen; what this probe says of it is put there.
    """
    usual = np.array([free.coordinate(free.probe) for free in one.free])
    size = np.abs(np.asarray(one.at) / usual)
    seen |= {(f.owner, f.name): n / s for f, n, s in zip(one.free, looks_of(problem, fit, one), size, strict=True)}
    most = np.array([max(abs(end) for end in free.range) for free in one.free]) / np.abs(np.asarray(one.at))
    larger = np.minimum(np.array(sizes_for(problem, fit, one.effect, seen)) / size, most)
    return np.asarray(np.where(larger > _ABOUT, larger, 1.0))


def looks_of(problem: Problem, fit: Fit, one: Probe) -> list[float]:
    """Return by how many standard errors each number of a probe is seen."""
    basis = basis_of(fit, problem)
    return _looks([beyond(basis, extended(fit, half)) for half in one.change])


def _looks(halves: Sequence[Floats]) -> list[float]:
    """Return how well each number is seen; what the free numbers take up is not: slow noise beside noise, for one."""
    return [seen_of(*(half[:, i] for half in halves)) for i in range(halves[0].shape[1])]


def seen_of(a: Floats, b: Floats) -> float:
    """Return by how many standard errors an effect moves all statistics, none of which counts for more than a few.

    What could be chance of the simulation is not seen.
    """
    return math.sqrt(max(float(np.sum(np.clip(a * b, -(_MOST**2), _MOST**2))), _chance_of(a, b)))


def _chance_of(a: Floats, b: Floats) -> float:
    """Return the standard error of the product of what two sensors show, from how the two differ."""
    return float(np.sum((a - b) ** 2)) / (2.0 * math.sqrt(len(a)))


def stands_out(a: Floats, b: Floats) -> bool:
    """Return whether two sensors agree about an effect by more than chance."""
    return float(a @ b) > _CLEARLY * _chance_of(a, b)


def sizes_for(
    problem: Problem, fit: Fit, effect: type[Effect], seen: Mapping[tuple[str, str], float]
) -> tuple[float, ...]:
    """Return the size at which to probe each number of an effect, beside that of the catalogue.

    It is the one that would explain what is left, or that is just well seen.
    """
    missing = math.sqrt(max(deviance(problem, fit) - freedom(fit), 0.0))
    wanted = max(missing, WELL_SEEN)
    known = [seen.get((f.owner, f.name)) for f in switches(effect)]
    least = least_size(effect, _SMALLEST)
    sizes = (_FIRST if s is None else min(wanted / max(s, 1e-9), _LARGEST) for s in known)
    return tuple(max(size, least) for size in sizes)


def probes_at(
    problem: Problem, fit: Fit, wanted: Sequence[tuple[type[Effect], Sequence[float]]], seed: int, effort: float
) -> list[Probe]:  # fmt: skip
    """Return the probes of effects, each at a size of its numbers beside those of the catalogue."""
    base = fit.models(problem)
    places = []
    models = []
    for effect, factors in wanted:
        at = tuple(_coordinate(f, factor) for f, factor in zip(switches(effect), factors, strict=True))
        places.append(at)
        for free, coordinate in zip(switches(effect), at, strict=True):
            off = {f.name: _null(effect, f) for f in switches(effect) if f is not free}
            values = {**off, free.name: free.value(coordinate)}
            one = probe_of(effect, values, problem.given.get(effect.id))
            models.append(problem.of_points([m + one for m in base]))
    changes = problem.changes(base, models, seed, effort)
    found = []
    for (effect, _), at in zip(wanted, places, strict=True):
        mine = [
            _with_known(problem, fit, free, coordinate, next(changes))
            for free, coordinate in zip(switches(effect), at, strict=True)
        ]
        columns = np.stack(mine, axis=2)
        whitened = np.stack([fit.whiten(half, problem.measured.points) for half in columns])
        found.append(Probe(effect, switches(effect), at, whitened))
    return found


def closer(
    problem: Problem, fit: Fit, probes: Sequence[Probe], factors: Sequence[Floats], seed: int, effort: float
) -> list[Probe]:  # fmt: skip
    """Return probes of other sizes, beside those that they had, looked at with another effort."""
    wanted = []
    for one, change in zip(probes, factors, strict=True):
        usual = [free.coordinate(free.probe) for free in one.free]
        wanted.append((one.effect, tuple(np.asarray(one.at) / usual * change)))
    return probes_at(problem, fit, wanted, seed, effort)


def reliable(problem: Problem, fit: Fit, change: Change, *, whole: bool = False) -> Floats:
    """Return the change of all statistics in two sensors, (2, n), less of it where it is mostly chance.

    An effect shows in some views, at some lights, and everywhere else there is nothing but the chance of the
    simulation. What both sensors have in common tells how much of a family of statistics is to be believed.

    A family of one or two may agree by chance. So nothing is believed to be sharper than it is as a rule: how sharp
    follows from the scatter of a recording and their number, and from how much of it the same random numbers leave.

    Source: W. James, C. Stein, "Estimation with quadratic loss", Proc. 4th Berkeley Symp. Math. Statist. Prob.
    (1961), for each family, or for all statistics as a `whole`.
    """
    a, b = np.where(fit.known, change.halves / fit.deviation, 0.0)
    family = np.zeros_like(problem.measured.families) if whole else problem.measured.families
    usual = np.where(a != b, _left_of_chance(a, b, change.recordings), 0.0)
    mean, own, least = (np.bincount(family, weights=w) for w in ((0.5 * (a + b)) ** 2, (0.5 * (a - b)) ** 2, usual))
    chance = np.maximum(own, least)
    believed = np.clip(1.0 - np.divide(chance, mean, out=np.ones_like(mean), where=mean > 0.0), 0.0, 1.0)
    return np.asarray(change.halves * believed[family])


def _left_of_chance(a: Floats, b: Floats, recordings: float) -> float:
    """Return the usual variance of the mean of two differences, in that of a recording: see :func:`reliable`."""
    unlike = (a - b)[a != b] ** 2
    if not unlike.size:
        return 0.0
    # Half of the squares of normal numbers are below 0.455 of their variance. Each half has chance from both ends.
    return min(0.25 * float(np.median(unlike)) / _MEDIAN_SQUARE, 1.0 / recordings)


def _with_known(problem: Problem, fit: Fit, free: Free, coordinate: float, change: Change) -> Floats:
    """Return the reliable change of all statistics; what is known of it is no matter of chance.

    Beside that there is hardly anything: the rest is to be believed as a whole, or not.
    """
    if not delays(free):
        return reliable(problem, fit, change)
    known = coordinate * later(problem, fit)
    return np.asarray(known + reliable(problem, fit, change._replace(halves=change.halves - known), whole=True))


def _coordinate(free: Free, factor: float) -> float:
    low, high = free.range
    return min(max(free.coordinate(free.probe) * factor, low), high)


def _null(effect: type[Effect], free: Free) -> float:
    null = next(p.null for p in effect.parameters() if p.name == free.name)
    return 0.0 if null is None else null
