"""Learn which effect is missing, add it, watch the error fall, until nothing more is significant."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.catalogue import candidates, probe_of
from bench.diagnosis.fit import fit, prior_precision, solve
from bench.diagnosis.problem import Slot
from bench.diagnosis.result import Candidate, Diagnosis, Error, Misfit, Step, Value
from bench.diagnosis.screen import probe, score

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import numpy.typing as npt

    from bench.diagnosis.fit import Fit
    from bench.diagnosis.problem import Problem
    from bench.diagnosis.result import Verdict
    from bench.diagnosis.screen import Probe, Scores
    from sim_backend.pixel.model import PixelModel

    Floats = npt.NDArray[np.float64]

__all__ = ["ALPHA", "diagnose", "error_of"]

#: Chance of naming an effect where none is missing, at each step.
ALPHA: Final = 0.01
#: Effects that are refitted where the model is far off.
_SHORTLIST: Final = 4
#: Above this deviance per degree of freedom straight lines do not tell the best effect: the shortlist is refitted.
_FAR_OFF: Final = 1.3
#: Predicted separation, in standard errors, below which two effects cannot be told apart.
_TIED: Final = 2.0
_FOLDS: Final = 5
#: Combinations that vary are scaled to one; the others are left out as zeros.
_LIVE: Final = 1e-5
_IN_A_TIE: Final = 3
_WORST: Final = 5
#: 90 % of a normal law lie within so many standard deviations.
_NINETY: Final = 1.6449


@dataclass(frozen=True)
class Found:
    """A candidate, refitted."""

    effect: str
    fit: Fit
    deviance: float


def diagnose(
    problem: Problem,
    model: PixelModel,
    runs: Sequence[str],
    *,
    most: int = 3,
    seed: int = 1,
    tell: Callable[[str], None] | None = None,
) -> Diagnosis:
    """Return what is missing in a model of a run.

    Parameters
    ----------
    model
        To start from; its base numbers are fitted, and those of the effects that it has.
    most
        Effects that are added at the most.
    seed
        The same seed gives the same verdict.
    tell
        Called with what is being done.
    """
    say = tell or (lambda _: None)
    say("fitting the model")
    slots = problem.base_slots()
    here = fit(problem, model, slots, problem.start(model), seed=seed)
    steps: list[Step] = []
    added: list[str] = []
    ties: dict[str, tuple[str, ...]] = {}
    for number in range(most + 1):
        say(f"step {number}: looking for what is missing")
        probes = probe(problem, here, candidates(here.model, problem.points), seed + 100 * number + 11, {})
        scores = score(problem, here, probes, seed)
        best, refitted, tied = _choose(problem, here, scores, seed + 100 * number + 21, say)
        steps.append(_step(problem, number, added[-1] if added else None, here, scores, refitted, tied))
        if best is None or number == most:
            break
        added.append(best.effect)
        ties[best.effect] = tied
        here = best.fit
    verdict = _verdict(problem, here, added)
    return Diagnosis(
        runs=tuple(runs),
        findings=(),
        steps=tuple(steps),
        verdict=verdict,
        missing=tuple(added),
        ties={k: v for k, v in ties.items() if v},
        model=here.model,
    )


def _choose(
    problem: Problem, here: Fit, scores: Scores, seed: int, say: Callable[[str], None]
) -> tuple[Found | None, dict[str, float], tuple[str, ...]]:
    """Return the effect that is added, refitted; the falls of all that were refitted; and what it is tied with."""
    significant = [i for i in np.argsort(scores.p_best, kind="stable") if scores.p_best[i] < ALPHA]
    significant.sort(key=lambda i: (scores.p_best[i], -scores.drop[i]))
    if not significant:
        return None, {}, ()
    before = deviance(problem, here)
    far_off = before / freedom(here) > _FAR_OFF
    shortlist = sorted(significant, key=lambda i: -scores.drop[i])[: _SHORTLIST if far_off else 1]
    found = []
    for i in shortlist:
        say(f"refitting with {scores.probes[i].effect.id}")
        fitted = refit(problem, here, scores.probes[i], scores.size[i], seed)
        found.append(Found(scores.probes[i].effect.id, fitted, deviance(problem, fitted)))
    found.sort(key=lambda f: f.deviance)
    falls = {f.effect: before - f.deviance for f in found}
    best = found[0]
    number = next(i for i, p in enumerate(scores.probes) if p.effect.id == best.effect)
    tied = _tied(scores, number, found)
    return best, falls, tied


def _tied(scores: Scores, best: int, found: Sequence[Found]) -> tuple[str, ...]:
    """Return the effects that the data cannot tell from the best."""
    size = math.sqrt(max(scores.drop[best], 0.0))
    rivals = []
    falls = {f.effect: f.deviance for f in found}
    for i, one in enumerate(scores.probes):
        if i == best or scores.drop[i] <= 0.0:
            continue
        apart = size * math.sqrt(max(1.0 - scores.likeness[best, i] ** 2, 0.0))
        if one.effect.id in falls:
            chance = 2.0 * math.sqrt(2.0 * len(falls))
            if falls[one.effect.id] - found[0].deviance > _TIED**2 + chance:
                continue
            rivals.append((apart, one.effect.id))
        elif apart < _TIED:
            rivals.append((apart, one.effect.id))
    return tuple(name for _, name in sorted(rivals)[: _IN_A_TIE - 1])


def refit(problem: Problem, here: Fit, one: Probe, size: Floats, seed: int) -> Fit:
    """Return the model with an effect more, fitted from the size that the screen expects."""
    coordinates = []
    values = {}
    for free, at, expected in zip(one.free, one.at, size, strict=True):
        signed = free.range[0] < 0.0
        start = expected if signed and expected != 0.0 else min(max(expected, 0.1 * at), 5.0 * at)
        coordinates.append(start)
        values[free.name] = free.value(start)
    effect = probe_of(one.effect, values)
    slots = (*here.slots, *(Slot(f) for f in one.free))
    return fit(problem, here.model + effect, slots, [*here.x, *coordinates], seed=seed, iterations=5)


def deviance(problem: Problem, one: Fit) -> float:
    """Return the sum of squares of the independent residuals."""
    r = one.whiten(one.residual, problem.measured.points)
    return float(r @ r)


def freedom(one: Fit) -> int:
    """Return the number of independent residuals less that of the fitted numbers."""
    live = sum(int(np.count_nonzero(np.abs(root).sum(axis=1) > _LIVE)) for root in one.roots)
    return max(live - len(one.slots), 1)


def error_of(problem: Problem, one: Fit) -> Error:
    """Return the error of a fitted model."""
    responses = [i for i, label in enumerate(problem.measured.labels) if label.view == "response"]
    apart = problem.measured.ratio[responses] - one.ratio[responses]
    return Error(
        deviance_per_dof=deviance(problem, one) / freedom(one),
        response_rmse=float(np.sqrt(np.nanmean(apart**2))) if responses else math.nan,
        heldout_deviance_per_dof=heldout(problem, one),
    )


def heldout(problem: Problem, one: Fit) -> float:
    """Return the deviance per statistic on points that the fit did not see: folds of whole points.

    The numbers are fitted again to the other points, along the changes by coordinate that are known at the solution.
    """
    points = problem.measured.points
    jacobian = one.jacobian.mean(axis=0)
    parts = [
        (root @ one.residual[where] / math.sqrt(one.scale), root @ jacobian[where] / math.sqrt(one.scale),
         int(np.count_nonzero(np.abs(root).sum(axis=1) > _LIVE)))
        for root, where in zip(one.roots, points, strict=True)
    ]  # fmt: skip
    squares, freedom = 0.0, 0
    prior = prior_precision(one.slots)
    for fold in range(min(_FOLDS, len(points))):
        seen = [p for i, p in enumerate(parts) if i % _FOLDS != fold]
        unseen = [p for i, p in enumerate(parts) if i % _FOLDS == fold]
        if not seen or not unseen:
            continue
        delta = solve(np.concatenate([j for _, j, _ in seen]), np.concatenate([r for r, _, _ in seen]), prior)
        squares += sum(float(np.sum((r - j @ delta) ** 2)) for r, j, _ in unseen)
        freedom += sum(n for _, _, n in unseen)
    return squares / max(freedom, 1)


def values_of(problem: Problem, one: Fit) -> dict[str, Value]:
    """Return the fitted numbers with 90 % intervals."""
    sd = np.sqrt(np.diag(one.covariance(problem.measured.points)))
    found = {}
    for slot, x, s in zip(one.slots, one.x, sd, strict=True):
        ends = sorted((slot.free.value(x - _NINETY * s), slot.free.value(x + _NINETY * s)))
        found[slot.key(problem.settings)] = Value(slot.free.value(x), ends[0], ends[1], slot.free.unit)
    return found


def _step(
    problem: Problem, number: int, added: str | None, here: Fit, scores: Scores, refitted: dict[str, float],
    tied: tuple[str, ...],
) -> Step:  # fmt: skip
    best = max(refitted, key=lambda name: refitted[name]) if refitted else None
    rows = []
    for i in np.argsort(-scores.drop, kind="stable"):
        one = scores.probes[i]
        seen = float(scores.seen[i])
        smallest = (
            one.free[0].value(one.at[0] * _DETECTED / seen) if seen > 0.0 and one.free[0].scale != "inverse" else None
        )
        rows.append(
            Candidate(
                one.effect.id,
                float(scores.drop[i]),
                refitted.get(one.effect.id),
                float(scores.p_best[i]),
                tied if one.effect.id == best else (),
                smallest,
            )
        )
    return Step(
        number,
        added,
        tuple(dict.fromkeys([*(s.free.owner for s in here.slots), *(e.id for e in here.model.effects)])),
        error_of(problem, here),
        values_of(problem, here),
        tuple(rows),
        worst_of(problem, here),
    )


#: Standard errors at which an effect is found as a rule.
_DETECTED: Final = 4.5


def worst_of(problem: Problem, one: Fit) -> tuple[Misfit, ...]:
    """Return the statistics that are furthest off."""
    z = one.z
    found = []
    for i in np.argsort(-np.abs(z), kind="stable")[:_WORST]:
        label = problem.measured.labels[i]
        view = label.view if label.part == "both" else f"{label.view}_{label.part}"
        found.append(
            Misfit(
                view, label.point, label.baseline_lux, label.log_contrast,
                float(problem.measured.ratio[i]), float(one.ratio[i]), float(z[i]),
            )
        )  # fmt: skip
    return tuple(found)


def _verdict(problem: Problem, here: Fit, added: Sequence[str]) -> Verdict:
    n = freedom(here)
    left = (deviance(problem, here) - n) / math.sqrt(2.0 * n * (1.0 + 0.25))
    if left > 4.0:
        return "unexplained"
    return "explained" if added else "nothing_missing"
