"""Every candidate, probed at a size that the residuals ask for.

What an effect does is a straight line over a small range of sizes only. What is gross is first probed at the size of
the catalogue, then at the one that this lets expect, until both agree: what promises most from afar, and nothing once
it is looked at in that size, is not what is missing.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.expected.catalogue import least_size, switches
from bench.diagnosis.fitting.explaining import BEYOND, explain
from bench.diagnosis.fitting.judging import freedom, loss_left
from bench.diagnosis.searching.probing import (
    GROSS,
    WELL_SEEN,
    closer,
    fainter,
    looks_of,
    probes_at,
    seen_of,
    well_sized,
)
from bench.diagnosis.searching.seen import best_seen

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.diagnosis.expected.problem import Problem
    from bench.diagnosis.fitting.fitted import Fit
    from bench.diagnosis.fitting.probe import Probe
    from bench.diagnosis.searching.probing import Probed
    from sim_backend.pixel.effects.base import Effect

    Floats = npt.NDArray[np.float64]

__all__ = ["at_other_sizes", "probe"]

#: Effort of a probe where the model is far off, and where what may be missing is small: with much less a mismatch of
#: the dead time, which is large, promised nothing.
_FAR_EFFORT: Final = 0.1
_NEAR_EFFORT: Final = 0.5
#: Where the model is far off, so many of the most promising are probed at other sizes, so often: where the expected
#: size is a share of the probe's that is below the first limit, or at the most it can be; no more than so many times.
_PROMISING: Final = 8
_ROUNDS: Final = 3
_TOO_LARGE: Final = 0.5
_AT_MOST: Final = 4.0
#: A share of what is too much in the loss is enough to go on with.
_ENOUGH: Final = 0.1
#: Where what may be missing is small, so many of the most promising are looked at closer, with this effort. Chance
#: promises a fall of one.
_CLOSER: Final = 8
_WORTH_ASKING: Final = 2.0
_CLOSER_EFFORT: Final = 2.0
#: Sizes at which what promises nothing is probed again, beside those at which it was.
_OTHERWISE: Final = (0.1, 0.3, 3.0)


def probe(
    problem: Problem, fit: Fit, effects: Sequence[type[Effect]], seed: int, gross: bool, seen: Probed
) -> list[Probe]:  # fmt: skip
    """Return a probe of each effect; of the size that is expected of those that promise most.

    Parameters
    ----------
    gross
        What is missing may do other things at other sizes.
    seen
        How well effects are seen, as far as that is known; what is found out is added.
    """
    if gross:
        return _of_gross(problem, fit, effects, seed)
    found = well_sized(problem, fit, effects, seed, _NEAR_EFFORT, seen)
    found = _of_either_sign(problem, fit, found, seed, _NEAR_EFFORT)
    shares, falls = _expected(problem, fit, found)
    best = [int(i) for i in np.argsort(falls)[-_CLOSER:]]
    sizes = [np.where(shares[i] >= BEYOND, BEYOND, 1.0) for i in best]
    again = closer(problem, fit, [found[i] for i in best], sizes, seed + 1, _CLOSER_EFFORT)
    for i, one in zip(best, again, strict=True):
        found[i] = one
    # What stood out by chance is fainter once it is looked at closer; what then promises nothing is not asked again.
    falls = _expected(problem, fit, found)[1]
    larger = {i: fainter(problem, fit, found[i], seen) for i in best if falls[i] > _WORTH_ASKING}
    faint = [i for i, factors in larger.items() if np.any(factors > 1.0)]
    again = closer(problem, fit, [found[i] for i in faint], [larger[i] for i in faint], seed + 2, _CLOSER_EFFORT)
    for i, one in zip(faint, again, strict=True):
        # What sets in beyond some size is no line from nothing.
        found[i] = one if max(looks_of(problem, fit, one)) < GROSS else found[i]
    return found


def _of_gross(problem: Problem, fit: Fit, effects: Sequence[type[Effect]], seed: int) -> list[Probe]:
    """Return a probe of each effect, of the catalogue's size; of the size that is expected if it promises much."""
    wanted = [(e, (1.0,) * len(switches(e))) for e in effects]
    found = _of_either_sign(problem, fit, probes_at(problem, fit, wanted, seed, _FAR_EFFORT), seed, _FAR_EFFORT)
    for _ in range(_ROUNDS):
        shares, falls = _expected(problem, fit, found)
        factors = {int(i): _other_size(found[i], shares[i]) for i in np.argsort(falls)[-_PROMISING:]}
        others = [i for i, factor in factors.items() if np.any(factor != 1.0)]
        if not others:
            break
        again = closer(problem, fit, [found[i] for i in others], [factors[i] for i in others], seed, _FAR_EFFORT)
        for i, one in zip(others, again, strict=True):
            found[i] = one
    return _with_what_is_seen(problem, fit, found, seed)


def _with_what_is_seen(
    problem: Problem, fit: Fit, probes: Sequence[Probe], seed: int
) -> list[Probe]:  # fmt: skip
    """Return the probes; where lines tell nothing that explains much, those of sizes that are seen to explain more.

    What sets in beyond some size, as a dead time that becomes longer than a pulse does, is no line from nothing.
    """
    found = list(probes)
    falls = _expected(problem, fit, probes)[1]
    if max(falls, default=0.0) > _ENOUGH * (loss_left(problem, fit) - freedom(fit)):
        return found
    seen = best_seen(problem, fit, [one.effect for one in probes], seed)
    better = [i for i, (one, fall) in enumerate(zip(seen, falls, strict=True)) if one.fall > fall]
    wanted = [(found[i].effect, (seen[i].factor,) * len(found[i].at)) for i in better]
    for i, one in zip(better, probes_at(problem, fit, wanted, seed, _FAR_EFFORT), strict=True):
        found[i] = replace(one, falls_by=seen[i].fall)
    return found


def _of_either_sign(problem: Problem, fit: Fit, probes: Sequence[Probe], seed: int, effort: float) -> list[Probe]:
    """Return the probes; those of a number that has either sign in the sign that is expected to explain more.

    Light that falls does not take away the events that rising light would send: nothing is less than no event.
    """
    found = list(probes)
    signed = [i for i, one in enumerate(probes) if all(free.signed for free in one.free)]
    if not signed:
        return found
    turned = [np.full(len(probes[i].at), -1.0) for i in signed]
    others = closer(problem, fit, [probes[i] for i in signed], turned, seed, effort)
    for i, other in zip(signed, others, strict=True):
        falls = _expected(problem, fit, [found[i], other])[1]
        found[i] = other if falls[1] > falls[0] else found[i]
    return found


def at_other_sizes(problem: Problem, fit: Fit, probes: Sequence[Probe], seed: int) -> list[Probe]:
    """Return each probe, or one of another size that is expected to explain more.

    A queue of events that is gross at the size of a probe lets expect nothing of the one that is there, at a tenth of
    it; and nothing shows of a drift as long as it does not reach the threshold within a recording.
    """
    tried = [(i, factor) for i, one in enumerate(probes) for factor in _factors(one)]
    looked_at = [probes[i] for i, _ in tried]
    factors = [np.full(len(one.at), factor) for one, (_, factor) in zip(looked_at, tried, strict=True)]
    others = closer(problem, fit, looked_at, factors, seed, _FAR_EFFORT)
    falls = _expected(problem, fit, [*probes, *others])[1]
    best = list(range(len(probes)))
    for k, (i, _) in enumerate(tried, len(probes)):
        best[i] = k if falls[k] > falls[best[i]] else best[i]
    every = [*probes, *others]
    return [every[k] for k in best]


def _factors(one: Probe) -> tuple[float, ...]:
    """Return at which other sizes a probe is tried, with either sign where its numbers have either."""
    least = [least_size(one.effect, 0.0) * free.coordinate(free.probe) for free in one.free]
    most = [max(abs(end) for end in free.range) for free in one.free]
    sizes = [
        factor for factor in _OTHERWISE
        if all(low <= factor * abs(at) <= high for low, at, high in zip(least, one.at, most, strict=True))
    ]  # fmt: skip
    signed = all(free.signed for free in one.free)
    return (*sizes, *(-factor for factor in sizes)) if signed else tuple(sizes)


def _other_size(one: Probe, share: Floats) -> Floats:
    """Return at which size, beside that of a probe, its numbers are probed again; it is to be seen there."""
    least = [min(WELL_SEEN / max(seen_of(*one.change[:, :, k]), 1e-9), 1.0) for k in range(len(share))]
    smaller = np.where((share > 0.0) & (share < _TOO_LARGE), np.maximum(share, least), 1.0)
    now = np.abs(np.asarray(one.at)) / [free.coordinate(free.probe) for free in one.free]
    smaller = np.maximum(smaller, np.minimum(least_size(one.effect, 0.0) / now, 1.0))
    return np.asarray(np.where(share >= BEYOND, _AT_MOST, smaller))


def _expected(problem: Problem, fit: Fit, probes: Sequence[Probe]) -> tuple[list[Floats], list[float]]:
    """Return the expected size of each effect, beside that of its probe, without sign; and what only it explains."""
    points = problem.measured.points
    residual, jacobian = fit.whiten(fit.residual, points), fit.whiten(fit.jacobian.mean(axis=0), points)
    found = [explain(fit, jacobian, residual, one) for one in probes]
    shares = [np.abs(expected.size / np.asarray(one.at)) for one, expected in zip(probes, found, strict=True)]
    alone = explain(fit, jacobian, residual, None).fall
    return shares, [max(expected.fall - alone, 0.0) for expected in found]
