"""A number that goes in bends is looked along: the best of its values, and those that the run allows."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bench.diagnosis.expected.catalogue import free_of
from bench.diagnosis.expected.problem import Slot
from bench.diagnosis.fitting.along import looked_along
from bench.diagnosis.fitting.fitted import Fit
from bench.diagnosis.fitting.judging import values_of
from sim_backend.pixel import PixelModel
from sim_backend.pixel.effects.leak import Leak
from sim_backend.pixel.effects.trail_filter import TrailFilter

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]

#: Statistics, each of unit variance.
N = 4
WINDOW, LEAK = (Slot(free_of(effect)[0]) for effect in (TrailFilter, Leak))
#: Of half of a chi-squared of one degree of freedom: 90 % are within so many standard errors.
NINETY = 1.6449


class Problem:
    """Where statistics of a model are a function of its coordinates, and have no chance."""

    settings = 1
    forward = SimpleNamespace(late_us=0)
    known: dict[Any, Any] = {}  # noqa: RUF012 - nobody writes to it
    points = (SimpleNamespace(roi=SimpleNamespace(pixels=100)),)

    def __init__(self, expected: Callable[[Floats], Floats], measured: Floats) -> None:
        self.expected = expected
        self.measured = SimpleNamespace(points=(slice(0, N),), value=measured, labels=range(N))
        self.looks: list[float] = []

    def models(self, _: Any, __: Any, x: Floats) -> Any:
        return x

    def simulate(self, models: Any, _: int, effort: float) -> Any:
        self.looks += [effort] * len(models)
        return models

    def expect(self, x: Floats) -> Any:
        ratio = self.expected(x)
        said = np.isfinite(ratio)
        return SimpleNamespace(
            value=np.nan_to_num(ratio), ratio=ratio, said=said, roots=(np.diag(said.astype(float)),),
            deviation=np.ones(N), recordings=1e9, more=1.0,
        )  # fmt: skip

    def of_settings(self, model: PixelModel, _: Any, __: Any) -> list[PixelModel]:
        return [model]

    def alike(self, _: Any) -> float:
        return 0.0


def fitted(problem: Any, slots: tuple[Slot, ...], x: list[float], slopes: Floats) -> Fit:
    """Return a fit that has ended somewhere, with some changes by coordinate (n, k)."""
    value = problem.expected(np.array(x))
    return Fit(
        model=PixelModel(), slots=slots, x=np.array(x), start=np.array(x), value=value, ratio=value,
        roots=(np.eye(N),), deviation=np.ones(N), jacobian=np.stack([slopes, slopes]), scale=1.0,
        residual=problem.measured.value - value,
    )  # fmt: skip


def slopes_of(*columns: float) -> Floats:
    return np.tile(np.array(columns), (N, 1))


def test_where_all_goes_along_a_line_the_interval_is_that_of_the_slope() -> None:
    problem: Any = Problem(lambda x: 400.0 * x[0] * np.ones(N), np.full(N, 400.0 * 0.0321))
    found = looked_along(problem, fitted(problem, (WINDOW,), [0.03], slopes_of(400.0)), 1)
    sd = 1.0 / (400.0 * np.sqrt(N))
    assert found.x[0] == pytest.approx(0.0321, abs=0.15 * sd)  # values are looked at, a quarter of one apart
    np.testing.assert_allclose(found.between[0], [0.0321 - NINETY * sd, 0.0321 + NINETY * sd], atol=0.1 * sd)
    np.testing.assert_allclose(found.residual, problem.measured.value - 400.0 * found.x[0])


def test_a_window_that_outlasts_all_pulses_has_no_upper_end() -> None:
    """Nothing changes beyond 0.08 s: the slope across the bend knows nothing of that."""
    problem: Any = Problem(lambda x: 1000.0 * min(x[0], 0.08) * np.ones(N), np.full(N, 80.0))
    ended = fitted(problem, (WINDOW,), [0.076], slopes_of(500.0))
    by_slope = values_of(problem, ended)["trail_filter.window_s"]
    assert by_slope.high < 0.08
    found = values_of(problem, looked_along(problem, ended, 1))["trail_filter.window_s"]
    # Four statistics are each lower by 1.6449 / 2 there.
    assert found.low == pytest.approx(0.08 - NINETY / 2.0 / 1000.0, abs=2e-4)
    assert found.high == WINDOW.free.highest


def test_the_other_numbers_follow() -> None:
    """Both change the same statistic, and only the other one the last three."""

    def expected(x: Floats) -> Floats:
        return np.array([2000.0 * min(x[0], 0.08) + 300.0 * x[1], 300.0 * x[1], 300.0 * x[1], 300.0 * x[1]])

    problem: Any = Problem(expected, np.array([120.0 + 30.0, 30.0, 30.0, 30.0]))
    columns = np.array([[2000.0, 300.0], [0.0, 300.0], [0.0, 300.0], [0.0, 300.0]])
    found = looked_along(problem, fitted(problem, (WINDOW, LEAK), [0.05, 0.11], columns), 1)
    np.testing.assert_allclose(found.x, [0.06, 0.1], rtol=2e-3)
    # Of the first statistic, and of the mean of the others: 1 + 1 / 3.
    half = NINETY * np.sqrt(4.0 / 3.0) / 2000.0
    np.testing.assert_allclose(found.between[0], [0.06 - half, 0.06 + half], rtol=2e-3)


def test_a_fit_that_ended_far_away_is_looked_at_again_from_where_it_goes() -> None:
    def looks_from(here: float) -> int:
        problem: Any = Problem(lambda x: 400.0 * x[0] * np.ones(N), np.full(N, 400.0 * 0.05))
        looked_along(problem, fitted(problem, (WINDOW,), [here], slopes_of(400.0)), 1)
        return sum(effort > 10.0 for effort in problem.looks)

    assert looks_from(0.0505) == 1
    assert looks_from(0.07) == 2


def test_what_a_simulation_says_nothing_of_stays() -> None:
    """Of no events there is no latency."""

    def expected(x: Floats) -> Floats:
        return np.array([400.0 * x[0], 400.0 * x[0], 400.0 * x[0], np.nan if x[0] > 0.04 else 7.0])

    problem: Any = Problem(expected, np.array([15.9, 15.9, 15.9, 7.0]))
    slopes = np.array([[400.0], [400.0], [400.0], [0.0]])
    found = looked_along(problem, fitted(problem, (WINDOW,), [0.0395], slopes), 1)
    sd = 1.0 / (400.0 * np.sqrt(3.0))
    np.testing.assert_allclose(found.between[0], [0.03975 - NINETY * sd, 0.03975 + NINETY * sd], atol=0.1 * sd)
    assert found.value[3] == 7.0


def test_a_window_of_nothing_stays_nothing() -> None:
    """The fit is at the end of the range, which is looked at as well."""
    problem: Any = Problem(lambda x: 400.0 * x[0] * np.ones(N), np.full(N, 0.0))
    found = looked_along(problem, fitted(problem, (WINDOW,), [0.0], slopes_of(400.0)), 1)
    sd = 1.0 / (400.0 * np.sqrt(N))
    assert found.x[0] == 0.0
    np.testing.assert_allclose(found.between[0], [0.0, NINETY * sd], atol=0.1 * sd)


def test_other_numbers_are_left_as_they_are() -> None:
    problem: Any = Problem(lambda x: 400.0 * x[0] * np.ones(N), np.full(N, 40.0))
    ended = fitted(problem, (LEAK,), [0.09], slopes_of(400.0))
    assert looked_along(problem, ended, 1) is ended
    assert problem.looks == []
