"""How statistics scatter, as far as the clusters that they come from tell."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bench.diagnosis.residuals import expectation, measured
from bench.diagnosis.summary import Label, Summary

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
