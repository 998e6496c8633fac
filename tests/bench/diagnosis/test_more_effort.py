"""What comes near, or falls short near a true model, is fitted on with more effort; then fits have one scale."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest

from bench.diagnosis.fitting import sharpening
from bench.diagnosis.searching import refit

if TYPE_CHECKING:
    from collections.abc import Callable

    Ends = Callable[[float], list[float]]

NOTHING: Any = None
FREEDOM = 800.0


def fit_of(error: float) -> Any:
    return SimpleNamespace(error=error)


@pytest.fixture
def ends(monkeypatch: pytest.MonkeyPatch) -> Ends:
    """Return a function that says with which error a fit with more effort ends, and gives the efforts asked for."""

    def ends_with(error: float) -> list[float]:
        asked: list[float] = []

        def finish(*_: Any, effort: float) -> Any:
            asked.append(effort)
            return fit_of(error)

        monkeypatch.setattr(sharpening, "finish", finish)
        return asked

    monkeypatch.setattr(refit, "deviance_per_dof", lambda _, one: one.error)
    monkeypatch.setattr(refit, "deviance_beside", lambda _, one, __: FREEDOM * one.error)
    monkeypatch.setattr(sharpening, "from_here", lambda *_: None)
    return ends_with


@pytest.mark.parametrize(
    ("error", "then", "best", "efforts"),
    [
        (1.05, 0.9, 1.05, []),  # it explains the run
        (1.2, 1.0, 1.0, [4.0]),
        (1.2, 1.25, 1.2, [4.0]),  # chance had kept it from nothing
        (2.1, 1.0, 2.1, []),  # it is nowhere near
    ],
)
def test_what_nearly_explains_a_run_is_fitted_on_with_more_effort(
    ends: Ends, error: float, then: float, best: float, efforts: list[float]
) -> None:
    asked = ends(then)
    found = refit.Found("reset_noise", fit_of(error), FREEDOM * error)
    ended: Any = refit._with_more_effort(NOTHING, NOTHING, found, 1)
    assert (ended.fit.error, ended.deviance, asked) == (best, FREEDOM * best, efforts)


@pytest.mark.parametrize(
    ("deviance", "promised", "kept", "efforts"),
    [
        (749.0, 40.0, 712.0, [4.0]),  # hardly anything of the promise came
        (749.0, 9.0, 749.0, []),  # the promise is that of chance
        (725.0, 40.0, 725.0, []),  # most of it came
        (700.0, 200.0, 700.0, [4.0]),  # more effort is no better
    ],
)
def test_near_a_true_model_so_is_what_falls_short_of_its_promise(
    ends: Ends, deviance: float, promised: float, kept: float, efforts: list[float]
) -> None:
    asked = ends(712.0 / FREEDOM)
    fits = refit._Fits(NOTHING, fit_of(750.0 / FREEDOM), ["leak"], [promised], 1)
    fits.found[0] = refit.Found("leak", fit_of(deviance / FREEDOM), deviance)
    fits.look_closer()
    assert fits.found[0].deviance == pytest.approx(kept)
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
    here: Any = Scaled(0.8)
    found: Any = Scaled(0.9, pixels)
    fits = refit._Fits(NOTHING, here, ["leak"], [40.0], 1)
    fits.found[0] = refit.Found("leak", found, 600.0 / 0.9)
    fits.on_one_scale()
    assert fits.found[0].fit.scale == scale
    assert fits.found[0].deviance == pytest.approx(600.0 / scale)
