"""The blocks of the fast engine against brute force: paths of the noise, sample by sample.

The noise w is an Ornstein-Uhlenbeck process of unit variance; time is in units of its time constant. A block from w0
to w1, of length x, is cut by the line of level c. With s = exp(2 t) the line is
``c (1 + (s - 1) / (exp(x) + 1))`` for ``w sqrt(s)``.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from scipy.stats import chi2_contingency, fisher_exact, ks_2samp, norm

from sim_backend.pixel.engines import block_kernels
from sim_backend.pixel.engines.one_pole import block_factors

if TYPE_CHECKING:
    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]

#: A barrier that is looked at only at samples is further away by this many rms of one step: -zeta(1/2) / sqrt(2 pi).
#: Source: M. Broadie, P. Glasserman, S. Kou, "A continuity correction for discrete barrier options", Mathematical
#: Finance 7 (1997).
LOOKED_AT = 0.5825971579390107
KERNELS: Any = block_kernels
LEVEL = 1e-4
FAR = 9.0  # rms; a level that is never reached


def line(t: Floats, c: float, x: float) -> Floats:
    """Return the line of level c over a block, as a level of w."""
    s = np.exp(2.0 * t)
    return np.asarray(c * (1.0 + (s - 1.0) / (math.exp(x) + 1.0)) / np.sqrt(s))


def paths(rng: np.random.Generator, w0: Floats, x: float, steps: int) -> Floats:
    """Return paths of free noise, (steps + 1, n)."""
    keep = math.exp(-x / steps)
    w = np.empty((steps + 1, len(w0)))
    w[0] = w0
    shocks = math.sqrt(1.0 - keep * keep) * rng.standard_normal((steps, len(w0)))
    for i in range(steps):
        w[i + 1] = keep * w[i] + shocks[i]
    return w


def bridges(rng: np.random.Generator, w0: float, w1: float, x: float, steps: int, n: int) -> Floats:
    """Return paths with given ends: what free noise lacks at the end is added as its regression on the end says."""
    w = paths(rng, np.full(n, w0), x, steps)
    t = np.linspace(0.0, x, steps + 1)
    return np.asarray(w + (np.sinh(t) / math.sinh(x))[:, None] * (w1 - w[-1]))


def hits(w: Floats, c: float, x: float) -> tuple[npt.NDArray[np.bool_], Floats]:
    """Return which paths reach the line in continuous time, nearly, and when they first do."""
    steps = len(w) - 1
    t = np.linspace(0.0, x, steps + 1)
    nearer = line(t, c, x) - LOOKED_AT * math.sqrt(2.0 * x / steps)
    above = w >= nearer[:, None]
    return np.any(above, axis=0, keepdims=True)[0], t[np.argmax(above, axis=0)]


#: w0, w1, level of the line, length in time constants: short and long blocks, levels on both sides of zero.
ENDS = [
    (1.8, 1.9, 2.0, 0.02),
    (0.0, 1.5, 2.2, 0.5),
    (2.0, -0.5, 3.0, 1.0),
    (0.3, 0.0, 2.0, 2.0),
    (-1.2, -1.0, -0.6, 0.1),
    (-2.0, -1.5, -0.8, 0.7),
    (-0.5, 0.4, 0.5, 0.05),
]


@pytest.mark.slow
@pytest.mark.parametrize(("w0", "w1", "c", "x"), ENDS)
def test_a_path_between_two_ends_reaches_the_line_as_often_and_when_it_is_said_to(
    w0: float, w1: float, c: float, x: float
) -> None:
    n, steps = 6000, 1500
    rng = np.random.default_rng(round(1e3 * abs(w0 + 7.0 * w1 + 3.0 * c + x)))
    hit, t = hits(bridges(rng, w0, w1, x, steps, n), c, x)
    expected = math.exp(-(c - w0) * (c - w1) / math.sinh(x))
    # What is left of the grid's error, a further order beyond the correction, is below one part in `steps`.
    error = norm.isf(LEVEL / 2.0) * math.sqrt(n * expected * (1.0 - expected)) + 2.0 * n / steps
    assert abs(int(hit.sum()) - n * expected) < error, (hit.mean(), expected)
    growth = math.exp(x)
    span = growth * growth - 1.0
    drawn = np.empty(n)
    for i, (z, e1, e2) in enumerate(zip(rng.standard_normal(n), *rng.standard_exponential((2, n)), strict=True)):
        part = KERNELS.first_hit(c - w0, (c - w1) * growth, span, z, e1, e2)
        drawn[i] = 0.5 * math.log1p(span * part)
    assert ks_2samp(drawn, t[hit]).pvalue > LEVEL


def walk(w: float, upper: float, lower: float, samples: int, rate: float, seed: int, n: int) -> tuple[Floats, Floats]:
    """Return the samples gone and the output behind one block of the kernel, n times."""
    z = np.random.default_rng(seed).standard_normal((n, KERNELS.DRAWS)).astype(np.float32)
    factors = block_factors(rate)
    found = np.array([KERNELS.block(w, upper, lower, samples, rate, factors, row, 0)[:2] for row in z])
    return found[:, 0], found[:, 1]


#: w0, level at which there is an event, samples of the block, time constants in a sample.
STARTS = [
    (1.5, 2.0, 40, 1.0 / 80.0),
    (0.5, 2.5, 100, 1.0 / 80.0),
    (-1.3, -0.7, 15, 1.0 / 80.0),
    (-1.0, 0.3, 40, 1.0 / 30.0),
]


@pytest.mark.slow
@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("w0", "level", "samples", "rate"), STARTS)
def test_behind_the_first_hit_a_path_is_where_brute_force_finds_it(
    side: float, w0: float, level: float, samples: int, rate: float
) -> None:
    """Whether the block ends early, where, and the output there, against free paths cut by the same line."""
    n, between = 6000, 40
    x = samples * rate
    upper, lower = (level, -FAR) if side > 0.0 else (FAR, -level)
    gone, end = walk(side * w0, upper, lower, samples, rate, 5, n)
    c = level if level >= 0.0 else level * math.cosh(0.5 * x)
    w = paths(np.random.default_rng(6), np.full(n, w0), x, samples * between)
    hit, t = hits(w, c, x)
    sample = np.where(hit, np.minimum(np.floor(t / rate).astype(int) + 1, samples), samples)
    brute = w[sample * between, np.arange(n)]
    edges = np.unique(np.quantile(np.concatenate([sample, gone]), np.linspace(0.0, 1.0, 12), method="inverted_cdf"))
    counts = np.array([np.bincount(np.searchsorted(edges, s), minlength=len(edges)) for s in (sample, gone)])
    assert chi2_contingency(counts[:, counts.sum(axis=0) > 0]).pvalue > LEVEL
    assert ks_2samp(side * end[gone < samples], brute[sample < samples]).pvalue > LEVEL
    assert ks_2samp(side * end[gone == samples], brute[sample == samples]).pvalue > LEVEL


@pytest.mark.slow
@pytest.mark.parametrize(
    ("level", "most", "rate"), [(2.0, 7, 1.0 / 8.0), (2.5, 60, 1.0 / 80.0), (-0.4, 11, 1.0 / 20.0)]
)
def test_blocks_one_after_the_other_cross_where_samples_do(level: float, most: int, rate: float) -> None:
    """The first sample at or beyond a level: when, and where. Steps end on samples, and none of these is missed."""
    n, last, w0 = 4000, 400, level - 1.0
    factors = block_factors(rate)
    rng = np.random.default_rng(round(10.0 * level + most))
    found = np.full((n, 2), np.nan)
    for i in range(n):
        w, at = w0, 0
        while at < last and w < level:
            z = rng.standard_normal(KERNELS.DRAWS).astype(np.float32)
            gone, w, _ = KERNELS.until_event(w, level, -FAR, last - at, most, rate, factors, z, 0)
            at += gone
        if w >= level:
            found[i] = at, w
    w_all = paths(rng, np.full(n, w0), last * rate, last)
    crossed = (w_all >= level).any(axis=0)
    sample = np.argmax(w_all >= level, axis=0)[crossed]
    beyond = w_all[sample, np.flatnonzero(crossed)]
    mine = found[~np.isnan(found[:, 0])]
    assert fisher_exact([[crossed.sum(), (~crossed).sum()], [len(mine), n - len(mine)]]).pvalue > LEVEL
    assert ks_2samp(mine[:, 0], sample).pvalue > LEVEL
    assert ks_2samp(mine[:, 1], beyond).pvalue > LEVEL


@pytest.mark.parametrize("x", [0.02, 0.5, 2.0])
@pytest.mark.parametrize("level", [-3.0, -0.5, 0.0, 0.7, 4.0])
def test_the_line_lies_within_the_level(level: float, x: float) -> None:
    c = level if level >= 0.0 else level * math.cosh(0.5 * x)
    within = line(np.linspace(0.0, x, 1001), c, x)
    assert np.all(within <= level + 1e-12)
    assert within.max() == pytest.approx(level, abs=1e-6)
