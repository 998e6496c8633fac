"""A refit that does not keep what was promised of it is made sharper, where little was simulated."""

from __future__ import annotations

from dataclasses import dataclass
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


@pytest.mark.parametrize(
    ("deviance", "promised", "kept", "efforts"),
    [
        (749.0, 40.0, 712.0, [4.0]),  # hardly anything of the promise came
        (749.0, 9.0, 749.0, []),  # the promise is that of chance
        (725.0, 40.0, 725.0, []),  # most of it came
        (700.0, 200.0, 700.0, [4.0]),  # more effort is no better
    ],
)
def test_near_a_true_model_it_is_fitted_on_with_more_effort(
    monkeypatch: pytest.MonkeyPatch, deviance: float, promised: float, kept: float, efforts: list[float]
) -> None:
    asked: list[float] = []

    def finish(*_: Any, effort: float) -> Any:
        asked.append(effort)
        return SimpleNamespace(loss=712.0)

    monkeypatch.setattr(refit, "deviance_beside", lambda _, one, __: one.loss)
    monkeypatch.setattr(refit, "from_here", lambda *_: None)
    monkeypatch.setattr(refit, "finish", finish)
    problem: Any = None
    here: Any = BEFORE
    first: Any = SimpleNamespace(loss=deviance)
    fits = refit._Fits(problem, here, ["leak"], [promised], 1)
    fits.found[0] = refit.Found("leak", first, deviance)
    fits.look_closer()
    assert fits.found[0].deviance == kept
    assert asked == efforts


@dataclass(frozen=True)
class Scaled:
    """A fit that knows its own scale roughly."""

    scale: float
    pixels: float = 1.0


@pytest.mark.parametrize(("pixels", "scale"), [(1.0, 0.8), (0.5, 0.9)])
def test_near_a_true_model_fits_of_as_many_pixels_are_judged_on_one_scale(
    monkeypatch: pytest.MonkeyPatch, pixels: float, scale: float
) -> None:
    monkeypatch.setattr(refit, "deviance_beside", lambda _, one, __: 600.0 / one.scale)
    monkeypatch.setattr(refit, "_as_many_pixels", lambda _, one, other: one.pixels == other.pixels)
    problem: Any = None
    here: Any = Scaled(0.8)
    found: Any = Scaled(0.9, pixels)
    fits = refit._Fits(problem, here, ["leak"], [40.0], 1)
    fits.found[0] = refit.Found("leak", found, 600.0 / 0.9)
    fits.on_one_scale()
    assert fits.found[0].fit.scale == scale
    assert fits.found[0].deviance == pytest.approx(600.0 / scale)
