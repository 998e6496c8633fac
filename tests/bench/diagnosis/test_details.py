"""Details of effects stay what they usually are until the data ask for another value."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from bench.diagnosis.expected.catalogue import details_of, free_of, numbers_of
from bench.diagnosis.fitting import details
from bench.diagnosis.fitting.details import with_a_detail
from bench.diagnosis.fitting.judging import deviance_per_dof, leaves_more_than_chance, values_of
from bench.diagnosis.session import open_session
from sim_backend.pixel import PixelModel
from sim_backend.pixel.effects import DarkCurrent, Leak
from sim_backend.pixel.effects.registry import effects

if TYPE_CHECKING:
    from collections.abc import Callable

    from bench.diagnosis.expected.problem import Problem
    from bench.diagnosis.fitting.fitted import Fit

ROUGHLY = PixelModel(theta_on=0.3, theta_off=0.25, noise_rms=0.04, corner_hz=150.0, refractory_s=8e-3)
POINTS = ((0.2, 0.3), (0.2, 0.5), (0.2, 0.8), (0.2, 1.2), (100.0, 0.0), (100.0, 0.25), (100.0, 0.35), (100.0, 0.8))


def names(model: PixelModel) -> list[str]:
    return [free.key for effect in model.effects for free in numbers_of(effect)]


@pytest.mark.parametrize("effect_id", sorted(effects()))
def test_details_are_other_numbers_than_those_that_are_always_free(effect_id: str) -> None:
    effect = effects()[effect_id]
    usual = effect()
    assert names(PixelModel() + usual) == [f.key for f in free_of(effect)]
    for free, tries in details_of(effect):
        assert free.key not in names(PixelModel() + usual)
        for value in tries:
            assert value != getattr(usual, free.field)
            assert free.value(free.coordinate(value)) == pytest.approx(value)


def test_a_detail_that_a_model_has_is_fitted() -> None:
    assert names(PixelModel() + DarkCurrent(2.0)) == ["dark_current.mean_fa"]
    assert names(PixelModel() + DarkCurrent(2.0, 0.3)) == ["dark_current.mean_fa", "dark_current.spread"]


def both(
    point: Callable[..., Any], run_of: Callable[..., Any], truth: PixelModel, model: PixelModel
) -> tuple[Problem, Fit, Fit]:
    """Return a fitted model of what a sensor took, before and after its details were thought of."""
    points = [point(i, contrast, lux=lux, periods=15) for i, (lux, contrast) in enumerate(POINTS)]
    with open_session([run_of(points, truth, 3)], model) as session:
        found = session.fit(1)
        return session.problem, found, with_a_detail(session.problem, found, 2)


@pytest.mark.slow
def test_a_dark_current_that_differs_between_pixels_gets_a_spread(
    point: Callable[..., Any], run_of: Callable[..., Any]
) -> None:
    problem, before, after = both(point, run_of, ROUGHLY + DarkCurrent(6.0, 0.5), ROUGHLY + DarkCurrent(5.0))
    assert deviance_per_dof(problem, before) > 1.5
    assert deviance_per_dof(problem, after) < 1.2
    # 64 pixels tell the spread of a log-normal law to 9 %.
    assert values_of(problem, after)["dark_current.spread"].value == pytest.approx(0.5, rel=4.0 * 0.09)


@pytest.mark.slow
def test_a_detail_does_not_stand_in_for_an_effect_that_promises_more(
    point: Callable[..., Any], run_of: Callable[..., Any]
) -> None:
    points = [point(i, contrast, lux=lux, periods=15) for i, (lux, contrast) in enumerate(POINTS)]
    with open_session([run_of(points, ROUGHLY + DarkCurrent(6.0, 0.5), 3)], ROUGHLY + DarkCurrent(5.0)) as session:
        found = session.fit(1)
        assert with_a_detail(session.problem, found, 2, beat=1e6) is found


@pytest.mark.slow
def test_what_is_explained_asks_for_no_details(
    point: Callable[..., Any], run_of: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []
    monkeypatch.setattr(details, "_most_promising", lambda *_: asked.append(1))
    points = [point(i, contrast, lux=lux, periods=15) for i, (lux, contrast) in enumerate(POINTS)]
    with open_session([run_of(points, ROUGHLY + Leak(0.08), 3)], ROUGHLY + Leak(0.05)) as session:
        found = session.fit(2)
        assert not leaves_more_than_chance(session.problem, found)
        assert with_a_detail(session.problem, found, 2) is found
    assert not asked
