"""A fit that stopped in a valley: the deviances are written down by hand."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bench.diagnosis.expected.parameters import Free
from bench.diagnosis.expected.problem import Slot
from bench.diagnosis.fitting import settling
from bench.diagnosis.fitting.judging import more_than_chance
from sim_backend.pixel import PixelModel
from sim_backend.pixel.effects import LowFrequencyNoise

if TYPE_CHECKING:
    from collections.abc import Callable

FREEDOM = 800
DEAD = Slot(Free("refractory_period", "period_s", "refractory_s", "s", "log", 1e-6, 1.0, 0.1, 0.1, effect=False))
RMS = Slot(Free("low_frequency_noise", "rms", "rms", "ln", "square", 0.0, 1.0, 0.05))
TAU = Slot(Free("low_frequency_noise", "tau_s", "tau_s", "s", "log", 1e-3, 1e3, 1.0))
START = math.log(2.5e-3)


class Place:
    """A fit at a place; the size of slow noise follows its time along a straight line."""

    def __init__(self, x: Any) -> None:
        self.x = np.asarray(x)
        self.start = np.array([START, 0.0025, 0.0])
        self.slots = (DEAD, RMS, TAU)
        self.model = PixelModel() + LowFrequencyNoise(0.05, 1.0)
        self.jacobian = np.zeros((2, 2, 3))
        self.jacobian[:, 0, 0] = 1.0
        self.jacobian[:, 1, 1:] = 1.0, -0.01

    def whiten(self, values: Any, _: Any) -> Any:
        """Return them as they are."""
        return values


@pytest.fixture
def fits(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[Any], float]], list[Any]]:
    """Let fits end where they begin, with a deviance by hand; return the places that are tried."""
    tried: list[Any] = []

    def by_hand(deviance: Callable[[Any], float]) -> list[Any]:
        def finish(_: Any, place: Any, *, precise: bool) -> Place:
            assert not precise
            tried.append(place)
            return Place(place)

        def leaves_more_than_chance(_: Any, one: Any) -> bool:
            return more_than_chance(deviance(one.x), FREEDOM) >= 2.0

        monkeypatch.setattr(settling, "approach", lambda _, __, ___, x, **____: np.array(x))
        monkeypatch.setattr(settling, "finish", finish)
        monkeypatch.setattr(settling, "deviance_per_dof", lambda _, one: deviance(one.x) / FREEDOM)
        monkeypatch.setattr(settling, "leaves_more_than_chance", leaves_more_than_chance)
        return tried

    return by_hand


def problem(**given: Any) -> Any:
    return SimpleNamespace(given=given, measured=SimpleNamespace(points=None, labels=()))


def test_a_fit_that_is_good_is_left_alone(fits: Any) -> None:
    tried = fits(lambda _: float(FREEDOM))
    found: Any = Place([START, 0.01, 0.0])
    assert settling.settled(problem(), found, 1) is found
    assert tried == []


def test_a_model_that_lacks_much_is_left_alone(fits: Any) -> None:
    tried = fits(lambda _: 6.0 * FREEDOM)
    found: Any = Place([START, 0.01, 0.0])
    assert settling.settled(problem(), found, 1) is found
    assert tried == []


def test_what_is_known_beforehand_goes_back_to_where_it_is_known_to_be(fits: Any) -> None:
    tried = fits(lambda x: FREEDOM * (1.0 + abs(x[0] - START)))
    found: Any = Place([START + 0.3, 0.01, 0.0])
    better = settling.settled(problem(low_frequency_noise={"tau_s": 1.0}), found, 1)
    assert better.x.tolist() == [START, 0.01, 0.0]
    assert len(tried) == 1


def test_a_shape_is_followed_along_its_valley(fits: Any) -> None:
    """From four times the time, and so much more noise, in two rounds."""

    def deviance(x: Any) -> float:
        along = abs(x[2]) / math.log(2.0)
        return float(FREEDOM * (1.0 + 0.5 * along + 1e3 * abs(x[1] - 0.01 * x[2] - 0.01)))

    fits(deviance)
    far = math.log(4.0)
    found: Any = Place([START, 0.01 + 0.01 * far, far])
    better = settling.settled(problem(), found, 1)
    assert better.x == pytest.approx([START, 0.01, 0.0], abs=1e-9)


def test_a_shape_that_is_known_is_left_alone(fits: Any) -> None:
    tried = fits(lambda _: 1.5 * FREEDOM)
    found: Any = Place([START, 0.01, 1.0])
    settling.settled(problem(low_frequency_noise={"tau_s": math.e}), found, 1)
    assert [place[2] for place in tried] == [1.0]


OFF = Slot(Free("thresholds", "off", "theta_off", "ln", "log", 0.02, 5.0, 0.05, 1.0, effect=False))


@dataclass(frozen=True)
class Placed:
    """A fit of a dead time and a threshold."""

    x: Any
    start: Any = None
    slots: Any = (DEAD, OFF)
    model: Any = PixelModel()  # noqa: RUF009 - it is never changed
    value: Any = None
    common: float = 1.0
    jacobian: Any = field(default_factory=lambda: np.ones((2, 3, 2)))

    def models(self, problem: Any) -> Any:
        return problem.models(self.model, self.slots, self.x)


@pytest.mark.parametrize(("asked", "expected"), [(["on"], 0.25), (["on", "off"], 0.32)])
def test_a_threshold_that_only_rare_events_tell_is_looked_for_farther_off(
    asked: list[str], expected: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From 0.32 nothing leads back to 0.25, where the events of noise are expected that were seen."""

    def fit_at(x: Any) -> Any:
        return Placed(np.asarray(x))

    def missed(x: Any) -> bool:
        return bool(abs(x[1] - math.log(0.25)) > 0.06)

    labels = [SimpleNamespace(view="response", part=part, point=0) for part in asked]
    made: Any = SimpleNamespace(
        given={},
        setting=(0,),
        cost=lambda _: 1.0,
        measured=SimpleNamespace(labels=labels),
        models=lambda _, __, x: x,
        simulate=lambda places, _, __: places,
        expect=lambda x: SimpleNamespace(value_or=lambda _: x),
    )
    monkeypatch.setattr(settling, "shifted", lambda _, expected, *__: expected)

    def followed(_: Any, __: Any, x: Any, *, holding: int | None) -> tuple[float, Any]:
        """A number that could go back would cost nothing."""
        back = holding != 1 and abs(x[1] - math.log(0.32)) > 0.01
        return 100.0 if back else 200.0 + 60.0 * missed(x), np.array([0.5, 0.0])

    monkeypatch.setattr(settling, "followed", followed)
    monkeypatch.setattr(settling, "_from", lambda _, __, x, *___, **____: fit_at(x))
    monkeypatch.setattr(settling, "deviance_per_dof", lambda _, one: 0.9 + 0.1 * missed(one.x))
    monkeypatch.setattr(settling, "leaves_more_than_chance", lambda *_: False)
    found = settling.settled(made, fit_at([START, math.log(0.32)]), 1)
    assert math.exp(found.x[1]) == pytest.approx(expected, rel=0.06)
    assert found.x[0] == START + 0.5 * (expected < 0.3)  # what else is free has followed
