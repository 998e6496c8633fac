"""The errors of steps fall by what effects take away, whatever chance there is in the simulations."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bench.diagnosis.expected.parameters import base_parameters
from bench.diagnosis.expected.problem import Slot
from bench.diagnosis.fitting.fitted import Fit
from bench.diagnosis.searching import fall_of_errors as module
from bench.diagnosis.searching.fall_of_errors import errors_of
from sim_backend.pixel import PixelModel
from sim_backend.pixel.effects import Leak

if TYPE_CHECKING:
    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]

POINTS, EACH = 30, 20
N = POINTS * EACH
SLICES = tuple(slice(i * EACH, (i + 1) * EACH) for i in range(POINTS))
#: (n,) what was measured, with the scatter of a true model that expects 0, and no responses among it.
MEASURED = np.random.default_rng(1).standard_normal(N)
PROBLEM: Any = SimpleNamespace(
    measured=SimpleNamespace(points=SLICES, labels=(), ratio=np.zeros(N)),
    models=lambda model, *_: [model],
    cost=lambda _: 1.0,
)
#: (n,) what the model without an effect expects instead: 30 in squares, of 600.
LACKING = np.random.default_rng(2).standard_normal(N) * math.sqrt(30.0 / N)
#: Standard deviation of what is simulated, beside that of what is measured.
CHANCE = 0.3


def state(true: Floats, seed: int) -> Any:
    """Return the state of a model that expects something; its fit knows that but for chance."""
    value = true + CHANCE * np.random.default_rng(seed).standard_normal(N)
    fit = Fit(
        model=PixelModel(), slots=(Slot(base_parameters(refractory_known=True)[0]),), x=np.zeros(1),
        start=np.zeros(1), value=value, ratio=value, roots=(np.eye(EACH),) * POINTS, deviation=np.ones(N),
        jacobian=np.zeros((2, N, 1)), scale=1.0, residual=MEASURED - value,
    )  # fmt: skip
    return SimpleNamespace(problem=PROBLEM, fit=fit, true=true)


class Simulations:
    """Simulates models of a search; what has the same seed has chance in common, and may have more of its own."""

    def __init__(self) -> None:
        self.seeds: list[int] = []
        self.efforts: dict[int, float] = {}
        self.states: list[Any] = []
        self.own = 0.0

    def search(self, *lacking: Floats, own: float = 0.0) -> list[Any]:
        """Return states whose models expect so much of what is 0."""
        self.states = [state(true, 10 + i) for i, true in enumerate(lacking)]
        self.own = own
        return self.states

    def moved(self, problem: Any, one: Fit, x: Floats, seed: int, effort: float) -> Fit:
        assert problem is PROBLEM
        assert x is one.x
        self.seeds.append(seed)
        number, true = next((i, s.true) for i, s in enumerate(self.states) if s.fit is one)
        self.efforts[number] = effort
        common, own = (np.random.default_rng(key).standard_normal(N) for key in ([seed], [seed, number]))
        value = true + CHANCE * (common + self.own * own)
        return replace(one, value=value, residual=MEASURED - value)


@pytest.fixture
def simulated(monkeypatch: pytest.MonkeyPatch) -> Simulations:
    found = Simulations()
    monkeypatch.setattr(module, "moved", found.moved)
    return found


def squares(residual: Floats) -> float:
    return float(residual @ residual) / (N - 1)


def test_the_fall_is_that_of_the_effect(simulated: Simulations) -> None:
    """By itself the first fit has chance of its own, which is as large as what the effect takes away."""
    first, last = simulated.search(LACKING, np.zeros(N))
    errors = errors_of([first, last], 5)
    assert errors[1].deviance_per_dof == pytest.approx(squares(last.fit.residual))
    assert errors[0].deviance_per_dof == pytest.approx(squares(last.fit.residual - LACKING))
    assert errors[0].heldout_deviance_per_dof > errors[1].heldout_deviance_per_dof
    assert sorted(simulated.seeds) == sorted(2 * [5, 5 + module._OTHER_SEED])


@pytest.mark.parametrize("cost", [3.0, 80.0])
def test_as_many_pixels_are_simulated_of_each_model(
    simulated: Simulations, monkeypatch: pytest.MonkeyPatch, cost: float
) -> None:
    """Else they have no chance in common; a dear one does not take forever."""
    monkeypatch.setattr(PROBLEM, "cost", lambda models: cost if models[0].effects else 0.5)
    first, last = simulated.search(LACKING, np.zeros(N))
    last.fit = replace(last.fit, model=last.fit.model + Leak(rate_per_s=0.1))
    errors_of([first, last], 5)
    pixels = min(4.0, 40.0 / cost)
    assert simulated.efforts == pytest.approx({0: 0.5 * pixels, 1: cost * pixels})


def test_chance_that_models_do_not_share_adds_nothing_on_average(simulated: Simulations) -> None:
    first, last = simulated.search(LACKING, np.zeros(N), own=1.0)
    found = [errors_of([first, last], 10 * seed)[0].deviance_per_dof for seed in range(60)]
    assert simulated.seeds
    sharp = squares(last.fit.residual - LACKING)
    off = np.mean(found) - sharp
    assert abs(off) < 3.0 * np.std(found) / math.sqrt(60.0)
    # Each difference has twice the variance of one simulation: that would have been added.
    assert 3.0 * np.std(found) / math.sqrt(60.0) < 2.0 * CHANCE**2


def test_what_is_far_off_and_what_is_alone_is_told_as_it_is(simulated: Simulations) -> None:
    far, last = simulated.search(40.0 * LACKING, np.zeros(N))
    assert [e.deviance_per_dof for e in errors_of([far, last], 1)] == [squares(s.fit.residual) for s in (far, last)]
    near, off = simulated.search(LACKING, 40.0 * LACKING)  # a person added it
    assert [e.deviance_per_dof for e in errors_of([near, off], 1)] == [squares(s.fit.residual) for s in (near, off)]
    (only,) = simulated.search(LACKING)
    assert errors_of([only], 1)[0].deviance_per_dof == squares(only.fit.residual)
    assert not simulated.seeds


def test_what_one_of_them_says_nothing_of_stays_as_it_was(simulated: Simulations) -> None:
    first, last = simulated.search(LACKING, np.zeros(N))
    some = np.arange(N) < 50
    last.fit = replace(last.fit, deviation=np.where(some, 1e6, 1.0))
    (found, _) = errors_of([first, last], 5)
    expected = np.where(some, first.fit.residual, last.fit.residual - LACKING)
    assert simulated.seeds
    assert found.deviance_per_dof == pytest.approx(squares(expected))
