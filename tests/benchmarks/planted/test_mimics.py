"""An effect of the catalogue that comes nearest to another one is looked at in the size in which it does."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pytest

from bench.diagnosis.expected.catalogue import sized
from benchmarks.planted import mimics
from sim_backend.pixel.effects.registry import effects

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]

STATISTICS = 50
LEAK = effects()["leak"]
LEAK_AT_FIRST = cast("Any", sized(LEAK, 1.0)).rate_per_s


class Bare:
    """A model, which with an effect is that effect."""

    def __add__(self, effect: Any) -> Any:
        return effect


@dataclass
class Bent:
    """A truth beside which what a leak changes does not go along a line."""

    change: Callable[[float], Floats]
    truth: Floats

    def apart(self, model: Any) -> tuple[Floats, Floats]:
        """Return the truth less a model with a leak."""
        left = self.truth - self.change(model.rate_per_s)
        return left, left

    def changes(self, _: Any, others: Sequence[Any], steps: Sequence[float]) -> tuple[Floats, Floats]:
        """Return what both sets of sensors show of the first of the others, by unit of its step."""
        column = (self.change(others[0].rate_per_s) / steps[0])[:, None]
        return column, column


def bent(rate: float) -> Floats:
    """Return a change that turns by a right angle while the leak grows to 1/s."""
    change = np.zeros(STATISTICS)
    angle = 0.5 * np.pi * min(rate, 1.0)
    change[0], change[1] = 200.0 * rate * np.cos(angle), 200.0 * rate * np.sin(angle)
    return change


def left_by_a_leak(apart: Floats, change: Callable[[float], Floats] = bent) -> float:
    none = np.zeros((STATISTICS, 0))
    truth, model = cast("Any", Bent(change, apart)), cast("Any", Bare())
    return mimics._with(LEAK, truth, model, (none, none), np.zeros(0), (apart, apart))[1]


@pytest.mark.parametrize("rate", [0.002, 0.05, 0.4, 0.8])
def test_what_is_the_same_in_another_size_leaves_next_to_nothing(rate: float) -> None:
    apart = bent(rate)
    assert left_by_a_leak(apart) < 0.03 * float(apart @ apart)


def test_what_goes_the_other_way_takes_up_nothing() -> None:
    apart = -bent(0.3)
    assert left_by_a_leak(apart) == pytest.approx(float(apart @ apart))


def test_what_is_nothing_like_it_is_left() -> None:
    apart = np.zeros(STATISTICS)
    apart[7] = 12.0
    assert left_by_a_leak(apart) == pytest.approx(144.0)


def test_what_does_too_little_to_be_seen_is_made_larger() -> None:
    """At the size that is looked at first, nothing of it stands out of chance."""

    def change(rate: float) -> Floats:
        shown = np.zeros(STATISTICS)
        shown[0] = 50.0 * rate if rate > 2.0 * LEAK_AT_FIRST else 0.0
        return shown

    apart = change(50.0 * LEAK_AT_FIRST)
    assert left_by_a_leak(apart, change) < 0.05 * float(apart @ apart)
