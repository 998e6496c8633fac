"""What sets in beyond some size is found by looking at several sizes."""

from __future__ import annotations

from types import MappingProxyType, SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bench.diagnosis.fitting import robust
from bench.diagnosis.searching.seen import best_seen
from sim_backend.pixel import PixelModel
from sim_backend.pixel.effects.registry import effects

if TYPE_CHECKING:
    from collections.abc import Sequence

N = 50
LEAK, DRIFT = effects()["leak"], effects()["light_drift"]


class Bench:
    """A made-up bench on which a leak of 0.1 ln/s and more, or a falling light, moves all statistics by 30."""

    measured = SimpleNamespace(value=np.full(N, 30.0), points=(slice(0, N),))
    given: Any = MappingProxyType({})
    forward = SimpleNamespace(late_us=0)

    def of_points(self, models: Sequence[PixelModel]) -> list[PixelModel]:
        return list(models)

    def glance(self, models: Sequence[Sequence[PixelModel]], seed: int, effort: float) -> list[PixelModel]:
        return [one[0] for one in models]

    def expect(self, model: PixelModel) -> Any:
        leak, drift = model.effect("leak"), model.effect("light_drift")
        there = (leak is not None and leak.rate_per_s >= 0.1) or (drift is not None and drift.rate_per_s < -0.05)  # type: ignore[attr-defined]
        value = np.full(N, 30.0 if there else 0.0)
        return SimpleNamespace(value=value, value_or=lambda _: value, roots=(np.eye(N),))


def test_the_size_that_explains_most_is_found_for_either_sign() -> None:
    fit: Any = SimpleNamespace(
        model=PixelModel(), slots=(), x=np.zeros(0), models=lambda _: [PixelModel()], caution=1.0
    )
    bench: Any = Bench()
    leak, drift = best_seen(bench, fit, [LEAK, DRIFT], seed=1)
    assert leak.factor * 0.05 >= 0.1
    assert drift.factor < 0.0
    assert leak.fall == drift.fall == pytest.approx(robust.loss(np.full(N, 30.0)))


def test_what_explains_nothing_has_no_fall() -> None:
    fit: Any = SimpleNamespace(
        model=PixelModel(), slots=(), x=np.zeros(0), models=lambda _: [PixelModel()], caution=1.0
    )
    bench: Any = Bench()
    assert best_seen(bench, fit, [effects()["crosstalk"]], seed=1)[0].fall == 0.0
