"""How statistics scatter, as far as the clusters that they come from tell."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bench.diagnosis.expected.problem import Problem
from bench.diagnosis.expected.residuals import _whitener, expectation, filled, measured
from bench.diagnosis.fitting.fitted import live
from bench.diagnosis.recorded.summary import Label, Summary

LABEL = Label(0, "latency", "on", "mean", "ln", 1.0, 0.4, 0.05, 0.0, 0.0, False, False)


def mean_over(sums: list[float], events: list[float]) -> Summary:
    """Return a mean over events, of which each cluster has so many with such a sum."""
    summands = np.array([sums, events])
    top, bottom = summands.sum(axis=1)[:, None]
    return Summary((LABEL,), top, bottom, summands @ summands.T)


def test_the_number_of_clusters_is_that_of_equal_weights() -> None:
    assert mean_over([5.0] * 6, [2.0] * 6).clusters == pytest.approx([6.0])
    assert mean_over([5.0, 5.0], [30.0, 1.0]).clusters == pytest.approx([31.0**2 / 901.0])


def test_of_what_comes_from_one_cluster_no_scatter_is_known() -> None:
    """Thirty events of one pulse: they have their mean in common, and there is nothing to compare it with."""
    alone = mean_over([150.0], [30.0])
    assert expectation(measured([alone]), [alone]).deviation[0] > 1e5
    many = mean_over([5.0, 6.0] * 15, [1.0] * 30)
    # The standard deviation of 5 and 6 is a half; 30 of them were measured, and 30 simulated.
    found = expectation(measured([many]), [many]).deviation[0]
    assert found == pytest.approx(0.5 * math.sqrt(2.0 / 30.0), rel=1e-6)


PIXELS, PULSES = 200, 20
HALF = PULSES // 2


def of_pairs(answered: np.ndarray) -> Summary:
    """Return a response, and the covariance between pixels of its even and its odd pulses."""
    response = Label(0, "response", "on", "share", "1", 1.0, 0.4, 0.05, 0.0, 0.0, False, False)
    least = 1 / (HALF**2 * PIXELS)
    spread = Label(0, "spread", "on", "difference", "1", 1.0, 0.4, 0.05, 0.0, least, False, False, True)
    even, odd = (answered[:, k::2].mean(axis=1) for k in (0, 1))
    tops = [answered.sum(axis=1), (even - even.mean()) * (odd - odd.mean())]
    summands = np.array([*tops, np.full(PIXELS, PULSES), np.ones(PIXELS)])
    sums = summands.sum(axis=1)
    return Summary((response, spread), sums[:2], sums[2:], summands @ summands.T)


def test_products_of_answers_are_not_known_better_than_chance_lets_them() -> None:
    """Answers that have nothing in common: the mean of their products has a variance of (p (1 - p))^2 / pairs."""
    rng = np.random.default_rng(2)
    run, model = ((rng.random((PIXELS, PULSES)) < 0.1).astype(float) for _ in range(2))
    known = measured([of_pairs(run)])
    variance = 0.09**2 / (HALF**2 * PIXELS)
    assert known.kinds.by_chance(np.array([0.1, 0.0]), known.bottom)[1] == pytest.approx(variance, rel=0.02)
    # The products of 200 pixels tell their variance to 20 %; measured less expected has that of both.
    found = expectation(known, [of_pairs(model)]).deviation[1]
    assert found >= math.sqrt(2.0 * 0.9 * variance)
    assert found == pytest.approx(math.sqrt(2.0 * variance), rel=0.2)


def test_of_products_of_few_answers_nothing_is_known() -> None:
    """Three pulses that were not answered, all of one pixel: nobody knows how often that happens."""
    run = np.ones((PIXELS, PULSES))
    run[7, :3] = 0.0
    known = measured([of_pairs(run)])
    assert expectation(known, [of_pairs(run)]).deviation[1] > 1e5


def test_what_says_nothing_is_no_part_of_an_independent_residual() -> None:
    """Of twelve statistics four say nothing, and three of the others go together."""
    rng = np.random.default_rng(1)
    covariance = np.diag(rng.uniform(0.5, 2.0, size=12))
    alike, silent = np.array([1, 4, 7]), np.arange(0, 12, 3)
    sources = rng.normal(size=(3, 5))
    covariance[np.ix_(alike, alike)] += sources @ sources.T
    covariance[silent, silent] = 1e12
    root = _whitener(covariance)
    assert int(live(root).sum()) == 8
    np.testing.assert_array_equal(root[:, silent], 0.0)
    assert np.linalg.eigvalsh(root @ covariance @ root.T) == pytest.approx([0.0] * 4 + [1.0] * 8, abs=1e-9)


def test_what_some_say_nothing_about_is_as_the_others_say() -> None:
    values = np.array([[1.0, np.nan, np.nan], [4.0, -5.0, np.nan], [4.0, -8.0, np.nan]])
    found = filled(values, np.array([2.0, 1.0, 2.0]))
    np.testing.assert_allclose(found, [[1.0, -7.0, 0.0], [4.0, -5.0, 0.0], [4.0, -8.0, 0.0]])


def test_what_one_of_two_models_says_nothing_about_does_not_change() -> None:
    """A share of pairs, of which there are none without events: the angle of nothing is no change."""

    def seen(ratio: list[float]) -> Any:
        said = np.isfinite(ratio)
        scatter = SimpleNamespace(few=np.array([False, False, True]))
        return SimpleNamespace(value=np.where(said, 7.0, 1.0) + np.arange(3), said=said, scatter=scatter)

    base, other = (seen([0.5, 0.5, 0.5]), seen([0.4, math.nan, 0.4]))
    base.value = base.value + 2.0
    made: Any = SimpleNamespace(
        measured=SimpleNamespace(labels=[LABEL] * 3),
        _wanted=lambda models, _: [(2, 1.0)] * len(models),
        _simulated=lambda models, *_: [[SimpleNamespace(share=1.0, of=m)] * 2 for m in models],
        expect=lambda sensors: sensors[0].of,
    )
    (change,) = Problem.changes(made, base, [other], 1, 1.0)
    np.testing.assert_allclose(change.halves, [[-2.0, 0.0, 0.0]] * 2)
