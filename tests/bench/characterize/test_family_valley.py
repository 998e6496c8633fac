"""The ends of a bent valley of chi-square, against one whose profile is known in closed form."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pytest

from bench.analysis.results import Estimate
from bench.characterize import family_fit
from bench.characterize.family_fit import FamilyFit
from bench.characterize.family_model import Family
from bench.characterize.family_problem import Known
from bench.characterize.family_valley import Lower, ends_of
from bench.characterize.normal import Z90

if TYPE_CHECKING:
    import numpy.typing as npt

    from bench.characterize.family_problem import Problem

    Floats = npt.NDArray[np.float64]

THETA, LN_TAU = 0.3, -7.0
SD, WIDE = 0.003, 0.02  # of the threshold near the lowest place; where chi-square rises ever more slowly above it
SCALE = np.array([0.01, 0.1])
RISE = Z90**2
START = Family(THETA, 0.05, 0.0, LN_TAU, 0.0, 0.1, 0.0, 0.0, 0.0, 0.0)


class Bent:
    """Two numbers: the second follows the first along a parabola."""

    free = ("theta", "ln_tau")
    start = SimpleNamespace(theta=THETA, ln_tau=LN_TAU, dark_lux=0.1)
    levels = (SimpleNamespace(key=SimpleNamespace(baseline_lux=0.1)),)

    def __init__(self, hollow: float = 0.0) -> None:
        self._hollow = hollow  #: depth of a place, above the one that was thought the lowest, that is lower

    def means(self, x: Floats) -> Floats:
        """Return what is expected where (0, 0, 2) is measured."""
        away = x[0] - THETA
        own = away / SD / (1.0 + max(away, 0.0) / WIDE)
        along = 20.0 * (x[1] - LN_TAU + 15.0 * away + 800.0 * away**2)
        return np.array([own, along, 2.0 * self._hollow * math.exp(-(((away - 0.006) / 0.002) ** 2))])

    def residuals(self, x: Floats) -> Floats:
        """Return what is measured less that; the standard errors are 1."""
        return np.array([0.0, 0.0, 2.0]) - self.means(x)

    def jacobian(self, slopes: Floats) -> Floats:
        """Return the derivatives of the residuals."""
        return -slopes


def ends(problem: Bent) -> tuple[Floats, Floats] | Lower:
    slopes = np.array([[1.0 / SD, 0.0], [300.0, 20.0], [0.0, 0.0]])
    at = np.array([THETA, LN_TAU])
    return ends_of(cast("Problem", problem), at, Z90 * SD, RISE, slopes, SCALE)


def test_the_ends_are_where_chi_square_has_risen_by_what_is_wanted() -> None:
    found = ends(Bent())
    assert not isinstance(found, Lower)
    low, high = found
    assert low[0] == pytest.approx(THETA - Z90 * SD, rel=1e-3)
    up = Z90 * SD / (1.0 - Z90 * SD / WIDE)
    assert high[0] - THETA == pytest.approx(up, rel=0.05)
    assert up > 1.3 * Z90 * SD
    for end in found:
        away = end[0] - THETA
        assert end[1] - LN_TAU == pytest.approx(-15.0 * away - 800.0 * away**2, abs=0.02)


def test_a_number_in_the_valley_reaches_to_its_ends() -> None:
    at = START
    numbers: dict[str, Any] = {
        "family": at, "free": ("theta", "ln_tau", "dark_lux"), "covariance": np.diag([SD**2, 0.01, 1e-4]),
        "chi2": 5.0, "dof": 10, "level_theta": (), "constant": (0.0, 0),
    }  # fmt: skip
    wide = Family(0.31, 0.05, 0.0, -7.4, 0.0, 0.2, 0.0, 0.0, 0.0, 0.0)
    plain, bent = FamilyFit(**numbers), FamilyFit(**numbers, ends=(at, wide))
    assert bent.estimate("theta", "ln") == Estimate(THETA, plain.estimate("theta", "ln").low, 0.31, "ln")
    assert bent.estimate("ln_tau", "ln s").low == -7.4
    assert bent.estimate("dark_lux", "lux") == plain.estimate("dark_lux", "lux")


def test_a_lower_place_on_the_way_is_told() -> None:
    found = ends(Bent(hollow=0.9))
    assert isinstance(found, Lower)
    assert found.x[0] > THETA


def test_where_a_valley_has_no_end_all_places_that_were_taken_are_within_the_interval(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = FamilyFit(START, ("theta",), np.array([[1e-8]]), 1.0, 1, (), (0.0, 0))
    lower = iter(np.array([[0.31], [0.32], [0.33]]))
    monkeypatch.setattr(family_fit, "Problem", lambda *_: SimpleNamespace(jacobian=lambda s: s, family=sensor_with))
    monkeypatch.setattr(family_fit, "minimum", lambda _, x, __: x)
    monkeypatch.setattr(family_fit, "slopes_of", lambda *_: np.ones((1, 1)))
    monkeypatch.setattr(family_fit, "_result", lambda _, x, *__: replace(found, family=sensor_with(x)))
    monkeypatch.setattr(family_fit, "ends_of", lambda *_: Lower(next(lower)))
    theta = family_fit.fit_family([], Known(1.0), START, ("theta",)).estimate("theta", "ln")
    assert (theta.value, theta.low, theta.high) == (0.32, THETA, 0.33)


def sensor_with(x: Floats) -> Family:
    return replace(START, theta=float(x[0]))
