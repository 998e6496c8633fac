"""How residuals of a true model scatter: the same, of however many pixels a simulated sensor has."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bench.diagnosis.fitting.chance import _fewer, pooled, scale_of
from bench.diagnosis.session import open_session
from protocols.points import Roi
from sim_backend.pixel import PixelModel

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from bench.diagnosis.expected.problem import Problem

PIXEL = PixelModel(noise_rms=0.045, corner_hz=150.0, theta_on=0.3, theta_off=0.25, refractory_s=8e-3)


@pytest.fixture
def problem(point: Callable[..., Any], run_of: Callable[..., Any]) -> Iterator[Problem]:
    window = {"roi": Roi(40, 30, 16, 16), "periods": 20}
    points = [point(i, c, **window) for i, c in enumerate((0.22, 0.3, 0.35, 0.45, 0.6, 0.8, 1.0, 1.2))]
    points.append(point(len(points), 0.0, **window))
    with open_session([run_of(points, PIXEL, 3)]) as session:
        yield session.problem


@pytest.mark.slow
def test_a_run_of_the_model_scatters_as_much_from_part_of_the_pixels(problem: Problem) -> None:
    models = [PIXEL] * len(problem.points)
    whole, part = (problem.forward.run([models], seed=5, sensors=12, share=share)[0] for share in (1.0, 0.25))
    assert part[0].share == 0.25
    here = problem.expect(whole)
    found = [scale_of(problem, here, sensors) for sensors in (whole, part)]
    # Means over events are a third of the statistics: they would scatter four times as much, and all twice.
    assert found[1] == pytest.approx(found[0], rel=0.2)


@pytest.mark.parametrize("sensors", [2, 4])
@pytest.mark.parametrize("events", [3.0, 20.0])
def test_differences_of_means_of_few_events_scatter_as_is_said(sensors: int, events: float) -> None:
    """Of as many events as were measured, and half as many as those: their number scatters as well."""
    rng = np.random.default_rng(6)
    measured, n = 2.0 * events, 40_000
    counts = np.maximum(rng.poisson(events, size=(sensors, n)), 1)
    means = rng.standard_normal((sensors, n)) / np.sqrt(counts)
    rest = counts[1:].sum(axis=0)
    away = means[0] - (counts[1:] * means[1:]).sum(axis=0) / rest
    others = [[SimpleNamespace(bottom=column.astype(float)) for column in counts[1:]]]
    columns: Any = [[one] for one in others[0]]
    fewer = _fewer(np.full(n, measured), counts[0].astype(float), columns, sensors)
    # A difference of two sensors of as many events as were measured.
    expected = (1.0 + 1.0 / (sensors - 1)) / measured
    assert float(np.mean((fewer * away) ** 2)) == pytest.approx(expected, rel=4.0 * (2.0 / n) ** 0.5)


@pytest.mark.slow
def test_a_model_that_sends_other_numbers_of_events_scatters_by_its_own_number(
    point: Callable[..., Any], run_of: Callable[..., Any]
) -> None:
    """Its scale is that which it has beside a run of its own."""
    window = {"roi": Roi(40, 30, 16, 16), "periods": 20}
    points = [point(i, c, **window) for i, c in enumerate((0.22, 0.3, 0.35, 0.45, 0.6, 0.8, 1.0, 1.2))]
    other = replace(PIXEL, theta_on=0.6, theta_off=0.5)
    found = []
    for sent in (PIXEL, other):
        with open_session([run_of(points, sent, 3)]) as session:
            sensors = session.problem.forward.run([[other] * len(points)], seed=5, sensors=12)[0]
            found.append(scale_of(session.problem, session.problem.expect(sensors), sensors))
    assert found[0] == pytest.approx(found[1], rel=0.15)


@pytest.mark.slow
def test_what_is_expected_is_the_mean_of_all_looks_close_by_and_not_of_the_best(problem: Problem) -> None:
    slots = problem.base_slots()
    at = np.array(problem.starts(PIXEL, by_eye=False)[0])
    elsewhere = at.copy()
    elsewhere[0] += 1.0
    models = [PIXEL] * len(problem.points)
    looks = [problem.expect(problem.simulate([models], seed, 2.0)[0]) for seed in (1, 2, 3)]
    visited = list(zip((at, at.copy(), elsewhere), looks, strict=True))
    jacobian = np.full((2, len(looks[0].value), len(slots)), 10.0)
    nothing = np.zeros(len(looks[0].value), np.bool_)
    nothing[:3] = True
    heard_of = np.all([look.said for look in looks], axis=0)
    silent = replace(
        looks[2], ratio=np.where(nothing, np.nan, looks[2].ratio), value=np.where(nothing, 0.0, looks[2].value)
    )
    heard = pooled(problem, [*visited[:2], (at.copy(), silent)], jacobian, at).value
    expected = np.where(nothing, 0.5 * (looks[0].value + looks[1].value), sum(look.value for look in looks) / 3.0)
    np.testing.assert_allclose(heard[heard_of], expected[heard_of])
    found = pooled(problem, visited, jacobian, at)
    expected = 0.5 * (looks[0].value + looks[1].value)
    np.testing.assert_allclose(found.value[heard_of], expected[heard_of])
    assert found.recordings == looks[0].recordings + looks[1].recordings
