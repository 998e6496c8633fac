"""Which runs are wanted."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import Any

import pytest

from bench.catalogue.entry import RunEntry
from bench.catalogue.selecting import Selection, parse_day
from protocols.errors import InputError

ENTRY = RunEntry(
    "a", "id", "2026-11-20T21:00:00Z", "ON family", "on-family", "abcdef0123", "Box", "", "IMX636", "00042",
    planned=3, done=3, state="finished", green=2, red=1,
)  # fmt: skip


def _at(hour: int) -> datetime:
    return datetime(2026, 11, 20, hour, tzinfo=UTC)


@pytest.mark.parametrize(
    ("asked", "taken"),
    [
        ({}, True),
        ({"sensor": "imx"}, True),
        ({"sensor": "0042"}, True),
        ({"sensor": "GenX"}, False),
        ({"protocol": "FAMILY"}, True),
        ({"protocol": "abcdef"}, True),
        ({"protocol": "abcde"}, False),
        ({"protocol": "off"}, False),
        ({"station": "box"}, True),
        ({"state": "finished"}, True),
        ({"state": "aborted"}, False),
        ({"verdict": "red"}, True),
        ({"verdict": "amber"}, False),
        ({"since": _at(21)}, True),
        ({"since": _at(22)}, False),
        ({"until": _at(21)}, False),
        ({"until": _at(22), "sensor": "IMX"}, True),
    ],
)
def test_what_is_taken(asked: dict[str, Any], taken: bool) -> None:
    assert Selection(**asked).takes(ENTRY) is taken


def test_what_is_no_run_is_shown_only_with_everything() -> None:
    no_run = RunEntry("b", problem="this is no run")
    assert Selection().takes(no_run)
    assert not Selection(station="").takes(no_run) or Selection(station="").is_everything
    assert not Selection(state="finished").takes(no_run)


def test_a_run_without_a_date_is_not_in_any_time() -> None:
    undated = RunEntry("c", "id", created="yesterday")
    assert not Selection(since=_at(1)).takes(undated)
    assert Selection().takes(undated)


def test_a_day_is_a_whole_day_in_local_time() -> None:
    begin, end = parse_day("2026-11-20"), parse_day("2026-11-20", end=True)
    assert timedelta(hours=22) < end - begin < timedelta(hours=26)
    assert begin.astimezone().hour == 0
    assert parse_day("2026-11-20T21:00:00+00:00") == _at(21)


@pytest.mark.parametrize("text", ["yesterday", "", "2026-13-01", "20.11.2026", "9999-12-31", "2026-11-20T25:00"])
def test_what_is_no_date_gets_one_line(text: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_day(text, end=True)
    line = f"{text!r} is no date; expected a day such as 2026-11-20, or a time such as 2026-11-20T21:00"
    assert str(caught.value) == line
