"""The loop of a diagnosis: what was added and taken out again does not come back."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bench.diagnosis.diagnosis import Diagnosis
from bench.diagnosis.expected.parameters import Free
from bench.diagnosis.expected.problem import Slot
from bench.diagnosis.searching.refit import needless
from sim_backend.pixel import PixelModel
from sim_backend.pixel.effects import DarkCurrent, HotPixels


class Wavering(Diagnosis):
    """Proposes effects in turn; each takes the one before out again."""

    def __init__(self, proposals: list[str | None]) -> None:
        self.proposals = proposals
        self.added: list[str] = []
        self._states = [SimpleNamespace(added=None)]  # type: ignore[list-item]

    @property
    def proposal(self) -> str | None:
        return self.proposals[len(self.added)]

    def add(self, effect_id: str) -> Any:
        self.added.append(effect_id)
        self._states.append(SimpleNamespace(added=effect_id))  # type: ignore[arg-type]

    def _drop(self) -> None:
        self._states = [self._states[0], self._states[-1]]


def test_what_was_taken_out_does_not_come_back() -> None:
    made = Wavering(["leak", "dark_current", "leak", "dark_current", "leak"])
    made._go_on(3)
    assert made.added == ["leak", "dark_current"]


def test_it_ends_when_nothing_is_proposed() -> None:
    made = Wavering(["leak", "dark_current", None])
    made._go_on(3)
    assert made.added == ["leak", "dark_current"]


@pytest.mark.parametrize(("sigmas", "now", "before"), [(1.5, True, True), (2.8, False, True), (4.0, False, False)])
def test_what_others_made_insignificant_is_needless(sigmas: float, now: bool, before: bool) -> None:
    slot = Slot(Free("dark_current", "mean_fa", "mean_fa", "fA", "linear", 0.0, 1e3, 3.0))
    fit: Any = SimpleNamespace(
        model=PixelModel() + DarkCurrent(1.0), slots=(slot,), x=np.array([sigmas]), covariance=lambda _: np.eye(1)
    )
    problem: Any = SimpleNamespace(measured=SimpleNamespace(points=()))
    assert needless(problem, fit, "dark_current") is now
    assert needless(problem, fit, "dark_current", before=True) is before


@dataclass(frozen=True)
class Frozen:
    """A fitted number that chance leaves to 1, and what is frozen in the pixels to `frozen` more."""

    model: PixelModel
    slots: tuple[Slot, ...]
    x: np.ndarray[Any, Any]
    frozen: np.ndarray[Any, Any] | None

    def covariance(self, _: Any) -> Any:
        return np.eye(1) + (0.0 if self.frozen is None else np.diag(self.frozen))


@pytest.mark.parametrize(("effect", "field", "verdict"), [
    (HotPixels(fraction=0.01, rate_hz=10.0), "fraction", False),
    (DarkCurrent(1.0), "mean_fa", True),
])  # fmt: skip
def test_one_hot_pixel_is_seen_though_the_next_sensor_may_have_none(effect: Any, field: str, verdict: bool) -> None:
    """How many there are is frozen in the sensor: that is no doubt about whether this one has any."""
    slot = Slot(Free(effect.id, field, field, "1", "linear", 0.0, 1e3, 3.0))
    fit: Any = Frozen(PixelModel() + effect, (slot,), np.array([10.0]), np.array([100.0]))
    problem: Any = SimpleNamespace(measured=SimpleNamespace(points=()))
    assert needless(problem, fit, effect.id) is verdict
