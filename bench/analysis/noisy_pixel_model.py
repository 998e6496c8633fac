"""Answers and latencies of an array of noisy pixels: what is expected of them, and how likely data then are."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Final, Protocol

import numpy as np

from bench.analysis.first_passage import ArmedPixel, grid_shift, survival_table

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.analysis.results import ResponseRow

    Floats = npt.NDArray[np.float64]

__all__ = [
    "Answers",
    "Conditions",
    "Latencies",
    "LatencyModel",
    "Pixels",
    "Survival",
    "gauss_nodes",
    "goodness",
    "log_likelihood",
    "probability",
    "unanswered_over_time",
]

_LEAST: Final = 1e-9  # no chance is taken as smaller than this, so that one odd event does not decide alone
_LEAST_THRESHOLD: Final = 0.001  # ln units
_REACH: Final = 4.5  # where the normal law of the thresholds ends, in its sigma
_LATENCY_BINS: Final = 40
_LATENCY_CURVES: Final = 12
_LATENCY_NODES: Final = 5  # thresholds over which latencies are averaged
_LEAST_ANSWERS: Final = 100  # answers that a contrast needs for its latencies to be used
_LEAST_SHARE: Final = 0.3  # of the pulses, likewise
_TIE: Final = 1e-6  # an edge this close to a look, in looks, is at it
_WITHIN: Final = 3.0  # how far from the end of the table latencies are still taken from it, sigma
_LEAST_COUNT: Final = 5.0  # expected answers, and missing ones, that a contrast needs to be judged by chi-square


class Survival(Protocol):
    """Chances of no answer to steps, on the barriers of the universal table: see `SurvivalTable`."""

    @property
    def time(self) -> Floats:
        """(t,) times, units of tau."""
        ...

    def from_steps(self, time: float, step: Floats) -> Floats:
        """Return (m, h) the survival at one time."""
        ...

    def over_time(self, step: Floats) -> Floats:
        """Return (m, h, t) the survival at all times."""
        ...


@dataclass(frozen=True, slots=True)
class Pixels:
    """What is to be found."""

    theta: float  #: mean threshold of the array, ln units
    noise_rms: float  #: ln units, behind the low-pass
    mismatch: float  #: sigma of the threshold over the pixels, ln units
    plateau: float  #: chance that a pixel is armed at the step
    other_ratio: float  #: threshold of the other polarity / theta


@dataclass(frozen=True, slots=True)
class Conditions:
    """What is held fixed while pixels are fitted."""

    tau_s: float  #: time constant of the low-pass, s
    window_s: float  #: response window, s
    armed_s: float  #: time between the memorising of the reference and the step, s
    grid_s: float  #: time between two looks of the comparators, s; 0 for a comparator that never looks away


@dataclass(frozen=True, slots=True)
class Answers:
    """The counts of one S-curve."""

    contrast: Floats  #: (m,) ascending
    pulses: Floats  #: (m,)
    counts: Floats  #: (pixels, m)

    @classmethod
    def of(cls, rows: Sequence[ResponseRow], most_pixels: int, seed: int) -> Answers:
        """Gather rows in order of contrast; of more than `most_pixels` pixels, take that many drawn by `seed`."""
        counts = np.stack([row.per_pixel for row in rows], axis=1).astype(np.float64)
        if len(counts) > most_pixels:
            counts = counts[np.random.default_rng(seed).choice(len(counts), most_pixels, replace=False)]
        contrast = np.array([row.log_contrast for row in rows])
        return cls(contrast, np.array([float(row.pulses) for row in rows]), counts)

    @property
    def share(self) -> Floats:
        """Return (m,) the share of pulses answered."""
        return np.asarray(self.counts.mean(axis=0) / self.pulses)


def probability(
    theta: Floats, pixels: Pixels, conditions: Conditions, contrast: Floats, table: Survival | None = None
) -> Floats:
    """Return (n, m) the chance that a pixel of each threshold (n,) or (n, m) answers each contrast (m,).

    Levels go into the universal table in units of the noise, times in units of tau; on a time grid both barriers act
    as higher ones. Another `table` holds for steps that are not as fast as the low-pass lets them be.
    """
    shift = grid_shift(conditions.grid_s / conditions.tau_s)
    step = contrast / pixels.noise_rms
    survival = (table or survival_table()).from_steps(conditions.window_s / conditions.tau_s, step)
    pixel = _armed_pixel(pixels, conditions)
    missed = pixel.unanswered(theta / pixels.noise_rms + shift, step, survival)
    return np.asarray(np.clip(pixels.plateau * (1.0 - missed), _LEAST, 1.0 - _LEAST))


def _armed_pixel(pixels: Pixels, conditions: Conditions) -> ArmedPixel:
    shift = grid_shift(conditions.grid_s / conditions.tau_s)
    other = pixels.other_ratio * pixels.theta / pixels.noise_rms + shift
    return ArmedPixel(conditions.armed_s / conditions.tau_s, other)


@dataclass(frozen=True, slots=True)
class Nodes:
    """Thresholds at which the array is looked at: coarse ones for the physics, fine ones for each pixel's counts."""

    coarse: Floats  #: (n,) in sigma of the mismatch
    between: Floats  #: (g, n) weights of the coarse ones in a cubic interpolation to the fine ones
    weight: Floats  #: (g,) of the fine ones, sum 1

    @classmethod
    def for_fit(cls, start: Pixels, answers: Answers) -> Nodes:
        """Choose nodes near enough for the mismatch, noise and number of pulses at hand."""
        from scipy.interpolate import CubicSpline

        reach = 2.0 * _REACH
        n = int(np.clip(reach * start.mismatch / (0.5 * start.noise_rms), 6, 60)) + 1
        pulses_per_rms = float(answers.pulses.mean() * start.noise_rms / np.diff(answers.contrast).mean())
        own = 0.75 * start.noise_rms / math.sqrt(max(pulses_per_rms, 1.0))  # how well a pixel's counts tell it
        g = int(np.clip(reach * start.mismatch / own, 20, 400)) + 1
        coarse, fine = np.linspace(-_REACH, _REACH, n), np.linspace(-_REACH, _REACH, g)
        weight = np.exp(-0.5 * fine**2)
        return cls(coarse, CubicSpline(coarse, np.eye(n))(fine), weight / weight.sum())


def _array_probability(pixels: Pixels, conditions: Conditions, contrast: Floats, nodes: Nodes) -> Floats:
    """Return (g, m) the chance of an answer at the fine nodes."""
    from scipy.special import expit, logit

    theta = np.maximum(pixels.theta + pixels.mismatch * nodes.coarse, _LEAST_THRESHOLD)
    coarse = probability(theta, pixels, conditions, contrast)
    return np.asarray(expit(nodes.between @ logit(coarse)))


def log_likelihood(pixels: Pixels, conditions: Conditions, answers: Answers, nodes: Nodes) -> float:
    """Return the log-likelihood of all counts: binomial for a threshold, averaged over thresholds for each pixel."""
    p = _array_probability(pixels, conditions, answers.contrast, nodes)
    each = answers.counts @ np.log(p).T + (answers.pulses - answers.counts) @ np.log1p(-p).T
    best = each.max(axis=1, keepdims=True)
    return float(np.sum(best[:, 0] + np.log(np.exp(each - best) @ nodes.weight)))


def goodness(pixels: Pixels, conditions: Conditions, answers: Answers, nodes: Nodes) -> tuple[float, int]:
    """Return chi-square of the array's counts and the number of contrasts that it is made of.

    The covariance of the counts of two contrasts is that of pixels that keep their threshold.
    """
    p = _array_probability(pixels, conditions, answers.contrast, nodes)
    mean = nodes.weight @ p
    n = len(answers.counts)
    expected = n * answers.pulses * mean
    judged = (expected > _LEAST_COUNT) & (n * answers.pulses - expected > _LEAST_COUNT)
    centred = (p - mean) * answers.pulses
    covariance = (centred * nodes.weight[:, None]).T @ centred
    covariance += np.diag(answers.pulses * (nodes.weight @ (p * (1.0 - p))))
    off = (answers.counts.sum(axis=0) - expected)[judged]
    return float(off @ np.linalg.solve(n * covariance[np.ix_(judged, judged)], off)), int(judged.sum())


def curve(pixels: Pixels, conditions: Conditions, contrast: Floats, nodes: Nodes) -> Floats:
    """Return (m,) the array's average response."""
    return np.asarray(nodes.weight @ _array_probability(pixels, conditions, contrast, nodes))


@dataclass(frozen=True, slots=True)
class Latencies:
    """Latencies of the answers to some contrasts, in bins of about equal counts."""

    contrast: Floats  #: (k,)
    edges_s: tuple[Floats, ...]  #: for each contrast (b + 1,)
    counts: tuple[Floats, ...]  #: for each contrast (b,)

    @classmethod
    def of(cls, rows: Sequence[ResponseRow], grid_s: float = 0.0) -> Latencies:
        """Gather the latencies of contrasts that many pulses of are answered.

        On a time grid an event carries the time of the look at which the crossing was found, at the end of a step.
        """
        good = [r for r in rows if r.latency_counts.sum() >= _LEAST_ANSWERS and r.probability > _LEAST_SHARE]
        if len(good) > _LATENCY_CURVES:
            good = [good[i] for i in np.linspace(0, len(good) - 1, _LATENCY_CURVES).round().astype(int)]
        binned = [_equal_bins(_crossed_by(r.latency_edges_s, grid_s), r.latency_counts) for r in good]
        return cls(
            np.array([r.log_contrast for r in good]),
            tuple(edges for edges, _ in binned),
            tuple(counts for _, counts in binned),
        )

    def part(self, keep: npt.NDArray[np.bool_]) -> Latencies:
        """Return those of some contrasts."""
        chosen = np.flatnonzero(keep)
        return Latencies(
            self.contrast[keep], tuple(self.edges_s[i] for i in chosen), tuple(self.counts[i] for i in chosen)
        )


def _crossed_by(edges_s: Floats, grid_s: float) -> Floats:
    """Return by when the events stamped before each edge had crossed: the last look before it."""
    if grid_s <= 0.0:
        return edges_s
    looks = np.ceil(edges_s / grid_s - _TIE) - 1.0
    return np.maximum(looks, 0.0) * grid_s


def _equal_bins(edges_s: Floats, counts: npt.NDArray[np.int64]) -> tuple[Floats, Floats]:
    total = np.concatenate(([0], np.cumsum(counts)))
    wanted = np.linspace(0.0, total[-1], _LATENCY_BINS + 1)[1:-1]
    at = np.unique(np.concatenate(([0], np.searchsorted(total, wanted), [counts.size])))
    # Where edges coincide, the last of them has all the counts before it.
    at = at[np.append(np.diff(edges_s[at]) > 0.0, True)]
    at[0] = 0
    return edges_s[at], np.diff(total[at]).astype(np.float64)


class LatencyModel:
    """Latencies expected of given pixels, as a function of the time constant and of a common delay."""

    def __init__(self, pixels: Pixels, conditions: Conditions, latencies: Latencies) -> None:
        inside = (pixels.theta - latencies.contrast) / pixels.noise_rms > _lowest_barrier()
        self.latencies = latencies.part(inside)
        self.time = survival_table().time
        self.missed = unanswered_over_time(pixels, conditions, self.latencies.contrast)[1]

    def free(self, tau_s: float) -> int:
        """Return the number of bins used at a time constant, less that of contrasts."""
        return sum(max(0, int(self._used(edges, tau_s).sum()) - 1) for edges in self.latencies.edges_s)

    def _used(self, edges: Floats, tau_s: float) -> npt.NDArray[np.bool_]:
        return np.asarray(edges[1:] <= self.time[-1] * tau_s)

    def deviance(self, tau_s: float, delay: float) -> float:
        """Return the deviance of the latencies for a time constant and a common delay, the latter in units of it.

        Only bins that end within the table's time are used; each contrast is judged by the shape of its latencies
        alone, not by their number.
        """
        total = 0.0
        for missed, edges, counts in zip(self.missed, self.latencies.edges_s, self.latencies.counts, strict=True):
            used = self._used(edges, tau_s)
            seen = counts[used]
            if not seen.any():
                continue
            share = -np.diff(np.interp(np.maximum(edges / tau_s - delay, 0.0), self.time, missed))[used]
            share = np.maximum(share, _LEAST)
            expected = seen.sum() * share / share.sum()
            total += 2.0 * float(np.sum(seen * np.log(np.maximum(seen, _LEAST) / expected)))
        return total


def _lowest_barrier() -> float:
    return float(survival_table().barrier[0]) + _WITHIN


def unanswered_over_time(
    pixels: Pixels, conditions: Conditions, contrast: Floats, table: Survival | None = None,
    stretch: Floats | float = 1.0,
) -> tuple[Floats, Floats]:  # fmt: skip
    """Return (t,) times in units of tau, and (k, t) the array's chance of no answer by each, for k contrasts.

    Parameters
    ----------
    table
        One with fewer times, where fewer will do, or of slower steps; None for the universal one.
    stretch
        (k,) noise of the pixels, divided by that at each contrast: steps and thresholds count for as much more.
    """
    table = table or survival_table()
    if not contrast.size:
        return table.time, np.zeros((0, table.time.size))
    nodes, weight = gauss_nodes(_LATENCY_NODES)
    shift = grid_shift(conditions.grid_s / conditions.tau_s)
    theta = (pixels.theta + pixels.mismatch * nodes)[:, None] * np.broadcast_to(stretch, contrast.shape)
    step = contrast * stretch / pixels.noise_rms
    every = _armed_pixel(pixels, conditions).unanswered(theta / pixels.noise_rms + shift, step, table.over_time(step))
    return table.time, np.asarray(np.tensordot(weight, every, axes=1))


@lru_cache(maxsize=8)
def gauss_nodes(number: int) -> tuple[Floats, Floats]:
    """Return nodes and weights (sum 1) of means over a standard normal law."""
    nodes, weight = np.polynomial.hermite_e.hermegauss(number)
    return nodes, weight / weight.sum()
