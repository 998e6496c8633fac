"""How numbers are written."""

from __future__ import annotations

import math

import pytest

from bench.report import wording


@pytest.mark.parametrize(
    ("lux", "text"),
    [
        (0.076, "76 mlux"), (3.0, "3 lux"), (300.0, "300 lux"), (0.152, "152 mlux"), (1.0, "1 lux"), (0.0, "dark"),
        (0.9999, "1 lux"), (2.5e-4, "250 \u00b5lux"), (1200.0, "1200 lux"), (25_000.0, "25 klux"),
        (0.1234, "123 mlux"),
        (12.25, "12.2 lux"), (math.nan, "unknown level"),
    ],
)  # fmt: skip
def test_light_levels_read_as_people_say_them(lux: float, text: str) -> None:
    assert wording.lux_label(lux) == text


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.02, "20 ms"),
        (100e-6, "100 \u00b5s"),
        (2.5, "2.5 s"),
        (0.0205, "20.5 ms"),
        (120.0, "120 s"),
        (0.0, "0 \u00b5s"),
    ],
)
def test_durations(seconds: float, text: str) -> None:
    assert wording.duration_label(seconds) == text


@pytest.mark.parametrize(
    ("value", "half_width", "decimals"),
    [(0.35, 0.012, 3), (0.35, 0.008, 3), (0.35, 0.04, 2), (0.35, 0.0021, 4), (98.5, 1.5, 1), (123.0, 40.0, 0)],
)
def test_decimals_follow_the_interval(value: float, half_width: float, decimals: int) -> None:
    assert wording.decimals_for(value - half_width, value + half_width, value) == decimals


def test_decimals_without_an_interval_follow_the_value() -> None:
    assert wording.decimals_for(math.nan, math.nan, 0.35) == 3


def test_numbers_that_are_not_finite_are_not_printed_as_nan() -> None:
    assert wording.fixed(math.nan, 3) == wording.MISSING
    assert wording.fixed(math.inf, 3) == "\u221e"
    assert wording.fixed(-0.25, 2) == "\u22120.25"


def test_counts_agree_with_their_noun() -> None:
    assert wording.count(1, "pulse") == "1 pulse"
    assert wording.count(0, "stretch", "stretches") == "0 stretches"
    assert wording.count(12_345, "event") == "12\u2009345 events"
