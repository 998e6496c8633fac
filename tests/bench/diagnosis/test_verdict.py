"""Which of the effects that were added are named where something is left that nothing explains."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bench.diagnosis.fitting.fitted import Fit
from bench.diagnosis.fitting.judging import share
from bench.diagnosis.searching.verdict import verdict_of
from sim_backend.pixel import PixelModel

N = 400


def fitted(residual: Any) -> Fit:
    return Fit(
        model=PixelModel(), slots=(), x=np.zeros(0), start=np.zeros(0), value=np.zeros(N), ratio=np.zeros(N),
        roots=(np.eye(N),), deviation=np.ones(N), jacobian=np.zeros((2, N, 0)), scale=1.0, residual=residual,
    )  # fmt: skip


def named(before: Any, after: Any) -> tuple[str, ...]:
    """Return what is named once an effect has led from some residuals to others."""

    problem: Any = SimpleNamespace(measured=SimpleNamespace(points=(slice(0, N),)))
    fits = [fitted(residual) for residual in (before, after)]
    fall = share(problem, fits[0], float(np.sum(after**2)))
    states: Any = [
        SimpleNamespace(fit=fit, added=added, fall=f, trends=())
        for fit, added, f in zip(fits, (None, "leak"), (0.0, fall), strict=True)
    ]
    verdict, missing = verdict_of(problem, states)
    assert verdict == "unexplained"
    return missing


@pytest.mark.parametrize(
    ("added", "stopped", "expected"),
    [
        ((), False, ("nothing_missing", ())),
        ((), True, ("unexplained", ())),  # something is significant, and was not looked at
        (("leak",), False, ("explained", ("leak",))),
        (("leak",), True, ("explained", ("leak",))),
    ],
)
def test_a_search_that_was_stopped_does_not_say_that_nothing_is_missing(
    added: tuple[str, ...], stopped: bool, expected: tuple[str, tuple[str, ...]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bench.diagnosis.searching.verdict.is_explained", lambda *_: True)
    monkeypatch.setattr("bench.diagnosis.searching.verdict.strengths", lambda *_: dict.fromkeys(added, 9.0))
    states: Any = [SimpleNamespace(added=name, fit=None) for name in (None, *added)]
    problem: Any = None
    assert verdict_of(problem, states, stopped) == expected


@pytest.mark.parametrize(
    ("missed", "named", "alone"),
    [
        ((), ("crosstalk",), ("nothing_missing", ())),
        (("leak",), ("crosstalk", "leak"), ("explained", ("leak",))),  # how large it is is not known: it is there
    ],
)
def test_what_is_within_chance_of_nothing_in_the_end_is_named_only_if_it_is_missed(
    missed: tuple[str, ...], named: tuple[str, ...], alone: tuple[str, tuple[str, ...]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    """A person added it, or a sharper fit has shown it."""

    def sigmas(_: Any, states: Any) -> dict[str, float]:
        return {s.added: 1.5 if s.added == "leak" else 2.5 for s in states[1:]}

    asked: list[str] = []

    def is_missed(_: Any, __: Any, name: str, ___: int) -> bool:
        asked.append(name)
        return name in missed

    monkeypatch.setattr("bench.diagnosis.searching.verdict.is_explained", lambda *_: True)
    monkeypatch.setattr("bench.diagnosis.searching.verdict.strengths", sigmas)
    monkeypatch.setattr("bench.diagnosis.searching.verdict.is_missed", is_missed)
    problem: Any = None
    states: Any = [SimpleNamespace(added=name, fit=None, missed={}) for name in (None, "crosstalk", "leak")]
    told: list[str] = []
    assert verdict_of(problem, states, say=told.append) == ("explained", named)
    assert verdict_of(problem, [states[0], states[2]], say=told.append) == alone
    assert asked == ["leak"]  # once; what stands out is not tried without
    assert told == ["fitting without leak"]


@pytest.fixture
def chance() -> Any:
    return np.random.default_rng(3).standard_normal(N)


def test_what_explains_nearly_all_is_named(chance: Any) -> None:
    assert named(chance + 30.0 * np.ones(N), chance + 3.0 * np.ones(N)) == ("leak",)


def test_what_leaves_much_is_not(chance: Any) -> None:
    assert named(chance + 30.0 * np.ones(N), chance + 18.0 * np.ones(N)) == ()


def test_what_lets_a_little_more_be_expected_of_a_few_statistics_is_not(chance: Any) -> None:
    """Where nothing was to be expected a few statistics make all of the deviance; they are as wrong as before."""
    few, rest = np.zeros(N), np.ones(N)
    few[:3], rest[:3] = 1.0, 0.0
    assert named(chance + 8.0 * rest + 300.0 * few, chance + 8.0 * rest + 100.0 * few) == ()
