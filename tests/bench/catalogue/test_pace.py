"""What is learned of the time from earlier runs: worked out by hand from journals made by hand."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest

from bench.catalogue.index import INDEX_FILE
from bench.catalogue.pace import Changed, Pace, changes_of, learned_pace, pace_of_journal, waits_s
from bench.station import load_station
from bench.store.journal import JournalEntry, read_journal
from protocols import parse_protocol
from protocols.estimation import recording_s

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from protocols.points import Point

PROTOCOL = """\
format: evs-bench-protocol/1
title: levels
roi: {x: 10, y: 20, width: 4, height: 5}
settle: {light_s: 0.25, filter_s: 0.5, bias_s: 1.0}
measurements:
  - name: dark
    stimulus: {kind: constant, duration_s: 2.0}
    sweep: {illuminance_lux: [1, 2, 4], nd_od: [0, 2]}
  - name: other
    stimulus: {kind: constant, duration_s: 3.0}
    settings: {biases: {bias_diff_on: 20}}
    sweep: {illuminance_lux: [4, 5], nd_od: [2]}
"""


@pytest.fixture(name="points")
def points_of_the_protocol() -> dict[int, Point]:
    return {point.index: point for point in parse_protocol(PROTOCOL, "levels.yaml").protocol.expand()}


def _journal(
    tmp_path: Path, line: Callable[..., dict[str, Any]], points: dict[int, Point], beside: Callable[[int], float]
) -> list[JournalEntry]:
    """Return a journal in which a point takes `beside` it seconds more than it records and waits."""
    file = tmp_path / "journal.jsonl"
    file.write_text("".join(json.dumps(one) + "\n" for one in _lines(line, points, beside)))
    return read_journal(file)


def _lines(
    line: Callable[..., dict[str, Any]], points: dict[int, Point], beside: Callable[[int], float]
) -> list[dict[str, Any]]:
    lines, at_s, before = [line("run_started", 0.0)], 0.0, None
    for index, point in points.items():
        lines.append(line("started", at_s, index))
        at_s += recording_s(point) + waits_s(point, changes_of(point, before)) + beside(index)
        lines.append(line("done", at_s, index, file=f"points/{index:06d}.h5"))
        before = point
    return [*lines, line("run_finished", at_s)]


def test_what_is_taken_beside_recording_and_waiting(
    tmp_path: Path, points: dict[int, Point], journal_line: Callable[..., dict[str, Any]]
) -> None:
    """Three levels, the filter, two levels more, the bias, one level: the first is left out, plain is a median."""
    kinds = [changes_of(point, points.get(index - 1)).kind for index, point in points.items()]
    assert kinds == ["", "plain", "plain", "filter", "plain", "plain", "bias", "plain"]
    beside = [100.0, 1.0, 1.5, 7.0, 1.2, 60.0, 3.0, 1.1]
    pace = pace_of_journal(_journal(tmp_path, journal_line, points, beside.__getitem__), points)
    assert pace["plain"] == pytest.approx(1.2)
    assert pace["filter"] == pytest.approx(7.0)
    assert pace["bias"] == pytest.approx(3.0)
    taken = 5 * 2.25 + 2.0 + 0.25 + 0.5 - 2.25 + 3.0 + 0.25 + 1.0 + 3.25 + sum(beside[1:])
    assert pace["took_s_per_pixel_s"] == pytest.approx(taken / (20 * (5 * 2.0 + 2 * 3.0)))


def test_points_that_several_workers_took_tell_nothing(
    points: dict[int, Point], journal_line: Callable[..., dict[str, Any]]
) -> None:
    steps = [("started", 0), ("started", 1), ("done", 0), ("done", 1), ("started", 2), ("done", 2)]
    lines = [journal_line(state, 3.0 * i, index) for i, (state, index) in enumerate(steps)]
    entries = [JournalEntry(one["state"], one["point"], one["t"]) for one in lines]
    assert pace_of_journal(entries, points) == {}


def test_a_clock_that_was_set_back_takes_one_point_away(
    tmp_path: Path, points: dict[int, Point], journal_line: Callable[..., dict[str, Any]]
) -> None:
    beside = [0.0, 1.0, -3600.0, 7.0, 1.0, 1.0, 3.0, 1.0]
    pace = pace_of_journal(_journal(tmp_path, journal_line, points, beside.__getitem__), points)
    assert pace["plain"] == pytest.approx(1.0)


def test_after_a_pause_or_a_failure_devices_have_to_get_going(
    points: dict[int, Point], journal_line: Callable[..., dict[str, Any]]
) -> None:
    line = journal_line
    lines = [
        line("run_started", 0), line("started", 0, 0), line("done", 10, 0), line("started", 10, 1),
        line("done", 13.25, 1), line("paused", 14), line("resumed", 500), line("started", 500, 2),
        line("done", 590, 2), line("started", 590, 3), line("failed", 600, 3), line("started", 600, 3),
        line("done", 690, 3), line("started", 690, 4), line("done", 693.25, 4),
    ]  # fmt: skip
    entries = [JournalEntry(one["state"], one.get("point"), one["t"]) for one in lines]
    pace = pace_of_journal(entries, points)
    assert pace["plain"] == pytest.approx(1.0)
    assert pace["filter"] is None


def test_a_pace_says_what_a_point_takes() -> None:
    pace = Pace(3, 1.0, 7.0, None, 0.01, 0.5, 60.0)
    assert pace.beside_s(Changed(filter=False, bias=False)) == 1.0
    assert pace.beside_s(Changed(filter=True, bias=True)) == 7.0
    assert replace(pace, filter_s=0.5).beside_s(Changed(filter=True, bias=False)) == 1.0
    assert replace(pace, plain_s=-1.0, filter_s=None).beside_s(Changed(filter=True, bias=False)) == 0.0


def test_it_is_learned_from_runs_on_the_same_station(
    make_run: Callable[..., Path], runs: Path, points: dict[int, Point], journal_line: Callable[..., dict[str, Any]]
) -> None:
    station = load_station("simulated")
    resolved = parse_protocol(PROTOCOL, "levels.yaml").protocol.resolved()
    for name, seconds in (("a", 1.0), ("b", 2.0), ("c", 9.0)):
        lines = _lines(journal_line, points, lambda _, seconds=seconds: seconds)  # type: ignore[misc]
        make_run(name, lines, protocol=resolved, station=station.recorded)
    other = {**station.recorded, "roles": {"light": {"driver": "a:B"}}}
    lines = _lines(journal_line, points, lambda _: 100.0)
    make_run("other_drivers", lines, protocol=resolved, station=other)
    make_run("no_protocol", lines, protocol={"measurements": 3}, station=station.recorded)
    for _ in range(2):  # worked out, then from the index
        pace = learned_pace(runs, station)
        assert pace is not None
        assert pace.runs == 3
        assert (pace.plain_s, pace.filter_s, pace.bias_s) == pytest.approx((2.0, 2.0, 2.0))
    assert (runs / INDEX_FILE).exists()


def test_nothing_is_learned_from_nothing(runs: Path) -> None:
    station = load_station("simulated")
    assert learned_pace(runs, station) is None
    assert learned_pace(runs / "none", station) is None


def test_what_is_computed_never_takes_less_than_the_quickest_point(points: dict[int, Point]) -> None:
    """Eight points of 20 pixels: six of 2 s, two of 3 s; at 0.01 s for each pixel and second 0.4 and 0.6 s."""
    assert Pace(1, 0.0, None, None, 0.01, 0.0, 60.0).computing_s(points.values()) == pytest.approx(6 * 0.4 + 2 * 0.6)
    assert Pace(1, 0.0, None, None, 0.01, 0.5, 60.0).computing_s(points.values()) == pytest.approx(6 * 0.5 + 2 * 0.6)


def test_small_recordings_are_no_measure_of_large_ones(points: dict[int, Point]) -> None:
    """The largest recording is 60 pixels times seconds; four times what was seen is still believed."""
    assert Pace(1, 0.0, None, None, 0.01, 0.0, 15.0).computing_s(points.values()) is not None
    assert Pace(1, 0.0, None, None, 0.01, 0.0, 14.9).computing_s(points.values()) is None
