"""The least size of an effect that would have been seen; how well a probe is seen is written down by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bench.diagnosis.expected.catalogue import switches
from bench.diagnosis.searching import candidate_table
from sim_backend.pixel.effects.registry import effects


def smallest(effect_id: str, at: float, seen: float, pixels: int) -> float | None:
    """Return it where a probe of that coordinate is seen by so many standard errors."""
    effect = effects()[effect_id]
    probe: Any = SimpleNamespace(effect=effect, free=switches(effect), at=(at,))
    scores: Any = SimpleNamespace(probes=[probe], seen=np.array([seen]))
    return candidate_table._smallest(scores, 0, pixels)


def test_it_is_seen_by_4_5_standard_errors() -> None:
    assert smallest("leak", 0.1, 45.0, 64) == pytest.approx(0.01)
    assert smallest("leak", 0.1, 0.0, 64) is None


def test_one_of_the_pixels_is_hot_at_the_least() -> None:
    assert smallest("hot_pixels", 0.01, 100.0, 64) == pytest.approx(1.0 / 64.0)  # not 0.00045: that is no pixel
    assert smallest("hot_pixels", 0.01, 1.5, 64) == pytest.approx(0.03)
    assert smallest("hot_pixels", 0.01, 100.0, 10000) == pytest.approx(0.00045)
