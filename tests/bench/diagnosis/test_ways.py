"""Directions in which is looked how what is expected changes: as long as wanted, whatever was thought before."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from bench.diagnosis.expected.parameters import Free
from bench.diagnosis.expected.problem import Slot
from bench.diagnosis.fitting import ways
from bench.diagnosis.fitting.slopes import Sample
from bench.diagnosis.fitting.steps import inside, longest_of

#: So many statistics; two numbers do nearly the same to them, a third one hardly anything.
N = 60
_RNG = np.random.default_rng(8)
_SLOPE = _RNG.normal(size=(N, 3)) @ np.array([[800.0, 780.0, 0.0], [0.0, 60.0, 0.0], [0.0, 0.0, 20.0]])
_SLOTS = tuple(
    Slot(Free("noise_floor", name, name, "ln", "linear", -9.0, 9.0, 0.1, 9.0, effect=False)) for name in "abc"
)
_AT = np.zeros(3)
_HERE = cast("Any", SimpleNamespace(value=np.zeros(N), value_or=lambda _: np.zeros(N), roots=(np.eye(N),)))
_PROBLEM = cast("Any", SimpleNamespace(measured=SimpleNamespace(labels=(), points=(slice(0, N),))))


def _samples(*given: Any) -> list[Sample]:
    """Return what is expected to both sides, with an independent chance for each sensor."""
    directions, seed = given[5], given[4]
    rng = np.random.default_rng(seed)
    places = [(inside(_SLOTS, _AT + sign * way), i) for i, way in enumerate(directions.T) for sign in (1.0, -1.0)]
    return [Sample(x, _SLOPE @ x + rng.normal(size=(2, N)), 1.0, i) for x, i in places]


@pytest.mark.parametrize("thought", [np.zeros((3, 3)), np.diag([1e2, 1e8, 1e2]), np.diag([1e9, 0.0, 1e9])])
def test_statistics_move_as_far_as_wanted_whatever_was_thought(
    thought: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ways, "samples_around", lambda *given: _samples(*given[:6]))
    found = ways.well_seen(_PROBLEM, cast("Any", None), _SLOTS, _AT, _HERE, thought, 4)
    longest = longest_of(_SLOTS, _AT)[0] * 0.3
    moved = np.linalg.norm(_SLOPE @ found, axis=0)
    lengths = np.linalg.norm(found, axis=0)
    # Along each way by 60 standard errors, or less if it is the longest; and no two ways do the same.
    for far, length in zip(moved, lengths, strict=True):
        assert far < 2.0 * 60.0
        assert far > 0.5 * 60.0 or length > 0.9 * longest
    unit = _SLOPE @ found / moved
    assert np.linalg.svd(unit, compute_uv=False).min() > 0.5


def test_a_valley_between_an_offset_and_other_numbers_is_gone_along(monkeypatch: pytest.MonkeyPatch) -> None:
    # An offset is known to the letter, and does nearly what the first number does.
    offset = Slot(
        Free("alignment", "time_offset_s", "time_offset_s", "s", "linear", -9.0, 9.0, 1.0, 9.0, effect=False)
    )
    away = _RNG.normal(size=N)
    columns = np.column_stack([_SLOPE[:, 0], _SLOPE[:, 0] + 40.0 * away / np.linalg.norm(away)])
    found = ways.directions((_SLOTS[0], offset), np.zeros(2), columns.T @ columns)
    assert found.shape == (2, 1)
    moved = columns[:, 0] * found[0, 0]
    left = moved - columns[:, 1] * (columns[:, 1] @ moved) / (columns[:, 1] @ columns[:, 1])
    longest = 0.3 * longest_of(_SLOTS, _AT)[0]
    assert np.linalg.norm(left) == pytest.approx(60.0, rel=0.1) or found[0, 0] == pytest.approx(longest)
    assert np.linalg.norm(moved) > 120.0  # by the number alone it looks well seen on a much shorter way
