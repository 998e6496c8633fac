"""A fit finds the numbers of the model that made the run."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bench.diagnosis.fitting import fit as fit_module
from bench.diagnosis.fitting.approach import Approach
from bench.diagnosis.fitting.cloud import Cloud
from bench.diagnosis.fitting.fit import _hardly_seen, _Minimum, _minimum_seen, finish
from bench.diagnosis.fitting.judging import error_of, values_of
from bench.diagnosis.fitting.moving import moved
from bench.diagnosis.fitting.sharpening import from_here
from bench.diagnosis.fitting.slopes import Around, samples_around
from bench.diagnosis.session import open_session
from protocols.errors import InputError
from protocols.points import Roi
from sim_backend.pixel import PixelModel
from sim_backend.pixel.effects.event_rate_limit import EventRateLimit

if TYPE_CHECKING:
    from collections.abc import Callable

PIXEL = PixelModel(noise_rms=0.045, corner_hz=150.0, theta_on=0.3, theta_off=0.25, refractory_s=8e-3)


@pytest.mark.slow
def test_the_numbers_of_the_base_pixel_are_approached(point: Callable[..., Any], run_of: Callable[..., Any]) -> None:
    window = {"roi": Roi(40, 30, 16, 16), "periods": 20}
    points = [point(i, c, **window) for i, c in enumerate((0.15, 0.22, 0.26, 0.3, 0.35, 0.45, 0.6, 1.0))]
    points.append(point(len(points), 0.0, **window))
    with open_session([run_of(points, PIXEL, 3)]) as session:
        found = session.fit(4)
        problem = session.problem
        values = values_of(problem, found)
        error = error_of(problem, found)
    # Coarse, as the thresholds, the noise and the corner nearly make up for each other in so small a run.
    for key, true in (
        ("thresholds.on", 0.3),
        ("thresholds.off", 0.25),
        ("noise_floor.rms", 0.045),
        ("source_follower_bandwidth.corner_hz", 150.0),
    ):
        assert values[key].value == pytest.approx(true, rel=0.04), key
    assert error.response_rmse < 0.02
    assert error.deviance_per_dof < 1.3


@pytest.mark.parametrize(
    ("strayed", "loss", "expected"),
    [
        (1.5, 90.0, "again"),  # changes were looked at elsewhere, where they are others
        (0.4, 90.0, "first"),
        (1.5, 250.0, "first"),  # something else is missing
    ],
)
def test_a_good_fit_is_looked_around_again_where_it_has_come_to(
    strayed: float, loss: float, expected: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem: Any = SimpleNamespace(measured=SimpleNamespace(labels=range(100), points=[slice(0, 3)]))
    near: Any = Approach(
        model=PixelModel(), slots=(), at=np.zeros(1), start=np.zeros(1), loss=500.0, seed=1,
        information=np.eye(1), reach=0.0, cloud=Cloud(),
    )  # fmt: skip
    asked: list[Any] = []

    def minimum(_: Any, near: Any, *__: Any) -> Any:
        asked.append(near)
        return _Minimum(
            at=near.at + 2.0, expected=SimpleNamespace(roots=(np.eye(3),)), jacobian=np.full((2, 3, 1), 2.0),  # type: ignore[arg-type]
            seen=(), close=True, loss=loss, strayed=strayed,
        )  # fmt: skip

    monkeypatch.setattr(fit_module, "_minimum", minimum)
    found = _minimum_seen(problem, near, False, math.inf, 1.0, None)
    assert found.at[0] == {"first": 2.0, "again": 4.0}[expected]
    if expected == "again":
        again = asked[1]
        assert (again.at[0], again.loss, again.start[0]) == (2.0, loss, 0.0)
        assert again.seed != near.seed
        np.testing.assert_allclose(again.information, [[12.0]])


def test_directions_of_which_mostly_chance_is_seen_are_told() -> None:
    problem: Any = SimpleNamespace(measured=SimpleNamespace(points=[slice(0, 4)]))
    here: Any = SimpleNamespace(roots=(np.eye(4),))
    well, hardly = np.array([3.0, 3.0, 3.0, 3.0]), np.array([0.5, 0.5, 0.5, 0.5])
    chance = np.array([1.0, -1.0, 1.0, -1.0])
    halves = np.stack([np.stack([well + sign * chance, hardly + sign * chance], axis=1) for sign in (1.0, -1.0)])

    class Known(Around):
        def slopes(self, at: Any, here: Any) -> Any:
            return halves

    around = Known(problem, (), [], np.diag([2.0, 5.0]), np.zeros(2))
    assert _hardly_seen(problem, around, here) == [1]


@pytest.mark.slow
def test_little_is_looked_at_where_that_is_no_use(
    point: Callable[..., Any], run_of: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """With little effort where another model is much better."""
    window = {"roi": Roi(40, 30, 8, 8), "periods": 10}
    efforts: list[float] = []

    def around(*given: Any) -> Any:
        efforts.append(given[-1])
        return samples_around(*given)

    with open_session([run_of([point(i, c, **window) for i, c in enumerate((0.2, 0.3, 0.6))], PIXEL, 3)]) as session:
        found = session.fit(4)
        monkeypatch.setattr(fit_module, "samples_around", around)
        near = from_here(session.problem, found, 5)
        finish(session.problem, near)
        finish(session.problem, near, beat=0.1 * near.loss)
        looked = len(efforts)
        finish(session.problem, near, known=found)
    assert efforts[0] > 3.0 * efforts[1]
    assert len(efforts) == looked  # what the numbers change was known


@pytest.mark.slow
def test_events_are_simulated_as_late_as_they_come(point: Callable[..., Any], run_of: Callable[..., Any]) -> None:
    """Stamps a look of 20 us later than the stimulus says; the first answers come after some 100 us."""
    quick = replace(PIXEL, corner_hz=400.0)
    window = {"roi": Roi(40, 30, 16, 16), "periods": 80}
    points = [point(i, c, **window) for i, c in enumerate((0.3, 0.4, 0.6, 0.8, 1.0, 1.2))]
    run = run_of(points, quick, 3)
    run = replace(run, taken=tuple(late(one, 20) for one in run.taken))
    with open_session([run]) as session:
        found = session.fit(4)
        problem = session.problem
        line = moved(replace(problem, forward=problem.forward.later(0)), found, found.x, seed=5)
    value = values_of(problem, found)["alignment.time_offset_s"]
    assert value.low <= 20e-6 <= value.high
    assert problem.forward.late_us == pytest.approx(20, abs=3)
    spreads = [i for i, label in enumerate(problem.measured.labels) if label.view == "latency_spread"]
    assert abs(float(np.mean(found.z[spreads]))) < 3.0 / math.sqrt(len(spreads))
    assert float(np.mean(line.z[spreads])) > 1.0  # a straight line makes them too narrow


def late(taken: Any, late_us: int) -> Any:
    stored = taken.stored.copy()
    stored["t"] += late_us
    return replace(taken, stored=stored)


def test_runs_that_cannot_be_explained_together_are_refused(
    point: Callable[..., Any], run_of: Callable[..., Any]
) -> None:
    with pytest.raises(InputError, match="has no points"), open_session([run_of([], PIXEL, 1)]):
        pass
    one = run_of([point(0, 0.3)], PIXEL, 1)
    header = replace(one.header, sensor=replace(one.header.sensor, quantum_efficiency=0.5))
    other = replace(one, header=header, folder=Path("other"))
    unlike = r"other: another sensor than that of made \(quantum_efficiency 0\.5 and 0\.6\)"
    with pytest.raises(InputError, match=unlike), open_session([one, other]):
        pass
    large = point(0, 0.0, roi=Roi(0, 0, 100, 100))
    limited = PIXEL + EventRateLimit(max_rate_eps=1e6)
    with (
        pytest.raises(InputError, match="a window of 10000 pixels"),
        open_session([run_of([large], PIXEL, 1)], limited),
    ):
        pass
