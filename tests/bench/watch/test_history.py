"""What the journal says of points and of the run."""

from __future__ import annotations

from typing import Any

import pytest

from bench.store.journal import JournalEntry
from bench.watch.history import History, history_of


def told(*lines: dict[str, Any]) -> History:
    """Return what lines say that come a second apart."""
    entries = []
    for second, line in enumerate(lines):
        t = f"2026-11-22T10:00:{second:02d}.000Z"
        known = {key: line[key] for key in ("state", "point", "attempt", "file", "sha256", "reason") if key in line}
        entries.append(JournalEntry(t=t, everything={"t": t, **line}, **known))
    return history_of(entries)


def point(state: str, **more: Any) -> dict[str, Any]:
    return {"state": state, "point": 7, **more}


BEGUN = {"state": "run_started"}


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        ([point("planned")], "planned"),
        ([point("planned"), point("started")], "measuring"),
        ([point("started"), point("done")], "done"),
        ([point("started"), point("done", verdict="green")], "done"),
        ([point("started"), point("done", verdict="amber", reasons=["warm"])], "doubtful"),
        ([point("started"), point("done", verdict="red")], "bad"),
        ([point("started"), point("done", verdict=["green"])], "done"),
        ([point("started"), point("rejected")], "bad"),
        ([point("started"), point("rejected"), point("planned")], "bad"),
        ([point("started"), point("rejected"), point("started", attempt=2)], "measuring"),
        ([point("started"), point("failed")], "failed"),
        ([point("started"), point("failed"), point("planned")], "planned"),
        ([point("started"), point("planned")], "planned"),
        ([point("skipped")], "skipped"),
        ([point("planned"), point("something new")], "planned"),
    ],
)
def test_the_state_of_a_point(lines: list[dict[str, Any]], expected: str) -> None:
    assert told(BEGUN, *lines).points[7].state == expected


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        ([], "measuring"),
        ([{"state": "paused"}], "paused"),
        ([{"state": "paused"}, {"state": "resumed"}], "measuring"),
        ([{"state": "suspended"}], "suspended"),
        ([{"state": "run_finished"}], "finished"),
        ([{"state": "run_aborted", "reason": "stopped by the operator"}], "aborted"),
        ([point("failed"), {"state": "run_aborted", "reason": "no camera"}], "failed"),
        ([point("failed"), {"state": "run_aborted", "reason": "stopped at once by the operator"}], "aborted"),
        ([{"state": "run_aborted", "reason": "no camera", "end": "failed"}], "failed"),
        ([point("failed"), {"state": "run_aborted", "reason": "enough", "end": "aborted"}], "aborted"),
        ([point("failed"), {"state": "resumed"}, {"state": "run_aborted", "reason": "disk full"}], "aborted"),
    ],
)
def test_the_state_of_the_run(lines: list[dict[str, Any]], expected: str) -> None:
    assert told(BEGUN, *lines).state == expected


def test_reasons_of_a_point_are_kept_with_their_attempt() -> None:
    history = told(
        BEGUN,
        point("rejected", reason="gaps", reasons=["gaps", {"text": "3 edges lost"}, {"gap": 0.2}]),
        point("started", attempt=2),
        point("done", attempt=2, file="points/000007.r1.h5", sha256="ab"),
    )
    remarks = [(remark.state, remark.attempt, remark.text) for remark in history.points[7].remarks]
    assert remarks == [("bad", 1, "gaps; 3 edges lost; gap 0.2"), ("done", 2, "")]
    assert [(f.point, f.file, f.sha256) for f in history.files] == [(7, "points/000007.r1.h5", "ab")]


def test_points_that_a_change_of_plan_adds_are_planned() -> None:
    history = told(BEGUN, point("planned"), {"state": "plan", "points": [8, {"index": 9}, "x", -1, True]})
    assert {index: p.state for index, p in history.points.items()} == {7: "planned", 8: "planned", 9: "planned"}


def test_time_counts_while_points_are_taken() -> None:
    history = told(BEGUN, point("started"), {"state": "paused"}, {"state": "resumed"}, point("started"), BEGUN)
    assert [i.stop and (i.stop - i.start).total_seconds() for i in history.intervals] == [2.0, 1.0, None]
