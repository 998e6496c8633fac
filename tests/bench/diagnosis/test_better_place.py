"""What an effect that is not needed has found out about the place of a fit; with made-up fits."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from bench.diagnosis import diagnosis
from bench.diagnosis.diagnosis import Diagnosis
from bench.diagnosis.searching import better_place as module
from bench.diagnosis.searching.better_place import better_place

#: Independent residuals.
N = 500
PROBLEM: Any = SimpleNamespace()


@pytest.fixture(autouse=True)
def by_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    """A fit is its deviance; an effect is needed where its name says so, and without it a fit leaves 3 more."""
    monkeypatch.setattr(module, "deviance", lambda _, fit: fit)
    monkeypatch.setattr(module, "deviance_per_dof", lambda _, fit: fit / N)
    monkeypatch.setattr(module, "deviance_beside", lambda _, fit, __: fit)
    monkeypatch.setattr(module, "needless", lambda _, __, ___, effect: effect != "needed")
    monkeypatch.setattr(module, "without", lambda _, fit, *__: fit + 3.0)


def state(here: float, **refitted: float) -> Any:
    found = {
        name: SimpleNamespace(effect=name, fit=left, deviance=left, phases=None) for name, left in refitted.items()
    }
    return SimpleNamespace(fit=here, refitted=found)


@pytest.mark.parametrize(
    ("here", "refitted", "expected"),
    [
        (580.0, {"reset_noise": 510.0, "leak": 530.0}, 513.0),
        (580.0, {"needed": 500.0, "leak": 530.0}, 533.0),
        (580.0, {"needed": 500.0}, None),
        (580.0, {"leak": 572.0}, None),  # within what chance may do
        (580.0, {"leak": 567.0}, None),  # and so it is without it
        (540.0, {"leak": 500.0}, None),  # no more is left than by a fit at its minimum
        (580.0, {}, None),
    ],
)
def test_the_best_place_is_gone_on_from_without_the_effect(
    here: float, refitted: dict[str, float], expected: float | None
) -> None:
    found: Any = better_place(PROBLEM, state(here, **refitted), 1)
    assert found == expected


def test_with_other_phases_of_a_ripple_it_is_no_place_of_the_same_model() -> None:
    made = state(580.0, leak=510.0)
    made.refitted["leak"].phases = (0.5,)
    assert better_place(PROBLEM, made, 1) is None


def test_a_diagnosis_looks_again_at_what_is_missing_from_there(monkeypatch: pytest.MonkeyPatch) -> None:
    """At the better place of its second step an effect stands out that did not before."""
    made: Any = object.__new__(Diagnosis)
    made._say, made._seed = lambda _: None, 1
    made._session = SimpleNamespace(problem=PROBLEM)
    proposals: dict[float, str | None] = {9.0: "leak", 1.2: None, 1.1: "reset_noise", 1.0: None}
    left = {"leak": 1.2, "reset_noise": 1.0}

    def look(fit: float, added: str | None, before: Any, in_phase: bool = False) -> Any:
        number = len(before)
        seen.append((fit, added, number))
        return SimpleNamespace(
            fit=fit, added=added, chosen=True, proposal=proposals[fit], problem=PROBLEM,
            group=(added, "light_drift") if number == 1 and fit == 1.2 else (),
        )  # fmt: skip

    seen: list[Any] = []
    made._states = [look(9.0, None, [])]
    made._look = look
    made._drop = lambda: None
    made.add = lambda name: made._states.append(look(left[name], name, made._states))
    monkeypatch.setattr(diagnosis, "better_place", lambda _, last, __: 1.1 if last.fit == 1.2 else None)
    made._go_on(3)
    assert [(s.fit, s.added) for s in made._states] == [(9.0, None), (1.1, "leak"), (1.0, "reset_noise")]
    assert made._states[1].group == ("leak", "light_drift")  # as it was before
    assert seen[2] == (1.1, "leak", 1)


def test_a_fall_is_that_of_the_fit_once_it_was_made_better(monkeypatch: pytest.MonkeyPatch) -> None:
    """A fit that leaves 3 of 9 is made sharper, and leaves 1.8."""
    made: Any = object.__new__(Diagnosis)
    made._say, made._seed = lambda _: None, 1
    made._session = SimpleNamespace(
        problem=PROBLEM, in_time=lambda fit, _: fit, in_phase=lambda fit, _: fit, sharpened=lambda fit, _: 0.6 * fit
    )
    made._probed = lambda *_: SimpleNamespace(drop=())
    monkeypatch.setattr(diagnosis, "asks_for_more", lambda *_: False)
    monkeypatch.setattr(diagnosis, "settled", lambda _, fit, __: fit)
    monkeypatch.setattr(diagnosis, "with_a_detail", lambda _, fit, *__: fit)
    monkeypatch.setattr(diagnosis, "leaves_little", lambda *_: False)
    monkeypatch.setattr(diagnosis, "is_far_off", lambda *_: True)
    monkeypatch.setattr(diagnosis, "deviance_beside", lambda _, fit, __: fit)
    monkeypatch.setattr(diagnosis, "share", lambda _, before, after: (before - after) / (before - 1.0))
    before: Any = SimpleNamespace(fit=9.0, problem=PROBLEM)
    found = made._look(3.0, "leak", [before])
    assert (found.fit, found.fall) == (pytest.approx(1.8), pytest.approx(7.2 / 8.0))
    assert made._look(9.0, None, []).fall == 0.0
