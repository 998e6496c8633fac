"""The map of each pixel's own 50 % point."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from bench.analysis.pixel_map import pixel_map
from bench.analysis.results import CurveKey
from bench.analysis.scurve import CurveCounts
from protocols.points import Roi

KEY = CurveKey("reset_test", "on", 10.0, 0.0, 0.2, "")


def _map(x: np.ndarray, own: np.ndarray, noise: float, pulses: int, roi: Roi) -> tuple[np.ndarray, np.ndarray]:
    p = 0.01 + 0.98 * norm.cdf((x[:, None] - own) / noise)
    answers = np.random.default_rng(3).binomial(pulses, p)
    found = pixel_map(KEY, CurveCounts(x, answers, np.full(answers.shape, pulses)), 0.01, 0.99, roi)
    return found.half, found.counting_error


@pytest.mark.parametrize("noise", [0.02, 0.05])
def test_thresholds_come_back_within_their_counting_error(noise: float) -> None:
    roi = Roi(0, 0, 40, 25)
    own = 0.3 + 0.03 * np.random.default_rng(1).standard_normal(roi.pixels)
    half, error = _map(np.linspace(0.05, 0.6, 25), own, noise, 40, roi)
    assert half.shape == error.shape == (25, 40)
    pull = (half.ravel() - own) / error.ravel()
    # A thousand pulls of unit variance: the standard error of their mean is 0.032, of their spread 0.022.
    assert abs(pull.mean()) < 0.13
    assert 0.85 < pull.std() < 1.15


def test_a_bare_step_has_the_error_of_a_uniform_distribution() -> None:
    x = np.linspace(0.1, 0.5, 5)
    answers = np.where(x[:, None] > 0.25, 20, 0) * np.ones(4, np.int64)
    found = pixel_map(KEY, CurveCounts(x, answers, np.full(answers.shape, 20)), 0.0, 1.0, Roi(0, 0, 2, 2))
    assert found.half == pytest.approx(0.25, abs=0.005)
    assert found.counting_error == pytest.approx(0.1 / np.sqrt(12), rel=0.2)


def test_pixels_that_do_not_bracket_are_unknown() -> None:
    x = np.linspace(0.1, 0.5, 5)
    answers = np.array([[0, 20, 0, 0], [0, 20, 0, 5], [0, 20, 9, 9], [0, 20, 20, 12], [0, 20, 20, 9]])
    trials = np.full(answers.shape, 20)
    trials[:, 2] = 0
    answers[:, 2] = 0
    found = pixel_map(KEY, CurveCounts(x, answers, trials), 0.0, 1.0, Roi(0, 0, 2, 2))
    assert np.isnan(found.half).all(), "dead, always answering, masked, and never over one half at the end"
