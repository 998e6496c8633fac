"""Time and size of a run: a table of protocols."""

from __future__ import annotations

from typing import Any

import pytest

from protocols import stimulus_of
from protocols.estimation import Estimate
from protocols.schema import Protocol

CONSTANT = {"kind": "constant", "duration_s": 10}
SQUARE = {"kind": "square", "frequency_hz": 5, "duty": 0.25}
PAIRS = {
    "kind": "reset_test",
    "polarity": "on",
    "gap_s": 0.1,
    "reset_s": 0.2,
    "test_s": 0.05,
    "reset_contrast": {"scale": "linear", "value": 1},
}
TWO = {"scale": "log", "values": [0.2, 0.3]}


def protocol(stimulus: dict[str, Any], sweep: dict[str, Any], **more: Any) -> Protocol:
    measurement = {"name": "m", "stimulus": stimulus, "sweep": sweep} | more
    return Protocol.model_validate(
        {
            "format": "evs-bench-protocol/1",
            "title": "t",
            "roi": {"x": 0, "y": 0, "width": 10, "height": 10},
            "settle": {"light_s": 1, "filter_s": 10, "bias_s": 100},
            "measurements": [measurement],
        }
    )


# measuring s, settling s, bytes, filter changes, points, operator's steps
TABLE = [
    # one recording of 10 s; the first point waits for everything; 100 pixels x 10 s x 0.1 Hz = 100 events
    (protocol(CONSTANT, {"illuminance_lux": 1}), (10, 111, 13 * 100 + 20_000, 0, 1, 0)),
    # the light settles at each of three levels
    (protocol(CONSTANT, {"illuminance_lux": [1, 2, 3]}), (30, 113, 3 * 21_300, 0, 3, 0)),
    # one move of the filter
    (
        protocol(CONSTANT, {"illuminance_lux": [1, 2], "nd_od": {"od": 3, "below_lux": 1.5}}),
        (20, 2 + 20 + 100, 2 * 21_300, 1, 2, 0),
    ),
    # three bandwidths are two changes of biases
    (
        protocol(CONSTANT, {"illuminance_lux": [1, 2], "bandwidth_hz": [10, 20, 30]}),
        (60, 6 + 10 + 300, 6 * 21_300, 0, 6, 0),
    ),
    # 100 periods of 0.2 s after a dark part of 0.15 s; 200 edges and 2.015 background events in each of 100 pixels
    (
        protocol(SQUARE, {"illuminance_lux": 1, "contrast": TWO}, pulses=100),
        (40.3, 112, 2 * (13 * 20_202 + 50 * 100 + 20_000), 0, 2, 0),
    ),
    # 20 periods of 0.45 s and a last gap; 80 edges and 0.91 background events in each pixel
    (
        protocol(PAIRS, {"illuminance_lux": 1, "contrast": TWO}, pulses=20, operator={"before": "look"}),
        (18.2, 112, 2 * (13 * 8_091 + 50 * 20 + 20_000), 0, 2, 1),
    ),
]


@pytest.mark.parametrize(("made", "figures"), TABLE)
def test_estimates(made: Protocol, figures: tuple[float, float, int, int, int, int]) -> None:
    measuring_s, settling_s, size, nd_changes, points, steps = figures
    found = made.estimate()
    expected = Estimate(measuring_s + settling_s, measuring_s, settling_s, size, nd_changes, points, steps)
    for field in Estimate.__dataclass_fields__:
        assert getattr(found, field) == pytest.approx(getattr(expected, field), rel=1e-9), field


@pytest.mark.parametrize("made", [made for made, _ in TABLE])
def test_measuring_time_is_that_of_the_light(made: Protocol) -> None:
    total_s = sum(stimulus_of(point).duration_s for point in made.expand())
    assert made.estimate().measuring_s == pytest.approx(total_s, rel=1e-12)
