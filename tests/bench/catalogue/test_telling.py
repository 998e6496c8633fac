"""The table of runs."""

from __future__ import annotations

from dataclasses import replace

import pytest

from bench.catalogue.entry import RunEntry
from bench.catalogue.telling import length_text, runs_text, size_text

ENTRY = RunEntry(
    "a_run", "id", "2026-11-20T12:00:00Z", "t", "on-family", "", "box", "", "IMX636", "00042", planned=64, done=64,
    state="finished", duration_s=9660.0, bytes=5_500_000,
)  # fmt: skip


def test_all_columns_where_there_is_room() -> None:
    head, _, row = runs_text([ENTRY], 200).splitlines()
    assert head.split() == ["begun", "run", "protocol", "station", "sensor", "points", "state", "took", "size"]
    for cell in ("a_run", "on-family", "box", "IMX636 (00042)", "64", "finished", "2 h 41 min", "5.5 MB"):
        assert cell in row


def test_a_narrow_terminal_loses_columns_and_never_names() -> None:
    name = "2026-11-22T23-12-43.442Z-a-protocol-with-a-long-name"
    text = runs_text([replace(ENTRY, folder=name)], 80)
    assert name in text
    assert "finished" in text
    assert "box" not in text


def test_what_is_missing_is_told() -> None:
    one = replace(ENTRY, done=60, failed=1, rejected=2, green=50, red=10)
    text = runs_text([one], 200)
    assert "60 of 64, 1 failed, 2 rejected" in text
    assert "50 green, 10 red" in text


def test_names_are_not_markup_and_problems_stand_below() -> None:
    text = runs_text([replace(ENTRY, folder="[red]x[/red]"), RunEntry("b", problem="[bold]no run")], 200)
    assert "[red]x[/red]" in text
    assert text.endswith("\n\nb: [bold]no run")


@pytest.mark.parametrize(("seconds", "text"), [(4.2, "4 s"), (89, "89 s"), (91, "2 min"), (9660, "2 h 41 min")])
def test_lengths(seconds: float, text: str) -> None:
    assert length_text(seconds) == text


@pytest.mark.parametrize(
    ("size", "text"), [(0, "0 B"), (999, "999 B"), (1000, "1 kB"), (999_700, "1 MB"), (2e15, "2e+03 TB")]
)
def test_sizes(size: float, text: str) -> None:
    assert size_text(size) == text
