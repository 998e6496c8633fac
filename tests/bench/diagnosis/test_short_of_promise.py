"""A refit that does not keep what was promised of it is made sharper, where little was simulated."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest

from bench.diagnosis.searching import refit

if TYPE_CHECKING:
    from collections.abc import Callable

BEFORE = SimpleNamespace(loss=750.0)


@pytest.fixture
def kept(monkeypatch: pytest.MonkeyPatch) -> Callable[..., tuple[Any, bool]]:
    """Return a function that gives the fit that is kept, and whether a sharper one was made."""
    monkeypatch.setattr(refit, "loss_left", lambda _, one: one.loss)
    monkeypatch.setattr(refit, "deviance_beside", lambda _, one, __: 2.0 * one.loss + getattr(one, "rare", 0.0))

    def keep(
        loss: float, promised: float, *, sharper: float = 690.0, costly: bool = True, rare: float = 0.0
    ) -> tuple[Any, bool]:
        made: list[Any] = []

        def sharpened(*_: Any) -> Any:
            made.append(SimpleNamespace(loss=sharper))
            return made[-1]

        monkeypatch.setattr(refit, "is_costly", lambda *_: costly)
        monkeypatch.setattr(refit, "sharpened", sharpened)
        found: Any = SimpleNamespace(loss=loss, rare=rare)
        problem: Any = None
        before: Any = BEFORE
        best: Any = refit._kept(problem, before, found, promised, 1)
        return best.loss, bool(made)

    return keep


@pytest.mark.parametrize("loss", [755.0, 955.0, 725.0])
def test_what_falls_short_is_made_sharper(kept: Callable[..., tuple[Any, bool]], loss: float) -> None:
    assert kept(loss, 60.0) == (690.0, True)


def test_so_is_what_a_few_rare_statistics_make_worse(kept: Callable[..., tuple[Any, bool]]) -> None:
    assert kept(715.0, 60.0, rare=120.0) == (690.0, True)
    assert kept(715.0, 60.0, rare=20.0) == (715.0, False)


def test_what_is_no_better_then_stays(kept: Callable[..., tuple[Any, bool]]) -> None:
    assert kept(755.0, 60.0, sharper=770.0) == (755.0, True)


@pytest.mark.parametrize(
    ("loss", "promised", "costly"),
    [
        (715.0, 60.0, True),  # it keeps its promise
        (755.0, 10.0, True),  # chance promises as much
        (755.0, 60.0, False),  # as much was simulated as can be
        (1600.0, 60.0, True),  # it is somewhere else
    ],
)
def test_others_are_left(
    kept: Callable[..., tuple[Any, bool]], loss: float, promised: float, costly: bool
) -> None:  # fmt: skip
    assert kept(loss, promised, costly=costly) == (loss, False)
