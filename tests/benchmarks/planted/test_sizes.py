"""The size of an effect that had to be made larger to be seen."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pytest

from benchmarks.planted import sizes
from benchmarks.planted.falls import believed, fall, uncertainty
from benchmarks.planted.following import Least

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


def size_of(
    moved: Callable[[float], float],
    monkeypatch: pytest.MonkeyPatch,
    known: Callable[[float], float] = lambda _: 0.0,
) -> float:
    """Return the size of what shows, and of what the numbers that have followed it were known to be beforehand."""
    truth = Seen(moved)

    def left(*at: Any) -> Least:
        beforehand = known(at[2] or 1.0) ** 2
        return Least(cast("Any", None), fall(*at[3:]) + beforehand, uncertainty(*at[3]), beforehand)

    monkeypatch.setattr(sizes, "_larger", lambda _, factor: factor)
    monkeypatch.setattr(sizes, "left_along", left)
    none = np.zeros((STATISTICS, 0))
    effect = cast("Any", SimpleNamespace())
    return sizes._size(
        cast("Any", truth), cast("Any", 0.0), effect, truth.apart(None, 1.0), (none, none), np.zeros(0)
    )  # fmt: skip


def test_a_small_effect_is_a_straight_line(monkeypatch: pytest.MonkeyPatch) -> None:
    assert size_of(lambda factor: 2.0 * factor, monkeypatch) == pytest.approx(2.0)


def test_what_goes_with_the_square_falls_as_fast(monkeypatch: pytest.MonkeyPatch) -> None:
    """A jitter of time stamps adds its square to the spread of latencies."""
    assert size_of(lambda factor: 0.5 * factor**2, monkeypatch) == pytest.approx(0.5, rel=0.01)


def test_what_only_goes_against_what_is_known_beforehand_is_in_no_doubt(monkeypatch: pytest.MonkeyPatch) -> None:
    """A delay is a later clock: until it is larger than the clock lets it be, nothing of it shows."""
    found = size_of(lambda factor: 1e3 if factor > 1.0 else 0.0, monkeypatch, known=lambda factor: 3.0 * factor)
    assert found == pytest.approx(3.0, abs=0.01)


def test_what_sets_in_beyond_a_size_is_no_larger_than_what_was_seen_below(monkeypatch: pytest.MonkeyPatch) -> None:
    found = size_of(lambda factor: 1e5 if factor > 10.0 else 0.0, monkeypatch)
    assert 0.0 < found < np.sqrt(3.5 * DOUBT)


def test_chance_in_the_changes_leaves_no_size() -> None:
    """What another corner of the filter and a later clock do together is no effect, however chance bends them."""
    rng = np.random.default_rng(5)
    corner, clock = (rng.standard_normal((STATISTICS, 1)) for _ in range(2))
    true = np.concatenate([60.0 * corner, 50.0 * corner + 5.0 * clock], axis=1)
    apart = true @ np.array([-0.2, 1.5])
    seen = [
        fall(
            (apart + rng.standard_normal(STATISTICS), apart + rng.standard_normal(STATISTICS)),
            (true + rng.standard_normal(true.shape), true + rng.standard_normal(true.shape)),
            np.zeros(2),
        )
        for _ in range(30)
    ]
    assert abs(np.mean(seen)) < 3.0 * np.std(seen) / np.sqrt(len(seen))


def test_what_is_known_beforehand_takes_up_less() -> None:
    change = np.zeros((STATISTICS, 1))
    change[0] = 3.0
    apart = 4.0 * change[:, 0]
    known = fall((apart, apart), (change, change), np.array([9.0]))
    assert known == pytest.approx(72.0)  # half of 12 squared: 9 of the data and 9 beforehand


def test_numbers_of_which_nothing_shows_take_up_nothing() -> None:
    # By three numbers nothing changes but by chance; one of them is known beforehand.
    falls = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        apart = np.zeros(STATISTICS)
        apart[0] = 40.0
        chance = rng.standard_normal((2, STATISTICS, 3)) * 2.0
        changes = believed(*chance)
        falls.append(fall((apart, apart), changes, np.array([0.0, 1.0, 0.0])))
    # One in a thousand such columns stands out by three standard errors.
    assert falls == pytest.approx([1600.0] * len(falls))


def test_what_shows_clearly_is_believed() -> None:
    rng = np.random.default_rng(1)
    true = np.zeros((STATISTICS, 1))
    true[:20] = 30.0
    first, second = believed(*(true + rng.standard_normal((STATISTICS, 1)) for _ in range(2)))
    left = fall((5.0 * true[:, 0],) * 2, (first, second), np.zeros(1))
    assert abs(left) < 0.01 * 25.0 * float(np.sum(true**2))
