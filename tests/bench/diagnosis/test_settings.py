"""Which points share thresholds, corner and dead time."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import pytest

from bench.diagnosis.expected.problem import settings_of
from bench.diagnosis.session import open_session
from sim_backend.pixel import PixelModel

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

PIXEL = PixelModel(noise_rms=0.045, corner_hz=150.0, theta_on=0.3, theta_off=0.25, refractory_s=5e-4)


@pytest.mark.parametrize(
    ("dead_s", "biases", "expected"),
    [
        ([8e-3, 8e-3, 8e-3], [0, 0, 0], [0, 0, 0]),
        ([8e-3, 8e-3, 8e-3], [0, 20, 0], [0, 1, 0]),
        ([8e-3, 8.4e-3, 7.6e-3], [0, 0, 0], [0, 0, 0]),  # as it was measured at each point
        ([8e-3, 80e-3, 8e-3], [0, 0, 0], [0, 1, 0]),
        ([8e-3, math.nan, 80e-3], [0, 0, 0], [0, 0, 1]),
        ([math.nan, 8e-3, 80e-3], [0, 0, 0], [0, 0, 1]),  # the first one is as the next
        ([math.nan, math.nan], [0, 20], [0, 1]),
    ],
)
def test_points_of_one_setting(
    point: Callable[..., Any], dead_s: Sequence[float], biases: Sequence[float], expected: Sequence[int]
) -> None:
    points = [
        point(i, 0.3, refractory_s=dead, bias={"bias_fo": bias})
        for i, (dead, bias) in enumerate(zip(dead_s, biases, strict=True))
    ]
    assert settings_of(points) == expected


def test_a_dead_time_begins_where_any_point_of_its_setting_states_it(
    point: Callable[..., Any], run_of: Callable[..., Any]
) -> None:
    points = [point(i, 0.5, refractory_s=dead) for i, dead in enumerate([math.nan, 8e-3, 80e-3])]
    with open_session([run_of(points, PIXEL, 1)]) as session:
        problem = session.problem
        start = problem.starts(PIXEL, by_eye=False)[0]
        found = {
            slot.key(problem.settings): slot.free.value(x)
            for slot, x in zip(problem.base_slots(), start, strict=True)
            if slot.free.owner == "refractory_period"
        }
    assert found == pytest.approx({"refractory_period.period_s@0": 8e-3, "refractory_period.period_s@1": 80e-3})
