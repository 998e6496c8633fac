"""From the answers of pixels at a row of contrasts to an S-curve: 50 % point, intercept, floor and plateau.

The 50 % point is the centre of a Gaussian distribution function with free floor and plateau; the intercept comes from
a fit that may be asymmetric. Intervals resample whole pixels (bootstrap).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.analysis.intervals import COVERAGE, share_interval
from bench.analysis.results import Estimate
from bench.analysis.sigmoid import NORMAL, SINH_ARCSINH, Family, Fit, fit_counts, floor_and_plateau

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

__all__ = ["INTERCEPT_LEVEL", "CurveCounts", "CurveFit", "fit_curve"]

INTERCEPT_LEVEL: Final = 0.99
_FEWEST_CONTRASTS: Final = 4
_BOOTSTRAPS: Final = 400
_SEED: Final = 20240901  # fixed: the same run gives the same intervals
_MOST_CLUSTERS: Final = 2048  # more pixels than this are resampled in random groups
_INSIDE: Final = 0.01  # a point counts as inside the transition from 1 % to 99 % of the rise
_FOR_CENTRE: Final = 3  # points inside the transition that fix its centre
_FOR_SHAPE: Final = 5  # points inside that fix its shape; with fewer it is drawn as Gaussian
_SMALLEST_RISE: Final = 0.05
_NEAR_END: Final = 0.1
_AT_END: Final = 0.02
_FEW_NOTE: Final = "few contrasts inside the transition: the interval is the pair that brackets it"
# The free shape is not the true one either: of what it changes against a Gaussian, this part stays in doubt.
_SHAPE_DOUBT: Final = 0.1
_DRAWN_POINTS: Final = 201
_NO_FLOOR: Final = "the curve does not begin at a floor within the contrasts taken; its floor is taken as 0"


@dataclass(frozen=True, slots=True)
class CurveCounts:
    """Answers of each pixel at each contrast."""

    log_contrast: npt.NDArray[np.float64]  #: (n,) ascending, each once
    answers: npt.NDArray[np.int64]  #: (n, pixels)
    trials: npt.NDArray[np.int64]  #: (n, pixels) how often each pixel was asked; 0 where it was off


@dataclass(frozen=True, slots=True)
class CurveFit:
    """What a fit says of an S-curve."""

    probability: npt.NDArray[np.float64]  #: (n,)
    low: npt.NDArray[np.float64]  #: (n,)
    high: npt.NDArray[np.float64]  #: (n,)
    half: Estimate
    intercept: Estimate
    floor: Estimate
    plateau: Estimate
    fit_contrast: npt.NDArray[np.float64]  #: (g,) empty where there is no fit
    fit_probability: npt.NDArray[np.float64]  #: (g,)
    warnings: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Shape:
    """What the points show before anything is fitted."""

    x: npt.NDArray[np.float64]
    p: npt.NDArray[np.float64]
    low: npt.NDArray[np.float64]
    high: npt.NDArray[np.float64]
    rising: npt.NDArray[np.float64]  #: (n,) the nearest curve that never falls
    inside: npt.NDArray[np.bool_]  #: (n,) strictly between floor and plateau
    has_floor: bool = True  #: False: the lowest contrast is inside the transition already


def fit_curve(counts: CurveCounts) -> CurveFit:
    """Fit one S-curve. What the data do not determine is NaN, and its note says why; nothing is raised."""
    shape = _look(counts)
    reason = _unusable(shape)
    if reason:
        return _nothing(shape, reason)
    if not shape.inside.any():
        return _step(counts, shape)
    return _fitted(counts, shape)


def _look(counts: CurveCounts) -> _Shape:
    rows = [share_interval(k, n) for k, n in zip(counts.answers, counts.trials, strict=True)]
    p, low, high = (
        (np.array(column, np.float64) for column in zip(*rows, strict=True)) if rows else (np.zeros(0),) * 3
    )
    weights = counts.trials.sum(axis=1).astype(np.float64)
    if not p.size or not np.all(weights > 0):
        return _Shape(counts.log_contrast, p, low, high, p, np.zeros(p.size, np.bool_))
    rising = rising_means(p, weights)
    shape = _Shape(counts.log_contrast, p, low, high, rising, np.zeros(p.size, np.bool_))
    return replace(shape, inside=_inside(shape, float(rising[0])))


def _inside(shape: _Shape, floor: float) -> npt.NDArray[np.bool_]:
    """Return which points lie between floor and plateau, by their intervals and by 1 % of the rise."""
    plateau = shape.rising[-1]
    margin = _INSIDE * (plateau - floor)
    inside = (shape.p > floor + margin) & (shape.p < plateau - margin)
    return np.asarray(inside & (shape.low > floor) & (shape.high < plateau))


def rising_means(values: npt.NDArray[np.float64], weights: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return the closest values, in weighted least squares, that never fall (pool adjacent violators)."""
    blocks: list[tuple[float, float, int]] = []
    for value, weight in zip(values.tolist(), weights.tolist(), strict=True):
        blocks.append((value, weight, 1))
        while len(blocks) > 1 and blocks[-2][0] >= blocks[-1][0]:
            (a, wa, na), (b, wb, nb) = blocks[-2], blocks[-1]
            blocks[-2:] = [((a * wa + b * wb) / (wa + wb), wa + wb, na + nb)]
    return np.concatenate([np.full(n, value) for value, _, n in blocks])


def _unusable(shape: _Shape) -> str:
    """Return why no threshold can be read off these points; empty where one can."""
    if shape.x.size < _FEWEST_CONTRASTS:
        return f"{shape.x.size} contrasts; at least {_FEWEST_CONTRASTS} are needed"
    if not np.all(np.isfinite(shape.p)):
        return "no pixel was asked at one of the contrasts"
    rise = shape.rising[-1] - shape.rising[0]
    if rise < _SMALLEST_RISE or shape.low[-1] <= shape.high[0]:
        return "the curve is flat: the answers do not rise with contrast"
    return ""


def _unknown(unit: str, note: str) -> Estimate:
    nan = float("nan")
    return Estimate(nan, nan, nan, unit, note)


def _nothing(shape: _Shape, reason: str) -> CurveFit:
    return CurveFit(
        probability=shape.p,
        low=shape.low,
        high=shape.high,
        half=_unknown("ln", reason),
        intercept=_unknown("ln", reason),
        floor=_unknown("1", reason),
        plateau=_unknown("1", reason),
        fit_contrast=np.zeros(0),
        fit_probability=np.zeros(0),
        warnings=(f"no threshold: {reason}",),
    )


def _pooled(counts: CurveCounts, which: npt.NDArray[np.bool_], note: str = "") -> Estimate:
    """Return the share of answers over some contrasts together."""
    share, low, high = share_interval(counts.answers[which].sum(axis=0), counts.trials[which].sum(axis=0))
    return Estimate(share, low, high, "1", note)


def _step(counts: CurveCounts, shape: _Shape) -> CurveFit:
    """Return the result for a curve without a point between floor and plateau: all is between two contrasts."""
    above = shape.rising > 0.5 * (shape.rising[0] + shape.rising[-1])
    first = int(np.argmax(above))
    low, high = float(shape.x[first - 1]), float(shape.x[first])
    middle = 0.5 * (low + high)
    note = "a step: no contrast was taken inside it, the interval is the pair that brackets it"
    edge = Estimate(middle, low, high, "ln", note)
    floor, plateau = _pooled(counts, ~above), _pooled(counts, above)
    return CurveFit(
        probability=shape.p,
        low=shape.low,
        high=shape.high,
        half=edge,
        intercept=edge,
        floor=floor,
        plateau=plateau,
        fit_contrast=np.array([shape.x[0], middle, middle, shape.x[-1]]),
        fit_probability=np.array([floor.value, floor.value, plateau.value, plateau.value]),
        warnings=(),
    )


def _start(family: Family, shape: _Shape) -> npt.NDArray[np.float64]:
    """Return where the fit begins: read off the curve that never falls."""
    floor, plateau = shape.rising[0], shape.rising[-1]
    relative = (shape.rising - floor) / (plateau - floor)
    # A tiny slope makes the levels distinct, which interpolation needs.
    relative = relative + np.arange(relative.size) * 1e-9
    x16, x50, x84 = np.interp([0.16, 0.5, 0.84], relative, shape.x)
    width = max(0.5 * (x84 - x16), 0.2 * float(np.min(np.diff(shape.x))))
    # At an angle of exactly 0 the slope is zero: there the floor stays at 0.
    floor_angle = np.arcsin(np.sqrt(np.clip(floor, 1e-4, 1.0))) if shape.has_floor else 0.0
    plateau_angle = np.arcsin(np.sqrt(np.clip((plateau - floor) / (1.0 - floor), 1e-4, 1.0 - 1e-4)))
    return np.array([x50, np.log(width), *[0.0] * family.extra, floor_angle, plateau_angle])


def _fit(family: Family, shape: _Shape, counts: CurveCounts) -> tuple[Fit, Fit]:
    """Return the fit of the data, and the fits of the bootstrap samples."""
    answers, trials = counts.answers.sum(axis=1)[None], counts.trials.sum(axis=1)[None]
    best = fit_counts(family, _start(family, shape)[None], shape.x, answers / trials, trials.astype(np.float64))
    answers, trials = _resampled(counts)
    start = np.repeat(best.parameters, answers.shape[0], axis=0)
    # Away from the ends of the angles, where the slope is zero and a sample could not leave 0 or 1.
    start[:, -2:] = np.clip(np.abs(start[:, -2:]), 0.01, 0.5 * np.pi - 0.01)
    if not shape.has_floor:
        start[:, -2] = 0.0
    return best, fit_counts(family, start, shape.x, answers / trials, trials)


def _resampled(counts: CurveCounts) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return answers and trials (samples, n) of pixels drawn with replacement."""
    rng = np.random.default_rng(_SEED)
    asked = counts.trials.any(axis=0)
    answers, trials = counts.answers[:, asked].T, counts.trials[:, asked].T
    if answers.shape[0] > _MOST_CLUSTERS:
        groups = rng.permutation(answers.shape[0]) % _MOST_CLUSTERS
        order = np.argsort(groups, kind="stable")
        starts = np.searchsorted(groups[order], np.arange(_MOST_CLUSTERS))
        answers = np.add.reduceat(answers[order], starts, axis=0)
        trials = np.add.reduceat(trials[order], starts, axis=0)
    clusters = answers.shape[0]
    drawn = rng.multinomial(clusters, np.full(clusters, 1.0 / clusters), size=_BOOTSTRAPS).astype(np.float64)
    return drawn @ answers, np.maximum(drawn @ trials, 1e-9)


def _interval(value: float, samples: npt.NDArray[np.float64]) -> tuple[float, float]:
    good = samples[np.isfinite(samples)]
    tail = 50.0 * (1.0 - COVERAGE)
    low, high = np.percentile(good, [tail, 100.0 - tail])
    # The larger of the two reaches, to both sides: of few pixels the samples are skewed the wrong way too often.
    reach = max(value - float(low), float(high) - value)
    return value - reach, value + reach


def _fitted(counts: CurveCounts, shape: _Shape) -> CurveFit:
    gaussian, gaussian_samples = _fit(NORMAL, shape, counts)
    if not _reaches_plateau(gaussian, shape):
        return _nothing(shape, "the curve does not reach a plateau within the contrasts taken")
    if not _starts_at_floor(gaussian, shape):
        shape = replace(shape, has_floor=False, inside=_inside(shape, 0.0))
        gaussian, gaussian_samples = _fit(NORMAL, shape, counts)
    free, free_samples = gaussian, gaussian_samples
    if np.count_nonzero(shape.inside) >= _FOR_SHAPE:
        free, free_samples = _fit(SINH_ARCSINH, shape, counts)
    drawn = np.linspace(shape.x[0], shape.x[-1], _DRAWN_POINTS)
    half = _crossing(0.5, gaussian, gaussian_samples, shape, _FOR_CENTRE)
    intercept = _crossing(INTERCEPT_LEVEL, free, free_samples, shape, _FOR_SHAPE)
    shifted = float((free.quantile(INTERCEPT_LEVEL) - gaussian.quantile(INTERCEPT_LEVEL))[0])
    intercept = _widened(intercept, _SHAPE_DOUBT * shifted)
    return CurveFit(
        probability=shape.p,
        low=shape.low,
        high=shape.high,
        half=half,
        intercept=intercept,
        floor=_level(0, free, free_samples, counts) if shape.has_floor else _unknown("1", _NO_FLOOR),
        plateau=_level(1, free, free_samples, counts),
        fit_contrast=drawn,
        fit_probability=free.probability(drawn)[0],
        warnings=tuple(_notes(half, intercept, shape)),
    )


def _notes(half: Estimate, intercept: Estimate, shape: _Shape) -> Iterator[str]:
    if not shape.has_floor:
        yield _NO_FLOOR
    if not np.isfinite(half.value):
        yield f"no 50 % point: {half.note}"
    if not np.isfinite(intercept.value):
        yield f"no intercept: {intercept.note}"


def _relative(fit: Fit, shape: _Shape) -> npt.NDArray[np.float64]:
    """Return (n,) how far the fit has risen at each contrast: 0 at its floor, 1 at its plateau."""
    floor, plateau = floor_and_plateau(fit.parameters)
    return np.asarray((fit.probability(shape.x)[0] - floor[0]) / max(float(plateau[0] - floor[0]), 1e-12))


def _reaches_plateau(fit: Fit, shape: _Shape) -> bool:
    """Return whether the answers come close to always, or two contrasts lie within a tenth of a lower plateau."""
    return bool(shape.p[-1] > 1.0 - _AT_END or _relative(fit, shape)[-2] > 1.0 - _NEAR_END)


def _starts_at_floor(fit: Fit, shape: _Shape) -> bool:
    """Return whether the answers come close to never, or two contrasts lie within a tenth of a higher floor."""
    return bool(shape.p[0] < _AT_END or _relative(fit, shape)[1] < _NEAR_END)


def _crossing(level: float, fit: Fit, samples: Fit, shape: _Shape, needed: int) -> Estimate:
    """Return where the curve has risen by `level`; with fewer than `needed` points inside, by their spacing."""
    floor, plateau = floor_and_plateau(fit.parameters)
    target = float(floor[0] + level * (plateau[0] - floor[0]))
    value = float(fit.quantile(level)[0])
    if shape.high[-1] < target or shape.low[0] > target:
        return _unknown("ln", f"the curve reaches {level:.0%} of its rise outside the contrasts taken")
    if np.count_nonzero(shape.inside) < needed:
        below, above = _bracket(target, shape)
        # A fit with nothing to hold its width may leave the bracket: then the end that it is nearest to.
        return Estimate(min(max(value, below), above), below, above, "ln", _FEW_NOTE)
    if not shape.x[0] <= value <= shape.x[-1]:
        return _unknown("ln", f"the curve reaches {level:.0%} of its rise outside the contrasts taken")
    return Estimate(value, *_interval(value, samples.quantile(level)), "ln")


def _widened(estimate: Estimate, more: float) -> Estimate:
    """Return the estimate with an interval that reaches further by the size of `more` on both sides."""
    return replace(estimate, low=estimate.low - abs(more), high=estimate.high + abs(more))


def _bracket(target: float, shape: _Shape) -> tuple[float, float]:
    """Return the contrasts between which the curve crosses a probability, whatever its shape.

    They are the highest one that lies below it and the lowest one that lies above, both by their intervals.
    """
    under = np.flatnonzero(shape.high < target)
    # On a plateau with few answers no interval excludes a level just below it; a point on the plateau is above all.
    on_plateau = (shape.rising >= min(target, float(shape.rising[-1]))) & ~shape.inside
    over = np.flatnonzero((shape.low > target) | on_plateau)
    first = int(under[-1]) if under.size else 0
    last = int(over[0])
    return float(shape.x[min(first, last)]), float(shape.x[max(first, last)])


def _level(which: int, fit: Fit, samples: Fit, counts: CurveCounts) -> Estimate:
    """Return the floor (0) or the plateau (1)."""
    value = float(floor_and_plateau(fit.parameters)[which][0])
    low, high = _interval(value, floor_and_plateau(samples.parameters)[which])
    end = np.zeros(counts.log_contrast.size, np.bool_)
    end[-which] = True
    pooled = _pooled(counts, end)
    # Where nothing, or all, was answered, the samples agree; that says nothing of what was not seen.
    if which == 0 and pooled.value == 0.0:
        low, high = 0.0, max(high, pooled.high)
    if which == 1 and pooled.value == 1.0:
        low, high = min(low, pooled.low), 1.0
    return Estimate(value, max(low, 0.0), min(high, 1.0), "1")
