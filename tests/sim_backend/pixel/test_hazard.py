"""Rates of crossing of a pixel that has long been quiet."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.special import ndtr

from sim_backend.pixel.engines.hazard import B_FIRST, B_STEP, hazard_table, quasi_stationary


@pytest.mark.parametrize("rate", [0.011, 0.0171, 0.24])
@pytest.mark.parametrize("barrier", [2.0, 4.5])
def test_a_rate_between_two_tables_is_that_of_its_own_transition_matrix(rate: float, barrier: float) -> None:
    rho = math.exp(-rate)
    x, mass = quasi_stationary(-8.0, barrier, rho)
    crossing = float(ndtr((rho * x - barrier) / math.sqrt(1.0 - rho * rho)) @ mass)
    log_rate = hazard_table(rho).log_rate[round((barrier - B_FIRST) / B_STEP)] - 0.5 * barrier**2
    assert math.exp(log_rate) == pytest.approx(-math.log1p(-crossing), rel=1e-3)


def test_where_a_pixel_stands_is_between_the_laws_of_the_rates_beside_it() -> None:
    low, middle, high = (hazard_table(math.exp(-rate)) for rate in (0.0125, 0.0130, 0.0135))
    steps = np.sort([low.beyond, high.beyond], axis=0)
    assert np.all(steps[0] - 1e-3 <= middle.beyond)
    assert np.all(middle.beyond <= steps[1] + 1e-3)
