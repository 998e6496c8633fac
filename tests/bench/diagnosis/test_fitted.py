"""Intervals of fitted numbers: as wide as chance says, and as points disagree."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.diagnosis.fitted import Fit
from bench.diagnosis.parameters import base_parameters
from bench.diagnosis.problem import Slot
from sim_backend.pixel import PixelModel

POINTS, EACH = 25, 8
N = POINTS * EACH
WHERE = [slice(i * EACH, (i + 1) * EACH) for i in range(POINTS)]


def mean_of(residual: np.ndarray[tuple[int], np.dtype[np.float64]]) -> Fit:
    """Return the fit of one number, known from nothing else, that all statistics are equal to."""
    free = replace(base_parameters(refractory_known=True)[0], prior_sd=np.inf)
    ones = np.ones((N, 1))
    return Fit(
        model=PixelModel(), slots=(Slot(free),), x=np.zeros(1), start=np.zeros(1), value=np.zeros(N),
        ratio=np.zeros(N), roots=(np.eye(EACH),) * POINTS, deviation=np.ones(N), jacobian=np.stack([ones, ones]),
        scale=1.0, residual=residual,
    )  # fmt: skip


def test_where_points_agree_the_interval_is_that_of_chance() -> None:
    within = np.tile(np.array([1.0, -1.0] * (EACH // 2)), POINTS)
    assert mean_of(within).covariance(WHERE)[0, 0] == pytest.approx(1.0 / N)


def test_where_points_disagree_it_is_as_wide_as_they_do() -> None:
    """The jackknife of a mean is the variance between points over their number."""
    away = np.random.default_rng(3).normal(scale=2.0, size=POINTS)
    away -= away.mean()
    expected = float(away.var(ddof=1)) / POINTS
    assert expected > 2.0 / N
    assert mean_of(np.repeat(away, EACH)).covariance(WHERE)[0, 0] == pytest.approx(expected)
