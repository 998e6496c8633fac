"""How far two models are apart: chance is no distance."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bench.diagnosis.searching.apart import least_product, product

_TRIALS, _TIMES, _STATISTICS = 400, 4, 200


def _trials(length: float) -> list[np.ndarray]:
    """Return changes of a known length, each with chance of variance 1 in every statistic."""
    rng = np.random.default_rng(11)
    true = np.full(_STATISTICS, length / math.sqrt(_STATISTICS))
    return [true + rng.standard_normal((_TIMES, _STATISTICS)) for _ in range(_TRIALS)]


@pytest.mark.parametrize("length", [0.0, 3.0, 10.0])
def test_the_product_has_no_chance_in_its_mean(length: float) -> None:
    found = np.array([product(t, t) for t in _trials(length)])
    # Of six pairs of four simulations: n for the chance in each product, and 4 length^2 for that along the change.
    variance = 2.0 * _STATISTICS / (_TIMES * (_TIMES - 1)) + 4.0 * length**2 / _TIMES
    assert abs(found.mean() - length**2) < 4.0 * math.sqrt(variance / _TRIALS)
    assert found.var() == pytest.approx(variance, rel=4.0 * math.sqrt(2.0 / _TRIALS))


def test_no_more_is_sure_than_there_is() -> None:
    # Two standard errors from four simulations: a one-sided t law of three degrees of freedom leaves 7 %.
    for length in (0.0, 10.0):
        more = np.mean([least_product(t, t) > length**2 for t in _trials(length)])
        assert more < 0.07 + 4.0 * math.sqrt(0.07 * 0.93 / _TRIALS)


def test_what_is_clear_stays() -> None:
    assert np.mean([least_product(t, t) > 0.8 * 30.0**2 for t in _trials(30.0)]) > 0.9


def test_a_change_of_one_simulation_alone_tells_nothing() -> None:
    change = np.zeros((_TIMES, _STATISTICS))
    change[0] = 5.0
    assert product(change, change) == pytest.approx(0.0)
