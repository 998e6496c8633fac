"""The size of an effect that had to be made larger to be seen."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pytest

from benchmarks.planted import sizes

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]

STATISTICS = 400
DOUBT = np.sqrt(STATISTICS)  # standard error of the product of two sets of independent numbers of unit variance


@dataclass
class Seen:
    """A truth of which some effect moves one statistic by so many standard errors, whatever its factor."""

    moved: Callable[[float], float]

    def apart(self, _: Any, factor: float) -> tuple[Floats, Floats]:
        """Return what two sets of sensors show: half of the chance of each goes one way, half the other."""
        rng = np.random.default_rng(3)
        first = np.append(rng.standard_normal(STATISTICS - 1), 0.0)
        second = np.append(rng.standard_normal(STATISTICS - 1), 0.0)
        second -= first * (first @ second) / (first @ first)  # nothing in common
        first[-1] = second[-1] = self.moved(factor)
        return first, second


def size_of(moved: Callable[[float], float], monkeypatch: pytest.MonkeyPatch) -> float:
    truth = Seen(moved)
    monkeypatch.setattr(sizes, "_larger", lambda _, factor: factor)
    none = np.zeros((STATISTICS, 0))
    effect = cast("Any", SimpleNamespace())
    return sizes._size(cast("Any", truth), cast("Any", 0.0), effect, truth.apart(None, 1.0), none, np.zeros(0))


def test_a_small_effect_is_a_straight_line(monkeypatch: pytest.MonkeyPatch) -> None:
    assert size_of(lambda factor: 2.0 * factor, monkeypatch) == pytest.approx(2.0)


def test_what_sets_in_beyond_a_size_is_no_larger_than_what_was_seen_below(monkeypatch: pytest.MonkeyPatch) -> None:
    found = size_of(lambda factor: 1e5 if factor > 10.0 else 0.0, monkeypatch)
    assert 0.0 < found < np.sqrt(3.5 * DOUBT)
