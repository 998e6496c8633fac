"""The section `suspend`: its defaults, and what it refuses."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from protocols.suspend import Suspend


def test_a_protocol_that_says_nothing_still_looks_at_the_disk() -> None:
    suspend = Suspend()
    assert suspend.disk_free_mib == 200.0
    assert (suspend.temperature_c, suspend.light_settled, suspend.ambient, suspend.usb_errors) == (None,) * 4
    assert (suspend.check_every_s, suspend.give_up_after_s, suspend.then) == (30.0, 3600.0, "pause")


def test_all_of_it_is_read_and_written_again() -> None:
    content: dict[str, Any] = {
        "temperature_c": {"low": 20, "high": 40},
        "disk_free_mib": None,
        "light_settled": {"within": 0.01, "within_s": 5},
        "ambient": {"every_s": 600},
        "usb_errors": {"at_most": 3, "per_s": 60},
        "check_every_s": 10,
        "give_up_after_s": 100,
        "then": "stop",
    }
    suspend = Suspend.model_validate(content)
    assert suspend.ambient is not None
    assert suspend.ambient.at_most_factor == 3.0
    assert Suspend.model_validate(suspend.model_dump()) == suspend


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({"temperature_c": {}}, "low or high"),
        ({"temperature_c": {"low": 30, "high": 30}}, "less than high, which is 30 C"),
        ({"temperature_c": {"low": True}}, "number"),
        ({"disk_free_mib": 0}, "greater than 0"),
        ({"light_settled": {"within": 1.0, "within_s": 1}}, "less than 1"),
        ({"light_settled": {"within": 0.1}}, "within_s"),
        ({"ambient": {}}, "either every_points or every_s"),
        ({"ambient": {"every_points": 3, "every_s": 3}}, "either every_points or every_s"),
        ({"ambient": {"every_points": 3, "at_most_factor": 1}}, "greater than 1"),
        ({"usb_errors": {"at_most": -1, "per_s": 1}}, "greater than or equal to 0"),
        ({"check_every_s": 100, "give_up_after_s": 10}, "give_up_after_s, which is 10 s"),
        ({"then": "abort"}, "pause"),
        ({"humidity": 3}, "humidity"),
    ],
)
def test_what_makes_no_sense_is_refused(content: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        Suspend.model_validate(content)
