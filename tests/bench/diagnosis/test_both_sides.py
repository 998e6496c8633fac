"""Twins are tied where either of them cannot be told from the other."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bench.diagnosis.searching import ties
from bench.diagnosis.searching.ties import tied_with
from sim_backend.pixel.effects.registry import effects

#: The probes of a screen; what is asked of lines is not asked here.
NAMES = ("leak", "light_drift", "hot_pixels")
SCORES: Any = SimpleNamespace(
    probes=[SimpleNamespace(effect=effects()[name]) for name in NAMES], drop=np.ones(3), likeness=np.eye(3)
)
PROBLEM: Any = SimpleNamespace(points=())


def found(effect: str, deviance: float) -> Any:
    return SimpleNamespace(effect=effect, deviance=deviance)


@pytest.mark.parametrize(
    ("apart", "left", "tied"),
    [
        ({("light_drift", "leak"): 2.3, ("leak", "light_drift"): 0.5}, 1.03, ("leak",)),
        ({("light_drift", "leak"): 2.3, ("leak", "light_drift"): 3.1}, 1.03, ()),
        ({("light_drift", "leak"): 1.3}, 1.03, ("leak",)),  # the other side is not asked for
        ({("light_drift", "leak"): 9.0}, 4.0, ()),  # nor where one leaves much more
    ],
)
def test_either_side_ties_twins(
    monkeypatch: pytest.MonkeyPatch, apart: dict[tuple[str, str], float], left: float, tied: tuple[str, ...]
) -> None:
    asked: list[tuple[str, str]] = []

    def closest(_: Any, one: Any, other: Any, __: int) -> float:
        asked.append((one.effect, other.id))
        return apart[one.effect, other.id]

    monkeypatch.setattr(ties, "closest", closest)
    monkeypatch.setattr(ties, "separation", lambda *_: 2.4)
    best, twin = found("light_drift", 1.0), found("leak", left)
    assert tied_with(PROBLEM, best, [best, twin], SCORES, [0, 1], ["light_drift", "leak"], 1) == tied
    assert set(asked) == set(apart)


def test_what_is_no_twin_is_asked_from_the_best_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[str, str]] = []

    def closest(_: Any, one: Any, other: Any, __: int) -> float:
        asked.append((one.effect, other.id))
        return 2.3

    monkeypatch.setattr(ties, "closest", closest)
    monkeypatch.setattr(ties, "separation", lambda *_: 2.4)
    best, other = found("light_drift", 1.0), found("hot_pixels", 1.01)
    assert not tied_with(PROBLEM, best, [best, other], SCORES, [1, 2], ["light_drift", "hot_pixels"], 1)
    assert asked == [("light_drift", "hot_pixels")]


@pytest.mark.parametrize(("refitted", "tied"), [(True, ("leak",)), (False, ())])
def test_lines_that_promise_nothing_of_a_refitted_twin_do_not_tell_it(
    monkeypatch: pytest.MonkeyPatch, refitted: bool, tied: tuple[str, ...]
) -> None:
    monkeypatch.setattr(ties, "separation", lambda *_: 1.2)
    best, twin = found("light_drift", 1.0), found("leak", 1.07)
    scores = SimpleNamespace(**{**vars(SCORES), "drop": np.array([0.0, 67.0, 0.0])})
    known = [best, twin] if refitted else [best]
    assert tied_with(PROBLEM, best, known, scores, [0, 1, 2], (), 1) == tied  # type: ignore[arg-type]
