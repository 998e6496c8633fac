"""The step of a simulation is found in its time stamps, and none is found in those of a camera."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from bench.diagnosis.recorded.time_grid import time_grid_us

RNG = np.random.default_rng(3)


def stamped(*times_us: float) -> Any:
    """Return a point whose events have these times, to whole microseconds."""
    events = np.zeros(len(times_us), dtype=[("t", np.int64)])
    events["t"] = np.round(np.sort(times_us))
    return SimpleNamespace(events=lambda: iter([events]))


def at_multiples(step_us: float, jitter_us: float = 0.0) -> list[Any]:
    """Return points with 2000 events in 2 s, each at a multiple of a step, give or take."""
    looks = RNG.integers(0, int(2e6 / step_us), (3, 2000))
    return [stamped(*(row * step_us + jitter_us * RNG.standard_normal(2000))) for row in looks]


@pytest.mark.parametrize("step_us", [4.0, 6.7, 10.0, 13.7, 20.0, 33.3333, 100.0])
def test_a_step_is_found_that_need_be_no_whole_number(step_us: float) -> None:
    assert time_grid_us(at_multiples(step_us)) == pytest.approx(step_us, rel=1e-5)


def test_few_events_tell_a_step_of_whole_microseconds() -> None:
    assert time_grid_us([cast("Any", stamped(40, 100, 2040))]) == 20.0


def test_time_that_is_not_cut_shows_no_step() -> None:
    assert time_grid_us(at_multiples(1.0)) is None
    assert time_grid_us(at_multiples(13.7, jitter_us=20.0)) is None
    assert time_grid_us([stamped(41, 100)]) is None
    assert time_grid_us([stamped()]) is None


def test_events_that_wait_for_a_readout_do_not_hide_the_step() -> None:
    def served(service_us: float) -> list[Any]:
        """Return bursts of 30 events at once, and single ones, each stamped when it has been served."""
        looks = 20.0 * np.sort(RNG.integers(0, 100_000, 400))
        asked = np.sort(np.concatenate([looks, np.repeat(looks[::4], 30)]))
        free, stamps = 0.0, []
        for t in asked:
            free = max(free, t) + service_us
            stamps.append(free)
        return [stamped(*stamps)]

    assert time_grid_us(served(25.0)) == 20.0  # 5.0 divides all stamps
    assert time_grid_us(served(27.3)) == 20.0  # and nothing does


def test_pulses_alone_do_not_make_a_step_longer() -> None:
    pulses = 100_100.0 * np.arange(300)
    answers = np.concatenate([pulses, pulses + 20.0, pulses + 60.0])
    assert time_grid_us([stamped(*answers)]) == 20.0
