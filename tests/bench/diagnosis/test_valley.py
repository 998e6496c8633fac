"""What other effects stood in for is found again: losses and errors are written down by hand."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bench.diagnosis.expected.parameters import Free
from bench.diagnosis.expected.problem import Slot
from bench.diagnosis.fitting.approach import Approach
from bench.diagnosis.fitting.cloud import Cloud
from bench.diagnosis.searching import refit, valley
from sim_backend.pixel import PixelModel
from sim_backend.pixel.effects import ResetNoise

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

PROBE, TRUE_SIZE, START = 0.04, 0.08, 0.085


def stood_in(size: float) -> float:
    """Return the base number at the bottom of the valley: the larger the effect, the less stands in for it."""
    return START - 3.0 * size**2


def loss(base: float, size: float) -> float:
    """Return the loss about a bent valley that falls towards the true size."""
    return float(800.0 + 4e5 * (size - TRUE_SIZE) ** 2 + 1e8 * (base - stood_in(size)) ** 2)


@pytest.fixture
def way(monkeypatch: pytest.MonkeyPatch) -> Approach:
    """Return a way that has ended where the effect is not yet."""
    slots = (
        Slot(Free("base", "base", "base", "1", "linear", -1.0, 1.0, 0.1, effect=False)),
        Slot(Free("reset_noise", "rms", "rms", "ln", "linear", 0.0, 0.2, PROBE)),
    )

    def of(seen: Approach, at: Any) -> Approach:
        return replace(seen, at=at, loss=loss(*at))

    def approach(_: Any, model: PixelModel, free: Sequence[Slot], at: Any, **__: Any) -> Any:
        own = model.effect("reset_noise")
        assert isinstance(own, ResetNoise)
        if len(free) == 1:  # the size is held, and the other number goes to the bottom
            return SimpleNamespace(at=np.array([stood_in(own.rms)]))
        return of(began, np.array([stood_in(TRUE_SIZE), TRUE_SIZE]))

    began = Approach(
        PixelModel() + ResetNoise(rms=1e-3), slots, np.array([stood_in(1e-3), 1e-3]), np.array([START, 1e-3]),
        loss(stood_in(1e-3), 1e-3), 1, np.zeros((2, 2)), 0.2, Cloud(),
    )  # fmt: skip
    monkeypatch.setattr(valley, "approach", approach)
    monkeypatch.setattr(valley, "scanned", lambda _, seen, places: of(seen, min(places, key=lambda at: loss(*at))))
    return began


def test_other_numbers_follow_the_size_to_where_the_run_is_nearest(way: Approach) -> None:
    assert loss(stood_in(1e-3), TRUE_SIZE) > 10.0 * way.loss  # no other size alone is any better
    found = valley.through_the_valley(None, way)  # type: ignore[arg-type]
    assert found is not None
    assert found.loss == pytest.approx(800.0)
    assert found.at == pytest.approx([stood_in(TRUE_SIZE), TRUE_SIZE])


def test_what_ended_well_is_left(way: Approach) -> None:
    there = replace(way, loss=850.0)
    assert valley.through_the_valley(None, there) is None  # type: ignore[arg-type]


@pytest.fixture
def go_on(monkeypatch: pytest.MonkeyPatch) -> Callable[..., tuple[float, int]]:
    """Return a function that gives the error that a fit ends with, and how often it went on, from errors in turn."""
    monkeypatch.setattr(refit, "is_far_off", lambda _, one: one.error > 1.3)
    monkeypatch.setattr(refit, "deviance_beside", lambda _, one, __: 800.0 * one.error)
    monkeypatch.setattr(refit, "from_here", lambda *_: None)
    monkeypatch.setattr(refit, "_knows_its_numbers", lambda _, one: one.known)

    def ended(errors: Sequence[float], known: bool = True) -> tuple[float, int]:
        first, *then = [SimpleNamespace(error=error, known=known or i > 0) for i, error in enumerate(errors)]
        monkeypatch.setattr(refit, "finish", lambda *_: then.pop(0))
        found: Any = refit.Found("reset_noise", first, 800.0 * first.error)  # type: ignore[arg-type]
        best: Any = refit._gone_on(None, None, found, 1).fit  # type: ignore[arg-type]
        return best.error, len(errors) - 1 - len(then)

    return ended


@pytest.mark.parametrize(
    ("errors", "best", "often"),
    [
        ([1.2, 1.0], 1.2, 0),  # it is not off
        ([5.0, 2.4, 1.5, 1.1, 0.9], 1.1, 3),
        ([5.0, 4.5, 1.0], 4.5, 1),  # that is no way to anywhere
        ([5.0, 6.0, 1.0], 5.0, 1),
        ([9.0, 7.0, 5.0, 3.5, 2.5, 1.0], 2.5, 4),  # so often at the most
    ],
)
def test_a_fit_goes_on_while_its_error_falls(
    go_on: Callable[..., tuple[float, int]], errors: Sequence[float], best: float, often: int
) -> None:
    assert go_on(errors) == (best, often)


@pytest.mark.parametrize(("then", "best"), [(1.0, 1.0), (1.2, 1.2), (1.6, 1.1)])
def test_what_its_numbers_change_is_looked_at_where_a_fit_has_ended(
    go_on: Callable[..., tuple[float, int]], then: float, best: float
) -> None:
    """A fit that has gone far does not know; another one is as good, but for chance, or it is elsewhere."""
    assert go_on([1.1, then], known=False) == (best, 1)
