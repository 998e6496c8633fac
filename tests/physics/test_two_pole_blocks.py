"""Blocks of the fast engine with two poles: law, bounds and first crossing, against brute force."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from drivers.jit import njit
from protocols.points import Roi
from sim_backend.pixel import PixelModel, build_chain
from sim_backend.pixel.effects import LowFrequencyNoise, PhotoreceptorBandwidth, ShotNoise
from sim_backend.pixel.engines import block_law_kernels as law
from sim_backend.pixel.engines import two_pole_kernels
from sim_backend.pixel.engines.excursion_kernels import START, STATES, first_crossing, inside, refill
from sim_backend.pixel.engines.lanes import Grid, coefficients
from sim_backend.pixel.engines.two_poles import slow_noise

if TYPE_CHECKING:
    import numpy.typing as npt

    from sim_backend.pixel.engines.general_kernels import Coefficients

    Floats = npt.NDArray[np.float64]

DT_S = 1e-5
SIGMAS = 5.0

#: corner (Hz), rms of the floor, photoreceptor (Hz/fA), photocurrent (fA)
PIXELS = [
    (200.0, 0.06, 5.0, 254.0),
    (200.0, 0.06, 20.0, 3000.0),
    (200.0, 0.06, 1.0, 0.5),
    (2000.0, 0.06, 1.0, 250.0),
    (2000.0, 0.0, 0.2, 10.0),
    (5.0, 0.06, 0.3, 250.0),
    (50.0, 0.002, 1.6, 250.0),  # a photoreceptor of 400 Hz: bumps far shorter than a block
]


def prepared(corner_hz: float, rms: float, hz_per_fa: float, current_fa: float, slow_rms: float = 0.0) -> Any:
    """Return coefficients, slow noise and table of a pixel."""
    model = PixelModel(corner_hz=corner_hz, noise_rms=rms) + ShotNoise()
    model = model + PhotoreceptorBandwidth(hz_per_fa=hz_per_fa, max_hz=1e4)
    model = model + LowFrequencyNoise(rms=slow_rms, tau_s=0.005)
    chain = build_chain(model, Roi(0, 0, 1, 1), 0)
    c = coefficients(Grid(DT_S, euler=False), chain)
    slow = slow_noise(dataclasses.replace(chain, corner_hz=min(corner_hz, 200.0)), DT_S)
    table = np.zeros((len(slow), law.COLUMNS))
    law.make_table(current_fa, c, slow, len(slow) - 1, table, np.empty((2, law.PARTS)))
    return c, slow, table


def test_the_table_of_a_light_is_its_own_however_many_lights_there_are() -> None:
    c, slow, table = prepared(*PIXELS[0])
    levels = len(slow) - 1
    _, tables, kept, *_, parts = two_pole_kernels.work_room(levels)
    tables[:] = 0.0  # not all of a table is written
    lights = np.random.default_rng(1).uniform(0.1, 300.0, 2 * len(kept))
    for lux in (*lights, *lights[:100], *lights[-100:]):
        found = two_pole_kernels.table_of(lux, c, slow, levels, kept, tables, parts)
        assert kept[found] == lux
        law.make_table(lux, c, slow, levels, table, parts)
        np.testing.assert_array_equal(tables[found], table)


def test_the_light_of_drift_beside_flicker_is_worked_out_once() -> None:
    """Some hundred stairs of flicker and drift find places of their own, and are found there again."""
    c, slow, _ = prepared(*PIXELS[0])
    levels = len(slow) - 1
    _, tables, kept, *_, parts = two_pole_kernels.work_room(levels)
    flicker = 1.0 + np.round(0.06 * np.sin(2.0 * np.pi * (np.arange(64) + 0.5) / 64), 12)
    stairs = np.exp(-0.005 * np.arange(10.0))
    lights = np.unique(np.outer([0.5, 1.2, 254.0], np.outer(stairs, flicker)))
    first = [two_pole_kernels.table_of(lux, c, slow, levels, kept, tables, parts) for lux in lights]
    assert len(set(first)) == len(lights) > 900
    tables[:] = 0.0
    again = [two_pole_kernels.table_of(lux, c, slow, levels, kept, tables, parts) for lux in lights]
    assert again == first
    assert not tables.any()  # none was made anew


def step(c: Coefficients, current_fa: float) -> tuple[Floats, Floats]:
    """Return A and Q of ``x <- A x + N(0, Q)`` for x = (v, p), written anew from the reference engine's equations."""
    forget = math.exp(-min(c.receptor_per_fa * current_fa, c.receptor_most))
    shot = math.sqrt(c.shot_fa / current_fa)
    into = np.array([[(1.0 - c.rho) * (1.0 - forget) * shot, c.sigma], [(1.0 - forget) * shot, 0.0]])
    return np.array([[c.rho, (1.0 - c.rho) * forget], [0.0, forget]]), into @ into.T


def powers(c: Coefficients, current_fa: float, samples: int) -> tuple[list[Floats], list[Floats]]:
    """Return A^k and the covariance of k samples, for k from 0 on."""
    a, q = step(c, current_fa)
    factors, covariances = [np.eye(2)], [np.zeros((2, 2))]
    for _ in range(samples):
        factors.append(a @ factors[-1])
        covariances.append(a @ covariances[-1] @ a.T + q)
    return factors, covariances


@pytest.mark.parametrize(("corner_hz", "rms", "hz_per_fa", "current_fa"), PIXELS)
@pytest.mark.parametrize("j", [2, 5, 9])
def test_bounds_hold_at_every_sample(
    corner_hz: float, rms: float, hz_per_fa: float, current_fa: float, j: int
) -> None:
    """The law inside a block is that of conditional Gaussians; deviation and expectation stay within their bounds."""
    c, slow, table = prepared(corner_hz, rms, hz_per_fa, current_fa)
    n = 1 << j
    factors, covariances = powers(c, current_fa, n)
    whole = np.linalg.pinv(covariances[n], rcond=1e-12)
    rng = np.random.default_rng(j)
    law_of_end = np.linalg.cholesky(covariances[n] + 1e-18 * np.eye(2))
    ends = []
    for _ in range(200):
        start = rng.normal(size=2) * np.array([0.1, 2.0])
        ends.append((start, factors[n] @ start + law_of_end @ rng.normal(size=2)))
    outs = np.empty((n - 1, len(ends)))
    for k in range(1, n):
        gain = covariances[k] @ factors[n - k].T @ whole
        rest = covariances[k] - gain @ factors[n - k] @ covariances[k]
        assert math.sqrt(max(rest[0, 0], 0.0)) <= table[j, law.DEVIATION]
        outs[k - 1] = [(factors[k] @ a + gain @ (b - factors[n] @ a))[0] for a, b in ends]
        start, end = ends[0]
        mean_v, mean_p, _, vv, vp, pp, _ = inside(table, slow, k, n - k, start[0], start[1], 0.0, end[0], end[1], 0.0)
        expected = factors[k] @ start + gain @ (end - factors[n] @ start)
        assert (mean_v, mean_p) == pytest.approx(tuple(expected), abs=1e-7)
        assert (vv, vp, pp) == pytest.approx((rest[0, 0], rest[0, 1], rest[1, 1]), abs=1e-9)
    for (start, end), out in zip(ends, outs.T, strict=True):
        up, down = law.clearance(table, slow, j, start[0], start[1], 0.0, end[0], end[1], 0.0, 1.0, -1.0)
        assert out.max() <= 1.0 - up + 1e-9
        assert out.min() >= down - 1.0 - 1e-9


@pytest.mark.parametrize("j", [2, 5, 9])
def test_slow_noise_stays_within_its_bounds(j: int) -> None:
    """Ends above, below, and on both sides of its mean: it is expected nearer to the mean than either end at most."""
    _, slow, table = prepared(200.0, 0.06, 5.0, 254.0, slow_rms=0.06)
    for ends in [(0.1, 0.1), (-0.1, -0.08), (0.1, -0.02), (0.2, 0.01)]:
        up, down = law.clearance(table, slow, j, 0.01, 0.02, ends[0], -0.02, 0.01, ends[1], 1.0, -1.0)
        laws = [
            inside(table, slow, k, (1 << j) - k, 0.01, 0.02, ends[0], -0.02, 0.01, ends[1]) for k in range(1, 1 << j)
        ]
        out = np.array([one[0] + one[2] for one in laws])
        assert out.max() <= 1.0 - up + 1e-9
        assert out.min() >= down - 1.0 - 1e-9


@njit(nogil=True, error_model="numpy")
def dense(repeats, table, slow, j, start, end, on_level, slope, first):  # type: ignore[no-untyped-def]
    """Count which sample of a block crosses first, all samples drawn."""
    words, z, numbers = np.empty(128, np.uint32), np.empty(128, np.float32), np.array([128, 0])
    length = 1 << j
    path = np.empty((length + 1, 3))
    path[0], path[length] = start, end
    for _ in range(repeats):
        span, level = length, j
        while span > 1:
            for a in range(0, length, span):
                b, middle = a + span, a + span // 2
                refill(np.uint32(7), np.uint32(1), np.uint32(2), words, z, numbers)
                path[middle, 0], path[middle, 1], path[middle, 2] = law.draw_middle(
                    table, slow, level, path[a, 0], path[a, 1], path[a, 2], path[b, 0], path[b, 1], path[b, 2], z,
                    numbers[0],
                )  # fmt: skip
                numbers[0] += 3
            span //= 2
            level -= 1
        for k in range(1, length):
            if path[k, 0] + path[k, 2] >= on_level - slope * k:
                first[k] += 1
                break


@njit(nogil=True, error_model="numpy")
def proposed(repeats, table, slow, j, start, end, on_level, slope, first):  # type: ignore[no-untyped-def]
    """Count which sample the fast engine takes."""
    words, z, numbers = np.empty(128, np.uint32), np.empty(128, np.float32), np.array([128, 0])
    way, states = np.empty((16, 4)), np.empty((STATES, 3))
    states[START] = start
    for _ in range(repeats):
        k = first_crossing(
            table, slow, j, states, end, on_level, -100.0, slope, np.uint32(9), np.uint32(3), np.uint32(4), words, z,
            numbers, way,
        )  # fmt: skip
        if k > 0:
            first[k] += 1


@pytest.mark.slow
@pytest.mark.parametrize(("slow_rms", "slope"), [(0.0, 0.0), (0.05, 2e-4)])
def test_the_first_crossing_of_a_rare_block_is_that_of_all_samples(slow_rms: float, slope: float) -> None:
    j = 4
    _, slow, table = prepared(200.0, 0.06, 5.0, 254.0, slow_rms)
    start, end = np.array([0.1, 0.0, 0.2 * slow_rms]), np.array([0.1, 0.1, 0.4 * slow_rms])
    up, _ = law.clearance(table, slow, j, start[0], start[1], start[2], end[0], end[1], end[2], 0.0, -100.0)
    level = 1.0001 * table[j, law.LIMIT] * table[j, law.DEVIATION] - up + slope * 2**j
    all_samples, taken = np.zeros(2**j), np.zeros(2**j)
    many, few = 4_000_000, 400_000
    dense(many, table, slow, j, start, end, level, slope, all_samples)
    proposed(few, table, slow, j, start, end, level, slope, taken)
    # The proposal is made with the chance RARE.
    rates = [(taken.sum() * law.RARE / few, taken.sum()), (all_samples.sum() / many, all_samples.sum())]
    assert min(count for _, count in rates) > 30
    error = sum(rate**2 / count for rate, count in rates)
    assert abs(rates[0][0] - rates[1][0]) < SIGMAS * math.sqrt(error)
    k = np.arange(2**j)
    means, variances = [], []
    for counts in (taken, all_samples):
        means.append(float(np.average(k, weights=counts)))
        variances.append(float(np.average((k - means[-1]) ** 2, weights=counts)) / counts.sum())
    assert abs(means[0] - means[1]) < SIGMAS * math.sqrt(sum(variances))
