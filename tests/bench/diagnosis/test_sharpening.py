"""A fit of what takes long to simulate is done again with more pixels, where more is left than is to be."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest

from bench.diagnosis import session
from bench.diagnosis.fitting import sharpening
from bench.diagnosis.fitting.sharpening import asks_for_more
from bench.diagnosis.session import Session
from sim_backend.pixel import PixelModel

if TYPE_CHECKING:
    from collections.abc import Sequence


class MadeUp(Session):
    """Fits are their errors."""

    def __init__(self) -> None:
        self.problem: Any = SimpleNamespace(cost=lambda _: 5.0, given={})


@pytest.fixture
def errors(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Return what each fit in turn leaves, which a test fills in."""
    left: list[float] = []
    monkeypatch.setattr(session, "deviance_per_dof", lambda _, fit: fit.error)
    monkeypatch.setattr(sharpening, "deviance_per_dof", lambda _, fit: fit.error)
    monkeypatch.setattr(sharpening, "leaves_more_than_chance", lambda _, fit: fit.error >= 1.3)
    monkeypatch.setattr(session, "sharpened", lambda *_: fit_of(left.pop(0)))
    return left


def fit_of(error: float) -> Any:
    return SimpleNamespace(error=error, model=PixelModel(), models=lambda _: [])


@pytest.mark.parametrize(
    ("start", "then", "best", "unused"),
    [
        (1.4, [1.3, 1.2, 1.05, 0.9], 1.05, 1),  # within a tenth of a true model's is enough, within chance is not
        (1.4, [1.45, 1.2, 1.195, 1.19, 1.0], 1.19, 1),  # once hardly better may be chance, twice is the end
        (1.4, [1.39, 1.5, 1.0], 1.39, 1),
        (1.9, [1.8, 1.7, 1.6, 1.5, 1.4, 1.0], 1.4, 1),  # so often at the most
        (2.5, [1.0], 2.5, 1),  # something else is missing
        (1.05, [0.9], 1.05, 1),
    ],
)
def test_a_fit_is_made_sharper_while_that_helps(
    errors: list[float], start: float, then: Sequence[float], best: float, unused: int
) -> None:
    errors.extend(then)
    found: Any = MadeUp().sharpened(fit_of(start), 1)
    assert found.error == best
    assert len(errors) == unused


def test_what_was_simulated_as_a_base_pixel_is_asks_for_no_more(errors: list[float]) -> None:
    cheap: Any = SimpleNamespace(cost=lambda _: 1.0)
    assert not asks_for_more(cheap, fit_of(1.4))
    assert asks_for_more(MadeUp().problem, fit_of(1.4))


def test_what_is_more_than_chance_asks_for_more_however_small(
    errors: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """In large runs a tenth is more than chance leaves."""
    assert not asks_for_more(MadeUp().problem, fit_of(1.05))
    monkeypatch.setattr(sharpening, "leaves_more_than_chance", lambda *_: True)
    assert asks_for_more(MadeUp().problem, fit_of(1.05))
