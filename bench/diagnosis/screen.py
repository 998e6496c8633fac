"""Which effect would explain what the fitted model does not: each candidate is probed once, and nothing is refitted.

A probe gives the direction in which an effect moves all statistics. How far the residuals lie along it, beyond
what the free numbers can take up, is a score test; the expected size follows. Two sensors are simulated for each
probe: the products of their changes know the size of an effect without the chance in it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.catalogue import free_of, probe_of
from bench.diagnosis.fit import shrunk

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import numpy.typing as npt

    from bench.diagnosis.fit import Fit
    from bench.diagnosis.parameters import Free
    from bench.diagnosis.problem import Problem
    from sim_backend.pixel.effects.base import Effect

    Floats = npt.NDArray[np.float64]

__all__ = ["Probe", "Scores", "probe", "score"]

#: An effect is probed again where it is seen with less, or more, than so many standard errors.
_FAINT: Final = 5.0
_GROSS: Final = 40.0
_WANTED: Final = 15.0
_MOST: Final = 10.0  #: factor by which a probe is made larger or smaller
#: A direction that is shorter, in standard errors, is none.
_INVISIBLE: Final = 1e-3
_DRAWS: Final = 20000


@dataclass(frozen=True)
class Probe:
    """An effect at a size at which it can be seen, and what it does to all statistics."""

    effect: type[Effect]
    free: tuple[Free, ...]  #: the numbers that switch it on, each probed by itself
    at: tuple[float, ...]  #: coordinate of each
    change: Floats  #: (2, n, k) whitened change of the statistics for each, from two sensors


@dataclass(frozen=True)
class Scores:
    """What the probes say about the residuals of a fit."""

    probes: tuple[Probe, ...]
    drop: Floats  #: (c,) expected fall of the deviance
    p_value: Floats  #: (c,) of that fall, each by itself
    p_best: Floats  #: (c,) of that fall for the best of all candidates
    size: tuple[Floats, ...]  #: (k,) of each: coordinates that are expected
    seen: Floats  #: (c,) standard errors with which the probe would be seen
    likeness: Floats  #: (c, c) cosine of the directions of two effects, beyond what the free numbers take up


def probe(
    problem: Problem, fit: Fit, effects: Sequence[type[Effect]], seed: int, at: Mapping[str, float]
) -> list[Probe]:
    """Return the probes of some effects.

    Parameters
    ----------
    at
        Values that the data suggest, by ``effect.parameter``; others are the catalogue's.
    """
    found = _probes(problem, fit, [(e, 1.0) for e in effects], seed, at)
    again = []
    for i, one in enumerate(found):
        seen = _seen(fit, problem, one)
        if seen < _FAINT:
            again.append((i, min(_WANTED / max(seen, 1e-9), _MOST)))
        elif seen > _GROSS:
            again.append((i, max(_WANTED / seen, 1.0 / _MOST)))
    better = _probes(problem, fit, [(found[i].effect, factor) for i, factor in again], seed, at)
    for (i, _), one in zip(again, better, strict=True):
        found[i] = one
    return found


def switches(effect: type[Effect]) -> tuple[Free, ...]:
    """Return the numbers that switch an effect on; the others only shape it."""
    return tuple(f for f in free_of(effect) if f.scale != "log")


def _probes(
    problem: Problem, fit: Fit, wanted: Sequence[tuple[type[Effect], float]], seed: int, at: Mapping[str, float]
) -> list[Probe]:
    if not wanted:
        return []
    places: list[list[float]] = []
    models = [problem.models(fit.model, fit.slots, fit.x)]
    for effect, factor in wanted:
        mine = []
        values = {f.name: at.get(f.key, f.probe) for f in free_of(effect)}
        for free in switches(effect):
            low, high = free.range
            coordinate = min(max(free.coordinate(values[free.name]) * factor, low), high)
            off = {f.name: _null(effect, f) for f in switches(effect) if f is not free}
            one = probe_of(effect, {**values, **off, free.name: free.value(coordinate)})
            models.append([m + one for m in models[0]])
            mine.append(coordinate)
        places.append(mine)
    simulated = problem.simulate(models, seed, 2)
    base = [problem.expect([s]).value for s in simulated[0]]
    found, row = [], 1
    for (effect, _), mine in zip(wanted, places, strict=True):
        columns = np.empty((2, len(fit.value), len(mine)))
        for k in range(len(mine)):
            for sensor in range(2):
                columns[sensor, :, k] = problem.expect([simulated[row][sensor]]).value - base[sensor]
            row += 1
        both = columns.mean(axis=0)
        # What may be chance in the mean of both is taken out of each.
        keep = np.stack([shrunk(both[:, k], fit.deviation) for k in range(len(mine))], axis=1)
        part = np.divide(keep, both, out=np.zeros_like(both), where=both != 0.0)
        whitened = np.stack([fit.whiten(c * part, problem.measured.points) for c in columns])
        found.append(Probe(effect, switches(effect), tuple(mine), whitened))
    return found


def _null(effect: type[Effect], free: Free) -> float:
    null = next(p.null for p in effect.parameters() if p.name == free.name)
    return 0.0 if null is None else null


def _seen(fit: Fit, problem: Problem, one: Probe) -> float:
    first, second = _beyond(fit, problem, one.change[0]), _beyond(fit, problem, one.change[1])
    return math.sqrt(max(float(np.sum(first * second)) / first.shape[1], 0.0))


def _beyond(fit: Fit, problem: Problem, columns: Floats) -> Floats:
    """Return what is left of columns when the free numbers have taken up what they can."""
    basis = _basis(fit, problem)
    return columns - basis @ (basis.T @ columns)


def _basis(fit: Fit, problem: Problem) -> Floats:
    j = fit.whiten(fit.jacobian.mean(axis=0), problem.measured.points)
    lengths = np.linalg.norm(j, axis=0)
    u, s, _ = np.linalg.svd(j[:, lengths > 0.0] / lengths[lengths > 0.0], full_matrices=False)
    return np.asarray(u[:, s > 1e-6])


def score(problem: Problem, fit: Fit, probes: Sequence[Probe], seed: int) -> Scores:
    """Return how well each effect would explain the residuals of a fit.

    The p-value of the best of all is that of as large a fall for any candidate, among runs in which nothing is
    missing: their scores are normal, with the covariance of the directions (parametric bootstrap).
    """
    points = problem.measured.points
    residual = fit.whiten(fit.residual, points)
    rest = residual - _basis(fit, problem) @ (_basis(fit, problem).T @ residual)
    spans = [[_beyond(fit, problem, one.change[s]) for s in range(2)] for one in probes]
    means = [0.5 * (a + b) for a, b in spans]
    drops, ps, sizes = [], [], []
    for one, mean, (a, b) in zip(probes, means, spans, strict=True):
        drop, p, size = _score(one, mean, a, b, mean.T @ rest)
        drops.append(drop)
        ps.append(p)
        sizes.append(size)
    return Scores(
        probes=tuple(probes),
        drop=np.array(drops),
        p_value=np.array(ps),
        p_best=_of_the_best(probes, means, np.array(ps), seed),
        size=tuple(sizes),
        seen=np.array([math.sqrt(max(float(np.sum(a * b)), 0.0)) for a, b in spans]),
        likeness=_likeness(spans, sizes),
    )


def _score(one: Probe, mean: Floats, a: Floats, b: Floats, product: Floats) -> tuple[float, float, Floats]:
    """Return the fall of the deviance, its p-value, and the size, in coordinates, of one effect."""
    kept = list(range(len(one.free)))
    none = np.zeros(len(one.free))
    while kept:
        spread = mean[:, kept].T @ mean[:, kept]
        if np.min(np.diag(spread)) < _INVISIBLE**2:
            return 0.0, 1.0, none
        weights = np.linalg.lstsq(spread, product[kept], rcond=1e-10)[0]
        wrong = [k for k, w in zip(kept, weights, strict=True) if w < 0.0 and one.free[k].range[0] >= 0.0]
        if not wrong:
            break
        kept = [k for k in kept if k not in wrong]
    if not kept:
        return 0.0, 1.0, none
    drop = float(product[kept] @ weights)
    size = none.copy()
    information = 0.5 * (a[:, kept].T @ b[:, kept] + b[:, kept].T @ a[:, kept])
    for i, k in enumerate(kept):
        # The chance in a direction makes it longer, and the size smaller than it is.
        longer = spread[i, i] / max(information[i, i], 0.05 * spread[i, i])
        size[k] = weights[i] * longer * one.at[k]
    return drop, _p_value(drop, one), size


def _p_value(drop: float, one: Probe) -> float:
    """Return the chance of so large a fall: chi-square, half of it at zero for a number that has one sign only."""
    from scipy.stats import chi2

    if drop <= 0.0:
        return 1.0
    signed = [f.range[0] < 0.0 for f in one.free]
    if len(one.free) == 1:
        return float(chi2.sf(drop, 1)) * (1.0 if signed[0] else 0.5)
    return float(0.5 * chi2.sf(drop, 1) + 0.25 * chi2.sf(drop, 2)) if not any(signed) else float(chi2.sf(drop, 2))


def _of_the_best(probes: Sequence[Probe], means: Sequence[Floats], ps: Floats, seed: int) -> Floats:
    """Return the share of runs without any effect in which the best candidate has as small a p-value."""
    if not probes:
        return np.empty(0)
    stacked = np.concatenate(means, axis=1)
    covariance = stacked.T @ stacked
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    draws = np.random.default_rng(seed).standard_normal((_DRAWS, root.shape[1])) @ root.T
    best = np.ones(_DRAWS)
    at = 0
    for one, mean in zip(probes, means, strict=True):
        k = mean.shape[1]
        best = np.minimum(best, _null_p(one, mean, draws[:, at : at + k]))
        at += k
    return np.array([(1.0 + np.count_nonzero(best <= p)) / (1.0 + _DRAWS) for p in ps])


def _null_p(one: Probe, mean: Floats, products: Floats) -> Floats:
    """Return the p-values of many products of the directions with chance residuals."""
    from scipy.stats import chi2

    lengths = np.linalg.norm(mean, axis=0)
    if np.min(lengths) < _INVISIBLE:
        return np.ones(len(products))  # as in _score
    z = products / lengths
    bounded = np.array([f.range[0] >= 0.0 for f in one.free])
    z = np.where(bounded & (z < 0.0), 0.0, z)
    drop = np.sum(z * z, axis=1)
    if len(one.free) == 1:
        return np.asarray(chi2.sf(drop, 1) * (0.5 if bounded[0] else 1.0))
    return np.asarray(np.where(drop > 0.0, 0.5 * chi2.sf(drop, 1) + 0.25 * chi2.sf(drop, 2), 1.0))


def _likeness(spans: Sequence[Sequence[Floats]], sizes: Sequence[Floats]) -> Floats:
    """Return the cosines between the directions of all effects, free of the chance in them."""
    lines = []
    for (a, b), size in zip(spans, sizes, strict=True):
        weights = np.where(size != 0.0, 1.0, 0.0) if np.any(size) else np.ones(len(size))
        lines.append((a @ weights, b @ weights))
    n = len(lines)
    out = np.eye(n)
    own = [max(float(a @ b), 1e-12) for a, b in lines]
    for i in range(n):
        for k in range(i):
            both = 0.5 * float(lines[i][0] @ lines[k][1] + lines[i][1] @ lines[k][0])
            out[i, k] = out[k, i] = float(np.clip(both / math.sqrt(own[i] * own[k]), -1.0, 1.0))
    return out
