"""The fit of a family of S-curves: one sensor, one dark light, all levels at once.

What is fitted are means over the pixels: the share of answers at each contrast, the latencies, and how much the
answers of single pixels agree with each other, which is the mismatch. Each is weighed by its own scatter; how well
the numbers are then known follows from the pixels, each of which pulls the result its own way (the sandwich estimate
of a robust covariance: P. J. Huber, "The behavior of maximum likelihood estimates under nonstandard conditions",
Proc. 5th Berkeley Symp., 1967). The pulses of one pixel need not be independent, nor its answers at different levels.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.analysis.results import Estimate
from bench.characterize.family_model import Expected, Family, expected
from bench.characterize.normal import as_estimate

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.characterize.levels import Level

    Floats = npt.NDArray[np.float64]

__all__ = ["NAMES", "FamilyFit", "Known", "fit_family"]

NAMES: Final = tuple(field.name for field in fields(Family))
#: Latencies hold more than the low-pass: they are believed to this part of them at the best.
_LATENCY_BELIEVED: Final = 0.01
_MOST_STEPS: Final = 40
_REACH, _FARTHEST = 4.0, 12.0  # of a step of the fit, in scales: of the first one, and at the most
_LITTLE: Final = 0.01  # of chi-square: a fit that promises no more is there
_KEPT: Final = 0.5  # of the promised fall: derivatives that did no better are worked out again
#: A share is expected no better than a threshold that is off by this part of the noise lets it.
_BELIEVED: Final = 0.005
_ARMED_ROUNDS: Final = 3
_STEP: Final = 0.1  # of the scale of a number, for derivatives
_CLEARLY: Final = 3.0  # standard errors
#: Of the low-pass's time constant: as much as a photoreceptor may be too fast by chance, at the dimmest level.
_LITTLE_LAG: Final = 0.15
_BEYOND: Final = 0.02  # of a threshold's change that no other number can make: less is none
_TINY: Final = 1e-12


@dataclass(frozen=True, slots=True)
class Known:
    """What is known beside the curves."""

    other_ratio: float  #: threshold of the other polarity / that of this one
    filter_sd: float = math.inf  #: standard error of the optical density of the filters; infinite: not known


@dataclass(frozen=True)
class FamilyFit:
    """A sensor, as a family of S-curves of one polarity shows it."""

    family: Family
    free: tuple[str, ...]  #: names of the numbers that were fitted
    covariance: Floats  #: (f, f) of them
    chi2: float
    dof: int
    level_theta: tuple[Estimate, ...]  #: threshold at each level by itself, dark light accounted for
    constant: tuple[float, int]  #: chi-square of these against one threshold, and its degrees of freedom

    def sd(self, name: str) -> float:
        """Return the standard error of a number, widened where the fit is poor; 0 where it was not fitted."""
        if name not in self.free:
            return 0.0
        i = self.free.index(name)
        return math.sqrt(max(float(self.covariance[i, i]), 0.0) * max(1.0, self.chi2 / max(self.dof, 1)))

    @property
    def sees_slow(self) -> bool:
        """Whether a photoreceptor with a time constant of its own is seen beyond chance."""
        return self.family.slow_s_lux > _CLEARLY * self.sd("slow_s_lux") > 0.0

    def at(self, baseline_lux: float, nd_od: float) -> tuple[float, float]:
        """Return noise rms, ln, and corner of the photoreceptor, Hz (infinite: not seen), at a light level."""
        f = self.family
        total = baseline_lux * 10.0 ** (-f.filter_od if nd_od > 0.0 else 0.0) + f.dark_lux
        noise = math.sqrt(max(f.noise_rms**2 + f.shot_lux / total, 0.0))
        return noise, total / (2.0 * math.pi * f.slow_s_lux) if self.sees_slow else math.inf

    def estimate(self, name: str, unit: str) -> Estimate:
        """Return a number with its 90 % interval."""
        return as_estimate(float(getattr(self.family, name)), self.sd(name), unit)


def _armed(level: Level, share: Floats) -> float:
    """Return the share of pulses that found a pixel armed: the plateau of a level, by least squares.

    It is no number of the sensor, and differs from level to level: noise events before the pulse blind a pixel.
    """
    least, armed = 0.5 / (level.share.shape[0] * level.pulses), float(level.mean.max())
    for _ in range(_ARMED_ROUNDS):
        chance = np.clip(armed * share, least, 1.0 - least)
        weight = level.pulses / (chance * (1.0 - chance))
        armed = float((weight * share) @ level.mean / ((weight * share) @ share))
    return armed


class _Problem:
    """Measured and expected means, weighed."""

    def __init__(self, levels: Sequence[Level], known: Known, start: Family, free: Sequence[str]) -> None:
        self.levels, self.known, self.start, self.free = levels, known, start, tuple(free)
        self.pixels = levels[0].share.shape[0]
        self._seen: dict[tuple[int, Family], Expected] = {}
        self.own, self.latency, self.latency_chance = self._measured()
        self.latency_sd = np.hypot(self.latency_chance, _LATENCY_BELIEVED * self.latency)
        self.mean = self.own.mean(axis=0)
        self.weight = self.law = np.ones(0)
        self.weigh(start)

    def _measured(self) -> tuple[Floats, Floats, Floats]:
        """Return each pixel's shares and products (pixels, s), the latencies (k,) and their errors."""
        columns = [level.share for level in self.levels]
        for level in self.levels:
            centred = level.share - level.share.mean(axis=0)
            both = centred[:, ::2].sum(axis=1) * centred[:, 1::2].sum(axis=1)
            columns.append(both[:, None] * self.pixels / (self.pixels - 1.0))
        latency = np.concatenate([level.latency_s for level in self.levels])
        sd = np.concatenate([level.latency_sd_s for level in self.levels])
        return np.concatenate(columns, axis=1), latency, sd

    def expect(self, family: Family) -> tuple[Floats, Floats, Floats]:
        """Return what is expected of the means (s,), of the latencies (k,), and the variance of one pixel's share."""
        seen = [self._expected(number, family) for number in range(len(self.levels))]
        share = np.concatenate(
            [_armed(level, one.share) * one.share for level, one in zip(self.levels, seen, strict=True)]
        )
        spread = np.concatenate([one.spread for one in seen])
        pulses = np.concatenate([level.pulses for level in self.levels])
        # A share of almost none or all is known no better than from half an answer more or less.
        least = 0.5 / (self.pixels * pulses)
        chance = np.clip(share, least, 1.0 - least)
        variance = chance * (1.0 - chance) / pulses + spread * (1.0 - 1.0 / pulses)
        # Of the products of one level only chance: mismatch shows above it.
        return (
            np.concatenate([share, [one.frozen for one in seen]]),
            np.concatenate([one.latency_s for one in seen]) + family.delay_s,
            variance,
        )

    def _expected(self, number: int, family: Family) -> Expected:
        """Return what a level shows without a delay; a sensor that looks the same there is not worked out again."""
        level = self.levels[number]
        alike = replace(family, delay_s=0.0, filter_od=family.filter_od if level.key.nd_od > 0.0 else 0.0)
        if (number, alike) not in self._seen:
            self._seen[number, alike] = expected(level, alike, self.known.other_ratio)
        return self._seen[number, alike]

    def weigh(self, family: Family) -> None:
        """Let each mean count by the scatter that a sensor lets expect."""
        from scipy.special import ndtri

        variance = self.expect(family)[2]
        products = self.own[:, variance.size :].var(axis=0)
        by_chance = np.concatenate([variance, np.maximum(products, _TINY)]) / self.pixels
        # The law itself is right to a small part of the noise.
        score = ndtri(np.clip(self.mean[: variance.size], _TINY, 1.0 - _TINY))
        law = np.zeros_like(by_chance)
        law[: variance.size] = (_BELIEVED * np.exp(-0.5 * score**2) / math.sqrt(2.0 * math.pi)) ** 2
        self.weight = 1.0 / (by_chance + law)
        self.law = law * self.weight

    def family(self, x: Floats) -> Family:
        """Return the sensor at some values of the free numbers."""
        return replace(self.start, **dict(zip(self.free, (float(v) for v in x), strict=True)))

    def only(self, number: int, column: Floats) -> Floats:
        """Return (r,) a column of changes, of the shares of one level alone."""
        first = sum(level.contrast.size for level in self.levels[:number])
        found = np.zeros_like(column)
        mine = slice(first, first + self.levels[number].contrast.size)
        found[mine] = column[mine]
        return found

    def scatter(self, pull: Floats) -> Floats:
        """Return (f, f) the covariance of sums of residuals with weights (r, f), from the scatter of the data.

        How far the law is believed has no part in it: it only keeps one mean that is known very well from deciding
        alone.
        """
        s, k = self.mean.size, self.latency.size
        by_pixel = (self.own - self.mean) * np.sqrt(self.weight) @ pull[:s]
        chance = by_pixel.T @ by_pixel / self.pixels / (self.pixels - 1.0)
        late = pull[s : s + k] * (self.latency_chance / self.latency_sd)[:, None]
        return np.asarray(chance + late.T @ late + pull[s + k :].T @ pull[s + k :])

    def doubt(self, pull: Floats) -> Floats:
        """Return (f, f) the same from how far the law is believed."""
        s, k = self.mean.size, self.latency.size
        late = pull[s : s + k] * np.sqrt(1.0 - (self.latency_chance / self.latency_sd) ** 2)[:, None]
        return np.asarray((pull[:s].T * self.law) @ pull[:s] + late.T @ late)

    def means(self, x: Floats) -> Floats:
        """Return (s + k,) what is expected of the means and of the latencies."""
        return np.concatenate(self.expect(self.family(x))[:2])

    def residuals(self, x: Floats) -> Floats:
        """Return what is measured less what is expected, in standard errors; then what is known beforehand."""
        off = (np.concatenate([self.mean, self.latency]) - self.means(x)) * self._by_error()
        return np.concatenate([off, -x[self._told()] / self.known.filter_sd])

    def jacobian(self, slopes: Floats) -> Floats:
        """Return (r, f) the derivatives of the residuals, from those of what is expected."""
        told = np.eye(slopes.shape[1])[self._told()]
        return np.concatenate([-slopes * self._by_error()[:, None], -told / self.known.filter_sd])

    def _by_error(self) -> Floats:
        return np.concatenate([np.sqrt(self.weight), 1.0 / self.latency_sd])

    def _told(self) -> list[int]:
        """Return the places of the numbers that are known beforehand to be about 0."""
        known = "filter_od" in self.free and math.isfinite(self.known.filter_sd)
        return [self.free.index("filter_od")] if known else []


def fit_family(levels: Sequence[Level], known: Known, start: Family, free: Sequence[str] = NAMES) -> FamilyFit:
    """Fit the numbers named in `free` to the curves of one polarity; the others stay as in `start`.

    Derivatives are dear. They are brought forward from step to step by what the step itself showed (C. G. Broyden,
    "A class of methods for solving nonlinear simultaneous equations", Math. Comp. 19, 1965), and worked out again
    where a step did not keep its promise, and before the fit is called done.
    """
    problem = _Problem(levels, known, start, free)
    x = np.array([getattr(start, name) for name in free])
    scale = np.array([_scale(name, start) for name in free])
    slopes, worked_out, reach = _slopes(problem, x, scale), True, _REACH
    for _ in range(_MOST_STEPS):
        to, promised = _next(problem, x, reach * scale, problem.jacobian(slopes), problem.residuals(x))
        at, fell = _downhill(problem, x, to) if promised > _LITTLE else (x, 0.0)
        if worked_out and fell < _LITTLE:
            break
        worked_out = fell < _KEPT * promised
        reach = max(0.5 * reach, 1.0) if worked_out else min(2.0 * reach, _FARTHEST)
        slopes = _slopes(problem, at, scale) if worked_out else _learned(problem, slopes, (x, at), scale)
        x = at
        problem.weigh(problem.family(x))
    return _result(problem, x, scale)


def _next(
    problem: _Problem, x: Floats, reach: Floats, jacobian: Floats, residual: Floats
) -> tuple[Floats, float]:  # fmt: skip
    """Return where a straight-line model has its least squares, within bounds and reach, and by how much less."""
    from scipy.optimize import lsq_linear

    low, high = _bounds(problem)
    down, up = np.maximum(low - x, -reach) / reach, np.minimum(high - x, reach) / reach
    step = lsq_linear(jacobian * reach, -residual, (down - _TINY, up + _TINY))
    return x + step.x * reach, float(residual @ residual) - 2.0 * float(step.cost)


def _downhill(problem: _Problem, x: Floats, to: Floats) -> tuple[Floats, float]:
    """Return the end of a step, shortened until it goes downhill, and by how much chi-square fell."""
    residual = problem.residuals(x)
    before = float(residual @ residual)
    for part in (1.0, 0.4, 0.15, 0.05):
        at = x + part * (to - x)
        there = problem.residuals(at)
        if float(there @ there) < before:
            return at, before - float(there @ there)
    return x, 0.0


def _bounds(problem: _Problem) -> tuple[Floats, Floats]:
    dimmest = min(level.key.baseline_lux for level in problem.levels)
    bounds = {
        "theta": (0.1 * problem.start.theta, 10.0),
        "noise_rms": (1e-3, 2.0),
        "dark_lux": (-0.5 * dimmest, math.inf),
        "dark_spread2": (-1.0, 2.0),
        "slow_s_lux": (-_LITTLE_LAG * math.exp(problem.start.ln_tau) * (dimmest + problem.start.dark_lux), math.inf),
        "filter_od": (-1.0, 1.0),
    }
    low, high = zip(*(bounds.get(name, (-math.inf, math.inf)) for name in problem.free), strict=True)
    return np.array(low), np.array(high)


def _scale(name: str, start: Family) -> float:
    """Return a step of a number that changes curves by a little."""
    return {
        "theta": 0.2 * start.noise_rms,
        "noise_rms": 0.1 * start.noise_rms,
        "mismatch2": (0.3 * start.noise_rms) ** 2,
        "ln_tau": 0.1,
        "delay_s": 0.1 * math.exp(start.ln_tau),
        "dark_lux": 0.1 * max(start.dark_lux, 0.02),
        "dark_spread2": 0.01,
        "shot_lux": 0.2 * start.noise_rms**2 * 0.2,
        "slow_s_lux": max(0.2 * start.slow_s_lux, 0.1 * math.exp(start.ln_tau)),
        "filter_od": 0.02,
    }[name]


def _slopes(problem: _Problem, x: Floats, scale: Floats) -> Floats:
    """Return (s + k, f) the derivatives of what is expected."""
    here = problem.means(x)
    steps = _STEP * scale
    return np.stack(
        [(problem.means(x + np.eye(x.size)[i] * steps[i]) - here) / steps[i] for i in range(x.size)], axis=1
    )


def _learned(problem: _Problem, slopes: Floats, step: tuple[Floats, Floats], scale: Floats) -> Floats:
    """Return derivatives that would have foretold a step from one place to the next: Broyden's, by the scales."""
    before, after = step
    moved = (after - before) / scale
    missed = problem.means(after) - problem.means(before) - slopes @ (after - before)
    return np.asarray(slopes + np.outer(missed / float(moved @ moved), moved / scale))


def _result(problem: _Problem, x: Floats, scale: Floats) -> FamilyFit:
    jacobian = problem.jacobian(_slopes(problem, x, scale))
    residual = problem.residuals(x)
    # By the scale of each number: squares of their units are many orders apart.
    pull = -(np.linalg.pinv(jacobian * scale, rcond=_TINY).T * scale).T  # (f, r)
    theta = problem.free.index("theta")
    own = np.stack([problem.only(k, jacobian[:, theta]) for k in range(len(problem.levels))], axis=1)
    return FamilyFit(
        family=problem.family(x),
        free=problem.free,
        covariance=problem.scatter(pull.T),
        chi2=float(residual @ residual),
        dof=residual.size - x.size,
        level_theta=tuple(_level_theta(problem, float(x[theta]), column, residual) for column in own.T),
        constant=_constant(problem, own, jacobian, residual),
    )


def _level_theta(problem: _Problem, theta: float, column: Floats, residual: Floats) -> Estimate:
    """Return the threshold that the answers at one level tell, all else as it was fitted to all levels."""
    if not np.any(column):
        return Estimate(math.nan, math.nan, math.nan, "ln", "its answers do not tell")
    pull = -column / float(column @ column)
    sd = math.sqrt(float(problem.scatter(pull[:, None])[0, 0]))
    return as_estimate(theta + float(pull @ residual), sd, "ln")


def _constant(problem: _Problem, own: Floats, jacobian: Floats, residual: Floats) -> tuple[float, int]:
    """Return chi-square of thresholds that differ between levels, and its degrees of freedom (a score test).

    What such thresholds would change, less what the numbers of the fit can change too: one threshold, dark light, and
    a filter's density take their share.
    """
    taken, _ = np.linalg.qr(jacobian / np.maximum(np.linalg.norm(jacobian, axis=0), _TINY))
    beyond = own / np.maximum(np.linalg.norm(own, axis=0), _TINY)
    beyond = beyond - taken @ (taken.T @ beyond)
    left, size, _ = np.linalg.svd(beyond, full_matrices=False)
    left = left[:, size > _BEYOND]
    if not left.shape[1]:
        return 0.0, 0
    score = left.T @ residual
    return float(score @ np.linalg.solve(problem.scatter(left) + problem.doubt(left), score)), left.shape[1]
