"""Which effect would explain what the fitted model does not: each candidate is probed, and nothing is refitted.

A probe gives the direction in which an effect of some size moves all statistics. How far the residuals lie along it,
beyond what the free numbers can take up, is a score test; the expected size follows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.fitting.explaining import Explained, explain
from bench.diagnosis.fitting.fitted import off_known, prior_precision
from bench.diagnosis.fitting.normal import solved

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.diagnosis.expected.problem import Problem
    from bench.diagnosis.fitting.fitted import Fit
    from bench.diagnosis.fitting.probe import Probe

    Floats = npt.NDArray[np.float64]

__all__ = ["Scores", "basis_of", "beyond", "extended", "score"]

#: A direction that is shorter, in standard errors, is none.
_INVISIBLE: Final = 1e-3
_DRAWS: Final = 20000


@dataclass(frozen=True)
class Scores:
    """What the probes say about the residuals of a fit."""

    probes: tuple[Probe, ...]  #: of each candidate
    drop: Floats  #: (c,) expected fall of the loss
    p_value: Floats  #: (c,) of that fall, each by itself
    p_best: Floats  #: (c,) of that fall for the best of all candidates
    size: tuple[Floats, ...]  #: (k,) of each: coordinates that are expected
    base: tuple[Floats, ...]  #: (b,) of each: by how much the free numbers of the fit are expected to change
    seen: Floats  #: (c,) standard errors with which the probe would be seen
    likeness: Floats  #: (c, c) cosine of the directions of two effects, beyond what the free numbers take up


def beyond(basis: Floats, columns: Floats) -> Floats:
    """Return what is left of columns when the free numbers have taken up what they can: see :func:`basis_of`."""
    return columns - basis @ (basis.T @ columns)


def extended(fit: Fit, columns: Floats) -> Floats:
    """Return whitened columns, (n, m), with a row for what is known beforehand of each free number: (n + k, m).

    It is an observation like others; directions of effects do not show in it.
    """
    return np.concatenate([columns, np.zeros((len(fit.slots), columns.shape[1]))])


def basis_of(fit: Fit, problem: Problem, more: Sequence[Floats] = (), without: str = "") -> Floats:
    """Return orthonormal columns: what the free numbers of a fit can take up, see :func:`extended`.

    Parameters
    ----------
    more
        Further directions, whitened.
    without
        An effect whose numbers are not counted.
    """
    counted = [slot.free.owner != without for slot in fit.slots]
    j = fit.whiten(fit.jacobian.mean(axis=0), problem.measured.points)
    j = np.concatenate([j, np.diag(np.sqrt(prior_precision(fit.slots)))])[:, counted]
    j = np.column_stack([j, *(extended(fit, column[:, None]) for column in more)])
    lengths = np.linalg.norm(j, axis=0)
    u, s, _ = np.linalg.svd(j[:, lengths > 0.0] / lengths[lengths > 0.0], full_matrices=False)
    return np.asarray(u[:, s > 1e-6])


def score(
    problem: Problem,
    fit: Fit,
    probes: Sequence[Probe],
    seed: int,
    beside: Sequence[Probe] = (),
    far_off: bool = False,
) -> Scores:
    """Return how well each effect would explain the residuals of a fit.

    The p-value of the best of all is that of as large a fall for any candidate, among runs in which nothing is
    missing: their scores are normal, with the covariance of the directions (parametric bootstrap).

    Parameters
    ----------
    beside
        What they do may be there, whatever it is: no effect is significant for what they explain.
    far_off
        Some residuals are so large that their squares are all that a score test sees: the p-values are those of the
        expected fall of the loss instead, in which large residuals count by their size.
    """
    residual = fit.whiten(fit.residual, problem.measured.points)
    basis = basis_of(fit, problem, [column for one in beside for column in one.change.mean(axis=0).T])
    jacobian = fit.whiten(fit.jacobian.mean(axis=0), problem.measured.points)
    alone = explain(fit, jacobian, residual, None).fall
    tried = [_or_seen(explain(fit, jacobian, residual, one), one, alone) for one in probes]
    rest = beyond(basis, np.concatenate([residual, off_known(fit)])[:, None])[:, 0]
    spans = [[beyond(basis, extended(fit, one.change[s])) for s in range(2)] for one in probes]
    means = [0.5 * (a + b) for a, b in spans]
    rest /= math.sqrt(fit.common)
    drop = np.array([max(found.fall - alone, 0.0) for found in tried])
    if far_off:
        ps = np.array([_p_value(fall / fit.common, one) for fall, one in zip(drop, probes, strict=True)])
    else:
        ps = np.array([_score(one, mean, mean.T @ rest) for one, mean in zip(probes, means, strict=True)])
    return Scores(
        probes=tuple(probes),
        drop=drop,
        p_value=ps,
        p_best=_of_the_best(probes, means, ps, seed),
        size=tuple(found.size for found in tried),
        base=tuple(found.base for found in tried),
        seen=np.array([math.sqrt(max(float(np.sum(a * b)), 0.0)) for a, b in spans]),
        likeness=_likeness(spans, [found.size for found in tried]),
    )


def _or_seen(expected: Explained, one: Probe, alone: float) -> Explained:
    """Return what is expected of an effect; what was seen of it instead if that is more."""
    if one.falls_by <= expected.fall - alone:
        return expected
    return Explained(np.zeros_like(expected.base), np.array(one.at), alone + one.falls_by)


def _score(one: Probe, mean: Floats, product: Floats) -> float:
    """Return the p-value of the fall of the deviance along the directions of one effect."""
    kept = [k for k, length in enumerate(np.linalg.norm(mean, axis=0)) if length >= _INVISIBLE]
    while kept:
        spread = mean[:, kept].T @ mean[:, kept]
        w = solved(spread, product[kept])
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
    signed = [f.signed for f in one.free]
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
    bounded = np.array([f.range[0] >= 0.0 for f in one.free])
    counts = (lengths >= _INVISIBLE) & ~(bounded & (products < 0.0))  # as in _score
    z = np.where(counts, products / np.maximum(lengths, _INVISIBLE), 0.0)
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
    own = [float(a @ b) for a, b in lines]
    for i in range(n):
        for k in range(i):
            if min(own[i], own[k]) < _INVISIBLE**2:
                continue  # a direction that is none is like no other
            both = 0.5 * float(lines[i][0] @ lines[k][1] + lines[i][1] @ lines[k][0])
            out[i, k] = out[k, i] = float(np.clip(both / math.sqrt(own[i] * own[k]), -1.0, 1.0))
    return out
