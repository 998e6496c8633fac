"""Candidates are fitted one after the other; losses and errors are written down by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest

from bench.diagnosis.searching import refit

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

#: Residuals, and what they leave before anything is added.
N, BEFORE = 800, 100.0


@pytest.fixture
def fits(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Any]:
    """Return a function that gives candidates; a way is the error that a fit ends with, or a place with one."""
    monkeypatch.setattr(refit, "loss_of_fit", lambda _, one: N * one.error)
    monkeypatch.setattr(refit, "deviance_beside", lambda _, one, __: N * one.error)
    monkeypatch.setattr(refit, "deviance_per_dof", lambda _, one: one.error)
    monkeypatch.setattr(refit, "share", lambda _, before, left: (before.error - left / N) / (before.error - 1.0))
    monkeypatch.setattr(refit, "finish", lambda _, way, beat: SimpleNamespace(error=way.loss, beat=beat, model=None))
    monkeypatch.setattr(refit, "_kept", lambda _, __, reached, *___: reached)

    def of(names: Sequence[str]) -> Any:
        here: Any = SimpleNamespace(error=BEFORE)
        problem: Any = None
        return refit._Fits(problem, here, names, [0.0] * len(names), 1)

    return of


def ending(error: float) -> Any:
    return SimpleNamespace(loss=error)


def test_each_has_the_best_before_it_to_beat(fits: Callable[..., Any]) -> None:
    made = fits(["leak", "light_drift", "crosstalk"])
    for k, error in enumerate((30.0, 20.0, 70.0)):
        made.add(k, ending(error))
    assert [one.fit.beat for one in made.found.values()] == [pytest.approx(float("inf")), 30.0 * N, 20.0 * N]


def test_the_better_of_two_fits_of_one_effect_is_kept(fits: Callable[..., Any]) -> None:
    made = fits(["leak"])
    for error in (30.0, 40.0, 25.0):
        made.add(0, ending(error))
    assert made.found[0].fit.error == 25.0


@pytest.mark.parametrize(
    ("errors", "tried"),
    [
        ((30.0, 40.0), 2),
        ((30.0, 1.5), 0),  # it explains the run
        ((18.0, 40.0), 0),  # it takes away nearly all, and something else is missing, too
    ],
)
def test_valleys_are_gone_through_where_nothing_leads_anywhere(
    fits: Callable[..., Any], monkeypatch: pytest.MonkeyPatch, errors: Sequence[float], tried: int
) -> None:
    made, ways = fits(["leak", "crosstalk"]), {}
    for k, error in enumerate(errors):
        ways[k] = ending(error)
        made.add(k, ways[k])
    asked: list[Any] = []
    monkeypatch.setattr(refit, "through_the_valley", lambda _, way: asked.append(way))
    made.through_valleys(ways)
    assert len(asked) == tried


def test_the_rest_is_left_once_one_valley_leads_to_the_run(
    fits: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    made, ways = fits(["leak", "reset_noise"]), {0: ending(40.0), 1: ending(30.0)}
    for k, way in ways.items():
        made.add(k, way)
    monkeypatch.setattr(refit, "through_the_valley", lambda _, way: ending(0.9) if way is ways[1] else None)
    made.through_valleys(ways)
    assert {one.effect: one.fit.error for one in made.found.values()} == {"leak": 40.0, "reset_noise": 0.9}


@pytest.mark.parametrize(
    ("turned", "ends", "asked"),
    [
        ((50.0, 60.0, 8.0, 5.0), (50.0, 60.0, 8.0, 65.0), 3),  # of the best three, the last of them leads somewhere
        ((50.0, 8.0, 5.0, 5.0), (50.0, 8.0, 63.0, 65.0), 2),
        ((60.0, 61.0, 63.0, 5.0), (60.0, 61.0, 63.0, 65.0), 3),  # no phases are better
    ],
)
def test_the_phases_of_a_ripple_follow_the_best_until_one_leads_somewhere(
    fits: Callable[..., Any], monkeypatch: pytest.MonkeyPatch, turned: Sequence[float], ends: Sequence[float],
    asked: int,
) -> None:  # fmt: skip
    """Phases that went with a model which lacks the effect are no fault of the effect."""
    made, followed = fits(["leak", "light_drift", "refractory_mismatch", "crosstalk"]), []
    before = (60.0, 61.0, 63.0, 65.0)
    for k, error in enumerate(before):
        made.add(k, ending(error))

    def in_phase(problem: Any, one: Any, _: int) -> Any:
        followed.append(one.error)
        error = turned[before.index(one.error)]
        return SimpleNamespace(phases=(error,)), one if error == one.error else SimpleNamespace(error=error)

    monkeypatch.setattr(refit, "in_phase", in_phase)
    monkeypatch.setattr(refit, "has_open_ripple", lambda *_: True)
    made.follow_phases()
    assert tuple(one.fit.error for one in made.found.values()) == ends
    assert followed == list(before[:asked])
    phases = [None if end == known else (end,) for end, known in zip(ends, before, strict=True)]
    assert [one.phases for one in made.found.values()] == phases
