"""Times that how a simulation cuts time could make are no sign of an effect."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bench.diagnosis.expected.catalogue import free_of
from bench.diagnosis.searching.state import can_judge
from sim_backend.pixel.effects.comparator_delay import ComparatorDelay
from sim_backend.pixel.effects.leak import Leak
from sim_backend.pixel.effects.light_rise_time import LightRiseTime
from sim_backend.pixel.effects.timestamp_jitter import TimestampJitter

PROBLEM: Any = SimpleNamespace(forward=SimpleNamespace(dt_s=1e-5))


@pytest.mark.parametrize(("effect", "size", "told"), [
    (ComparatorDelay, 1.5e-5, False),
    (ComparatorDelay, 2.5e-5, True),
    (TimestampJitter, 0.8e-5, False),
    (TimestampJitter, 1.5e-5, True),
    (LightRiseTime, 0.4e-5, False),
    (LightRiseTime, 0.8e-5, True),  # brighter is not delayed as darker is
    (Leak, 1e-7, True),  # no matter of time
])  # fmt: skip
def test_what_is_no_finer_than_the_comparators_look_is_told(effect: Any, size: float, told: bool) -> None:
    free = free_of(effect)
    sizes = np.array([[f.coordinate(size) for f in free]])
    scores: Any = SimpleNamespace(probes=[SimpleNamespace(free=free, at=sizes[0])], size=sizes)
    assert can_judge(PROBLEM, scores, 0) == told


def test_a_line_to_a_probe_lets_expect_too_little_of_what_acts_by_its_square() -> None:
    free = free_of(TimestampJitter)
    scores: Any = SimpleNamespace(probes=[SimpleNamespace(free=free, at=np.array([1e-4]))], size=np.array([[4e-6]]))
    assert can_judge(PROBLEM, scores, 0)  # 20 us
    scores.size /= 25.0  # 4 us
    assert not can_judge(PROBLEM, scores, 0)
