"""Phases of a ripple turn with the events when these are simulated later."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bench.compute.local import InProcess
from bench.diagnosis import session
from bench.diagnosis.expected.forward import Forward, Task, _Pixels, _Taken
from bench.diagnosis.expected.parameters import time_offset
from bench.diagnosis.expected.problem import Slot
from bench.diagnosis.recorded.recording import Frame
from bench.diagnosis.session import Session
from sim_backend.pixel import PixelModel
from sim_backend.pixel.effects import Leak, LightFlicker

if TYPE_CHECKING:
    from collections.abc import Callable

HZ = 97.0
RIPPLE = PixelModel() + LightFlicker(depth=0.1, frequency_hz=HZ)
OFFSET = (Slot(time_offset(1e-5)),)


@dataclass(frozen=True)
class MadeUp:
    """A problem of which nothing but the clock and the ripple is asked."""

    forward: Forward = field(default_factory=lambda: Forward([], InProcess(), 1e-5))
    given: dict[str, dict[str, float]] = field(default_factory=lambda: {"light_flicker": {"frequency_hz": HZ}})
    phases: tuple[float | None, ...] = (0.5, None, 6.28)


def in_time(problem: Any, late_s: float) -> Any:
    return session.on_its_clock(problem, OFFSET, np.array([late_s]))


def test_phases_turn_with_the_events() -> None:
    later = in_time(MadeUp(), 30e-6)
    turn = 2.0 * math.pi * HZ * 30e-6
    assert later.forward.late_us == 30
    assert later.phases == (pytest.approx(0.5 + turn), None, pytest.approx((6.28 + turn) % (2.0 * math.pi)))
    back = in_time(later, 0.0)
    assert back.phases == (pytest.approx(0.5), None, pytest.approx(6.28))


def test_without_a_ripple_there_is_nothing_to_turn() -> None:
    assert in_time(MadeUp(given={}, phases=()), 30e-6).phases == ()


def test_events_go_with_the_ripple_as_before(point: Callable[..., Any]) -> None:
    """The mean phase at which events come is the same, when both are 2 ms later: a fifth of a turn."""
    asked = point(0, 0.0, lux=10.0)
    deep = PixelModel(noise_rms=0.08, corner_hz=400.0, theta_on=0.3, theta_off=0.3, refractory_s=1e-3)
    late_us = 2000

    def mean_phase(late: int, phase: float) -> complex:
        model = deep + LightFlicker(depth=0.4, frequency_hz=HZ, phase=phase)
        task = Task((asked,), ((model,),), (0,), 2e-5, seed=1, late_us=late)
        events = np.concatenate(list(_Taken(task, task.models[0], 0).events(Frame(asked), 0, _Pixels([None]))))
        on = events["t"][events["p"] == 1] * 1e-6
        return complex(np.mean(np.exp(2j * math.pi * HZ * on)))

    known = mean_phase(0, 1.0)
    turned = in_time(MadeUp(phases=(1.0,)), 1e-6 * late_us).phases[0]
    later = mean_phase(late_us, turned)
    assert abs(known) > 0.3
    assert abs(np.angle(later / known)) < 0.1
    assert abs(np.angle(mean_phase(late_us, 1.0) / known)) > 1.0


class OfRipple(Session):
    """A session in which fits are their errors."""

    def __init__(self) -> None:
        self.problem: Any = MadeUp()
        self.timed: list[Any] = []

    def in_time(self, found: Any, seed: int) -> Any:
        self.timed.append(found)
        return SimpleNamespace(model=found.model, timed=True)


@pytest.mark.parametrize("better", [True, False])
def test_the_clock_is_looked_at_behind_new_phases(monkeypatch: pytest.MonkeyPatch, better: bool) -> None:
    before: Any = SimpleNamespace(model=RIPPLE, timed=False)
    turned: Any = SimpleNamespace(model=RIPPLE, timed=False) if better else before
    monkeypatch.setattr(session, "in_phase", lambda problem, *_: (problem, turned))
    mine = OfRipple()
    found: Any = mine.in_phase(before, 1)
    assert found.timed is better
    assert mine.timed == [turned] * better


def test_a_model_without_the_ripple_has_no_phases(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "in_phase", lambda *_: pytest.fail("looked for phases"))
    found: Any = SimpleNamespace(model=PixelModel() + Leak(0.1))
    assert OfRipple().in_phase(found, 1) is found
