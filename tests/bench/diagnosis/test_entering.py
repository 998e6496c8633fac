"""A queue that loses events enters a race as a short one, and one that only holds them up as it is."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bench.diagnosis.expected.catalogue import free_of
from bench.diagnosis.expected.problem import Slot
from bench.diagnosis.fitting.approach import Approach
from bench.diagnosis.fitting.cloud import Cloud
from bench.diagnosis.searching.entering import with_what_sets_in
from bench.diagnosis.session import open_session
from sim_backend.pixel import PixelModel
from sim_backend.pixel.effects import Leak, ReadoutSaturation

if TYPE_CHECKING:
    from collections.abc import Callable

    from bench.diagnosis.fitting.fitted import Fit
    from sim_backend.pixel.effects.base import Effect

ROUGHLY = PixelModel(theta_on=0.3, theta_off=0.25, noise_rms=0.04, corner_hz=150.0, refractory_s=8e-3)
CONTRASTS = (0.0, 0.25, 0.35, 0.5, 0.8, 1.2)


def entering(found: Fit, effect: Effect) -> Approach:
    """Return a fitted model with an effect more, where nothing is known of it."""
    free = free_of(type(effect))
    slots = (*found.slots, *map(Slot, free))
    at = np.array([*found.x, *(f.coordinate(f.probe) for f in free)])
    return Approach(found.model + effect, slots, at, at, np.inf, 1, np.zeros((at.size, at.size)), 0.2, Cloud())


def lasting(point: Callable[..., Any]) -> list[Any]:
    return [point(i, contrast, lux=100.0, periods=10) for i, contrast in enumerate(CONTRASTS)]


@pytest.mark.parametrize(("fifo_events", "loses"), [(16.0, True), (4096.0, False)])
def test_a_queue_is_short_where_events_are_lost(
    point: Callable[..., Any], run_of: Callable[..., Any], fifo_events: float, loses: bool
) -> None:
    truth = ROUGHLY + ReadoutSaturation(max_rate_eps=20_000.0, fifo_events=fifo_events)
    with open_session([run_of(lasting(point), truth, 3)], ROUGHLY) as session:
        one = entering(session.fit(1), ReadoutSaturation(max_rate_eps=1e5))
        wider = with_what_sets_in(session.problem, one)
    assert (wider is not one) == loses
    if loses:
        assert wider.slots[-1].free.key == "readout_saturation.fifo_events"
        assert wider.model.effect("readout_saturation") is not None
        assert wider.slots[-1].free.value(float(wider.at[-1])) == 16.0
        assert not wider.cloud.places


def test_numbers_that_end_somewhere_are_left_for_later(
    point: Callable[..., Any], run_of: Callable[..., Any]
) -> None:  # fmt: skip
    with open_session([run_of(lasting(point), ROUGHLY, 3)], ROUGHLY) as session:
        one = entering(session.fit(1), Leak(0.05))
        assert with_what_sets_in(session.problem, one) is one
