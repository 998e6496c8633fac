"""A probe is believed where two sensors agree, and is of a size at which it can be seen."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bench.diagnosis.expected.problem import Change
from bench.diagnosis.searching.probing import reliable, sizes_for
from sim_backend.pixel.effects.registry import effects

N = 400
RNG = np.random.default_rng(9)
FAMILIES = np.repeat([0, 1], N // 2)
PROBLEM: Any = SimpleNamespace(measured=SimpleNamespace(families=FAMILIES, points=(slice(0, N),)))
FIT: Any = SimpleNamespace(known=np.ones(N, np.bool_), deviation=np.ones(N))


def test_a_family_is_believed_as_far_as_two_sensors_agree() -> None:
    change = np.where(FAMILIES == 0, 3.0, 0.0)
    both = np.stack([change + RNG.standard_normal(N) for _ in range(2)])
    found = reliable(PROBLEM, FIT, Change(both, 1.0))
    mean, kept = both.mean(axis=0), found.mean(axis=0)
    products = [np.bincount(FAMILIES, weights=w * mean) for w in (kept, mean)]
    share = products[0] / products[1]
    # 9 of signal beside 1 / 2 of chance; of chance alone what 200 products happen to add up to, 0.07, twice.
    assert share[0] == pytest.approx(9.0 / 9.5, abs=0.03)
    assert share[1] < 4.0 * 2.0 / np.sqrt(N / 2)


def test_what_is_hardly_there_is_believed_as_a_whole_or_not() -> None:
    """Of pure chance a family of its own may keep some; of all statistics together next to nothing is left."""
    both = RNG.standard_normal((2, N))
    left = reliable(PROBLEM, FIT, Change(both, 1.0), whole=True).mean(axis=0)
    assert np.linalg.norm(left) < 4.0 * 2.0 / np.sqrt(N) * np.linalg.norm(both.mean(axis=0))
    change = np.full(N, 5.0)
    assert reliable(PROBLEM, FIT, Change(np.stack([change, change]), 1.0), whole=True) == pytest.approx(
        np.stack([change, change])
    )


def test_a_family_of_one_is_not_believed_because_it_agrees_by_chance() -> None:
    """Two sensors agree to a tenth about a statistic; hundreds of others show that it is not known at all."""
    both = RNG.standard_normal((2, N)) * 3.0
    both[:, 0] = 1.9, 2.1
    families = np.arange(N) > 0
    problem: Any = SimpleNamespace(
        measured=SimpleNamespace(families=families.astype(np.int64), points=(slice(0, N),))
    )
    # The variance of the mean of two is 9 / 2, more than 2 squared.
    assert np.all(reliable(problem, FIT, Change(both, 0.1))[:, 0] == 0.0)
    both[:, 0] = 29.0, 31.0
    assert reliable(problem, FIT, Change(both, 0.1))[0, 0] == pytest.approx(29.0 * (1.0 - 4.5 / 900.0), rel=0.002)
    # So many recordings leave less chance than that: then hundreds are no better known than by themselves.
    assert reliable(problem, FIT, Change(both, 100.0))[0, 0] > 29.0 * (1.0 - 0.011)


def test_a_probe_is_as_large_as_what_is_left() -> None:
    leak = effects()["leak"]
    residual = np.full(N, 3.0)
    fit: Any = SimpleNamespace(
        residual=residual,
        roots=(np.eye(N),),
        slots=(),
        x=np.zeros(0),
        start=np.zeros(0),
        whiten=lambda values, _: values,
        caution=1.0,
        scale=1.0,
    )
    # A deviance of 9 for each of 400 is 3200 too much: 56.6 standard errors, of which the catalogue's size has 100.
    sizes = sizes_for(PROBLEM, fit, leak, {("leak", "rate_per_s"): 100.0})
    assert sizes == pytest.approx((np.sqrt(8.0 * N) / 100.0,))
    assert sizes_for(PROBLEM, fit, leak, {}) == (0.25,)
    assert sizes_for(PROBLEM, fit, leak, {("leak", "rate_per_s"): 1e-3}) == (4.0,)
