"""What is tied is told apart by a protocol of ours, where one is known."""

from __future__ import annotations

import pytest

from bench.diagnosis.next_measurement import next_measurement
from protocols import load_protocol
from sim_backend.pixel.effects.registry import effects


@pytest.mark.parametrize(
    ("ties", "protocol"),
    [
        ({"dark_current": ("stray_light",)}, "on_family"),
        ({"dark_current": ("photoreceptor_bandwidth",)}, "pulse_width"),
        ({"leak": ("hot_pixels",)}, "background_activity"),
    ],
)
def test_a_tied_group_has_its_protocol(ties: dict[str, tuple[str, ...]], protocol: str) -> None:
    found = next_measurement(ties)
    assert found is not None
    assert found["protocol"] == protocol
    assert found["separates"] == [next(iter(ties)), *next(iter(ties.values()))]
    assert found["minutes"] == pytest.approx(load_protocol(protocol).protocol.estimate().duration_s / 60.0, abs=0.05)
    assert set(found["separates"]) <= set(effects())


def test_nothing_is_proposed_where_nothing_is_known() -> None:
    assert next_measurement({}) is None
    assert next_measurement({"crosstalk": ("dark_current",)}) is None
