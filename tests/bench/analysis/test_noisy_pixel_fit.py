"""When the counts leave a number of the noisy pixel open."""

from __future__ import annotations

import numpy as np
import pytest

from bench.analysis.noisy_pixel_fit import _is_determined


@pytest.mark.parametrize(
    ("curvature", "determined"),
    [
        (np.diag([1.0, 1e-6]), True),
        (np.diag([1.0, 0.0]), False),
        (np.diag([1.0, -1e-3]), False),
        (np.diag([1.0, 1e-18]), False),  # its inverse cannot be told from that of a singular matrix
        (np.diag([1.0, np.nan]), False),
    ],
)
def test_a_matrix_that_is_singular_to_rounding_determines_nothing(curvature: np.ndarray, determined: bool) -> None:
    assert _is_determined(curvature) is determined
