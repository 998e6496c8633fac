"""What promises where little is missing is looked at again, with more effort and another seed."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from bench.diagnosis.diagnosis import Diagnosis
from bench.diagnosis.fitting import sharpening

MODULE = "bench.diagnosis.diagnosis"


def looked_closer(
    monkeypatch: pytest.MonkeyPatch,
    *,
    far_off: bool,
    promises: bool,
    then: float = 1.0,
    more_than_chance: bool = True,
) -> tuple[str, str, list[float]]:
    """Return the fit and the scores that are gone on with, and the efforts asked for; the first fit leaves 1.05."""
    asked: list[float] = []

    def finish(*_: Any, effort: float) -> Any:
        asked.append(effort)
        return SimpleNamespace(error=then, name="again")

    monkeypatch.setattr(sharpening, "finish", finish)
    monkeypatch.setattr(sharpening, "from_here", lambda *_: None)
    monkeypatch.setattr(f"{MODULE}.is_far_off", lambda *_: far_off)
    monkeypatch.setattr(f"{MODULE}.deviance_per_dof", lambda _, one: one.error)
    monkeypatch.setattr(f"{MODULE}.leaves_more_than_chance", lambda *_: more_than_chance)
    made: Any = object.__new__(Diagnosis)
    made._session = SimpleNamespace(problem=None)
    made._shortlist = SimpleNamespace(promises=lambda *_: promises)
    made._seed = 1
    made._say = lambda _: None
    made._probed = lambda one, _, more: f"of {one.name}, other seed {more != 0}"
    first: Any = SimpleNamespace(error=1.05, name="first")
    fit, scores = made._looked_closer(first, "at first", 0)
    return fit.name, scores, asked


def test_what_promises_by_chance_of_the_simulation_does_so_once(monkeypatch: pytest.MonkeyPatch) -> None:
    name, scores, asked = looked_closer(monkeypatch, far_off=False, promises=True)
    assert (name, scores, asked) == ("again", "of again, other seed True", [4.0])


@pytest.mark.parametrize(("far_off", "promises"), [(True, True), (False, False)])
def test_nothing_else_is_looked_at_again(monkeypatch: pytest.MonkeyPatch, far_off: bool, promises: bool) -> None:
    assert looked_closer(monkeypatch, far_off=far_off, promises=promises) == ("first", "at first", [])


@pytest.mark.parametrize(("more_than_chance", "kept"), [(True, "first"), (False, "again")])
def test_a_fit_that_leaves_more_is_kept_if_that_is_chance(
    monkeypatch: pytest.MonkeyPatch, more_than_chance: bool, kept: str
) -> None:
    name, scores, _ = looked_closer(
        monkeypatch, far_off=False, promises=True, then=1.2, more_than_chance=more_than_chance
    )  # fmt: skip
    assert (name, scores) == (kept, f"of {kept}, other seed True")
