"""Which effect would explain what the fitted model does not: each candidate is probed, and nothing is refitted.

A probe gives the direction in which an effect of some size moves all statistics. How far the residuals lie along it,
beyond what the free numbers can take up, is a score test; the expected size follows. Where the model is far off an
effect is not small, and no straight line: so the most promising are probed at several sizes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis import robust
from bench.diagnosis.catalogue import switches
from bench.diagnosis.fitted import prior_precision
from bench.diagnosis.probing import closer, probes_at, sizes_for, visible
from bench.diagnosis.steps import longest_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.diagnosis.fitted import Fit
    from bench.diagnosis.probing import Probe, Probed
    from bench.diagnosis.problem import Problem
    from sim_backend.pixel.effects.base import Effect

    Floats = npt.NDArray[np.float64]

__all__ = ["Scores", "basis_of", "beyond", "probe", "score"]

#: Effort of a probe where the model is far off, and where what may be missing is small.
_FAR_EFFORT: Final = 0.1
_NEAR_EFFORT: Final = 0.4
#: Further sizes of the effects that promise most where the model is far off, and how many of them.
_OTHERS: Final = (0.25, 4.0)
_PROMISING: Final = 8
#: Where what may be missing is small, so many of the most promising are looked at closer, with this effort.
_CLOSER: Final = 5
_CLOSER_EFFORT: Final = 2.0
#: A probe says something about effects up to so many times its size.
_BEYOND: Final = 2.0
#: A direction that is shorter, in standard errors, is none.
_INVISIBLE: Final = 1e-3
_DRAWS: Final = 20000


@dataclass(frozen=True)
class Scores:
    """What the probes say about the residuals of a fit."""

    probes: tuple[Probe, ...]  #: of each candidate, at the size that explains most
    drop: Floats  #: (c,) expected fall of the loss
    p_value: Floats  #: (c,) of that fall, each by itself
    p_best: Floats  #: (c,) of that fall for the best of all candidates
    size: tuple[Floats, ...]  #: (k,) of each: coordinates that are expected
    base: tuple[Floats, ...]  #: (b,) of each: by how much the free numbers of the fit are expected to change
    seen: Floats  #: (c,) standard errors with which the probe would be seen
    likeness: Floats  #: (c, c) cosine of the directions of two effects, beyond what the free numbers take up


def probe(
    problem: Problem, fit: Fit, effects: Sequence[type[Effect]], seed: int, gross: bool, seen: Probed
) -> list[list[Probe]]:  # fmt: skip
    """Return the probes of some effects; those that promise most at several sizes if they are gross.

    Parameters
    ----------
    seen
        How well effects are seen, as far as that is known; what is found out is added.
    """
    if gross:
        return _of_gross(problem, fit, effects, seed)
    unknown = [e for e in effects if any((f.owner, f.name) not in seen for f in switches(e))]
    seen |= visible(problem, fit, unknown, seed)
    wanted = [(e, [sizes_for(problem, fit, e, seen)]) for e in effects]
    found = probes_at(problem, fit, wanted, seed, _NEAR_EFFORT)
    promising = _promising(problem, fit, found, _CLOSER)
    again = closer(problem, fit, [found[i][0] for i in promising], seed + 1, _CLOSER_EFFORT)
    for i, one in zip(promising, again, strict=True):
        found[i] = [one]
    return found


def _of_gross(problem: Problem, fit: Fit, effects: Sequence[type[Effect]], seed: int) -> list[list[Probe]]:
    """Return the probes of effects of the catalogue's size, and of those that promise most of others."""
    found = probes_at(problem, fit, [(e, [(1.0,) * len(switches(e))]) for e in effects], seed, _FAR_EFFORT)
    promising = _promising(problem, fit, found, _PROMISING)
    others = [(effects[i], [(size,) * len(switches(effects[i])) for size in _OTHERS]) for i in promising]
    for i, several in zip(promising, probes_at(problem, fit, others, seed, _FAR_EFFORT), strict=True):
        found[i] += several
    return found


def _promising(problem: Problem, fit: Fit, probes: Sequence[Sequence[Probe]], count: int) -> list[int]:
    """Return which effects explain most, by their first probe."""
    points = problem.measured.points
    residual, jacobian = fit.whiten(fit.residual, points), fit.whiten(fit.jacobian.mean(axis=0), points)
    falls = [_explain(fit, jacobian, residual, several[0])[2] for several in probes]
    return sorted(int(i) for i in np.argsort(falls)[-count:])


def beyond(basis: Floats, columns: Floats) -> Floats:
    """Return what is left of columns when the free numbers have taken up what they can: see :func:`basis_of`."""
    return columns - basis @ (basis.T @ columns)


def basis_of(fit: Fit, problem: Problem) -> Floats:
    """Return orthonormal columns: what the free numbers of a fit can take up."""
    j = fit.whiten(fit.jacobian.mean(axis=0), problem.measured.points)
    lengths = np.linalg.norm(j, axis=0)
    u, s, _ = np.linalg.svd(j[:, lengths > 0.0] / lengths[lengths > 0.0], full_matrices=False)
    return np.asarray(u[:, s > 1e-6])


def score(problem: Problem, fit: Fit, probes: Sequence[Sequence[Probe]], seed: int) -> Scores:
    """Return how well each effect would explain the residuals of a fit.

    The p-value of the best of all is that of as large a fall for any candidate, among runs in which nothing is
    missing: their scores are normal, with the covariance of the directions (parametric bootstrap).
    """
    residual = fit.whiten(fit.residual, problem.measured.points)
    basis = basis_of(fit, problem)
    jacobian = fit.whiten(fit.jacobian.mean(axis=0), problem.measured.points)
    alone = _explain(fit, jacobian, residual, None)[2]
    chosen, drops, sizes, bases = [], [], [], []
    for several in probes:
        tried = [_explain(fit, jacobian, residual, one) for one in several]
        best = int(np.argmax([fall for _, _, fall in tried]))
        chosen.append(several[best])
        bases.append(tried[best][0])
        sizes.append(tried[best][1])
        drops.append(max(tried[best][2] - alone, 0.0))
    rest = beyond(basis, residual[:, None])[:, 0]
    spans = [[beyond(basis, one.change[s]) for s in range(2)] for one in chosen]
    means = [0.5 * (a + b) for a, b in spans]
    rest /= math.sqrt(fit.common)
    ps = np.array([_score(one, mean, mean.T @ rest) for one, mean in zip(chosen, means, strict=True)])
    return Scores(
        probes=tuple(chosen),
        drop=np.array(drops),
        p_value=ps,
        p_best=_of_the_best(chosen, means, ps, seed),
        size=tuple(sizes),
        base=tuple(bases),
        seen=np.array([math.sqrt(max(float(np.sum(a * b)), 0.0)) for a, b in spans]),
        likeness=_likeness(spans, sizes),
    )


def _explain(fit: Fit, columns: Floats, residual: Floats, one: Probe | None) -> tuple[Floats, Floats, float]:
    """Return the expected changes of the free numbers, coordinates of the effect, and fall of the loss.

    `columns`, (n, b), are the whitened changes by the free numbers.
    """
    longest = longest_of(fit.slots, fit.x)
    low, high = (np.array([s.free.range[end] for s in fit.slots]) for end in (0, 1))
    lowest, highest = np.maximum(low - fit.x, -longest), np.minimum(high - fit.x, longest)
    precision, towards = prior_precision(fit.slots), fit.start - fit.x
    k = len(longest)
    if one is not None:
        m = len(one.free)
        columns = np.concatenate([columns, one.change.mean(axis=0)], axis=1)
        signed = np.array([f.range[0] < 0.0 for f in one.free])
        lowest = np.append(lowest, np.where(signed, -_BEYOND, 0.0))
        highest = np.append(highest, np.full(m, _BEYOND))
        precision, towards = np.append(precision, np.zeros(m)), np.append(towards, np.zeros(m))
    c, fall = robust.solve(columns, residual, precision, towards, lowest, highest)
    at = np.array(one.at if one is not None else ())
    return c[:k], c[k:] * at, fall


def _score(one: Probe, mean: Floats, product: Floats) -> float:
    """Return the p-value of the fall of the deviance along the directions of one effect."""
    kept = list(range(len(one.free)))
    while kept:
        spread = mean[:, kept].T @ mean[:, kept]
        if np.min(np.diag(spread)) < _INVISIBLE**2:
            return 1.0
        w = np.linalg.lstsq(spread, product[kept], rcond=1e-10)[0]
        wrong = [k for k, x in zip(kept, w, strict=True) if x < 0.0 and one.free[k].range[0] >= 0.0]
        if not wrong:
            return _p_value(float(product[kept] @ w), one)
        kept = [k for k in kept if k not in wrong]
    return 1.0


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
