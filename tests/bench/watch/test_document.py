"""The state of a run: numbers as the analysis has them, states as the journal has them."""

from __future__ import annotations

import json
import math
from datetime import datetime
from typing import TYPE_CHECKING, Any

import pytest

from bench.analysis import analyze
from bench.store import Run
from bench.store.header import read_header
from bench.watch.planned import planned_looks

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from bench.analysis import Analysis

    Journal = Callable[[Path], list[dict[str, Any]]]
    MakeJournal = Callable[[Path, list[dict[str, Any]]], None]
    StateOf = Callable[[Path], dict[str, Any]]


def tiles_of(state: dict[str, Any]) -> dict[int, str]:
    """Return the state of each square."""
    rows = [row for group in state["points"] for row in group["rows"]]
    return {index: name for row in rows for index, name in zip(row["index"], row["state"], strict=True)}


@pytest.fixture(name="analysis", scope="module")
def analysis_of_all(finished_run: Path) -> Analysis:
    return analyze(Run.open(finished_run), pixel_maps=False, theta_fit=lambda _: None)


def test_responses_are_those_of_the_analysis(finished_run: Path, analysis: Analysis, state_of: StateOf) -> None:
    state = state_of(finished_run)
    shown = {
        (panel["polarity"], point[0], step["label"]): point[1:]
        for family in state["responses"]
        for panel in family["panels"]
        for curve in panel["curves"]
        for point in curve["points"]
        for step in [family["steps"][curve["step"]]]
    }
    expected = {
        (r.key.polarity, r.point, f"{r.key.baseline_lux:g} lux"): [r.log_contrast, r.probability, r.low, r.high]
        for r in analysis.responses
    }
    assert shown.keys() == expected.keys()
    assert len(shown) == 14  # six square waves with two polarities, and two ON points
    for key, values in expected.items():
        assert shown[key] == pytest.approx(values, rel=1e-5), key
    assert len({round(values[1], 3) for values in shown.values()}) > 4  # there is something to tell apart


def test_curves_hold_what_one_curve_of_the_analysis_holds(
    finished_run: Path, analysis: Analysis, state_of: StateOf
) -> None:
    shown = sorted(
        sorted(point[0] for point in curve["points"])
        for family in state_of(finished_run)["responses"]
        for panel in family["panels"]
        for curve in panel["curves"]
    )
    expected = sorted(sorted(r.point for r in analysis.responses if r.key == c.key) for c in analysis.curves)
    assert shown == expected


def test_background_rates_are_those_of_the_analysis(
    finished_run: Path, analysis: Analysis, state_of: StateOf
) -> None:
    background = state_of(finished_run)["background"]
    assert len(background["rates"]) == len(analysis.background) == 4
    for row in analysis.background:
        rate = next(r for r in background["rates"] if (r["point"], r["polarity"]) == (row.point, row.polarity))
        assert [rate["rate"], rate["low"], rate["high"]] == pytest.approx(
            [row.rate.value, row.rate.low, row.rate.high], rel=1e-5
        )
        assert rate["limit"] == (row.events == 0)


def test_a_finished_run(finished_run: Path, state_of: StateOf) -> None:
    state = state_of(finished_run)
    assert state["format"] == "evs-bench-watch/1"
    assert state["state"]["name"] == "finished"
    assert state["progress"]["total"] == state["progress"]["done"] == state["progress"]["shown"] == 10
    assert set(tiles_of(state).values()) == {"done"}
    assert [(g["title"], [r["label"] for r in g["rows"]]) for g in state["points"]] == [
        ("square", ["10 lux", "100 lux"]),
        ("on", ["10 lux"]),
        ("dark", [""]),
    ]
    assert state["run"]["station"] == "simulated"
    assert "run in" in state["log"][0]
    assert state["problems"] == []


def test_the_state_of_a_run_that_stands_still_stays_the_same(run: Path, state_of: StateOf) -> None:
    assert state_of(run) == state_of(run)


def at(second: int) -> str:
    """Return a time of a journal."""
    return f"2026-11-22T10:00:{second:02d}.000Z"


def _mixed(lines: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return a journal in which points went all ways, up to one that is being measured."""
    done = {line["point"]: line for line in lines if line["state"] == "done"}
    begun = [line for line in lines if line["state"] in ("run_started", "planned")]
    begun = [{**line, "t": at(0)} for line in begun]
    return [
        *begun,
        {**done[0], "t": at(10)},
        {**done[1], "t": at(20), "verdict": "amber", "reasons": ["it was warm"]},
        {"t": at(30), "point": 2, "state": "rejected", "attempt": 1, "reason": "3 edges <lost>"},
        {"t": at(40), "point": 3, "state": "failed", "attempt": 1, "reason": "no camera"},
        {"t": at(45), "point": 4, "state": "skipped", "attempt": 1, "reason": None},
        {"t": at(50), "point": 5, "state": "started", "attempt": 1},
    ]


def test_every_way_a_point_can_go(
    run: Path,
    journal_of: Journal,
    make_journal: MakeJournal,
    state_of: StateOf,
    held_by_another: Callable[[Path], Any],
) -> None:
    make_journal(run, _mixed(journal_of(run)))
    with held_by_another(run / "journal.jsonl"):
        state = state_of(run)
    names = ["done", "doubtful", "bad", "failed", "skipped", "measuring", *["planned"] * 4]
    assert list(dict(sorted(tiles_of(state).items())).values()) == names
    assert state["state"]["name"] == "measuring"
    assert state["state"]["writer"] == "there"
    assert state["careful"] == [3, 2, 1]
    assert state["notes"]["2"] == [{"t": "2026-11-22T10:00:30.000Z", "text": "judged bad: 3 edges <lost>"}]
    assert "it was warm" in state["notes"]["1"][0]["text"]
    progress = state["progress"]
    assert {name: progress[name] for name in ("total", "done", "failed", "bad", "skipped", "planned")} == {
        "total": 10, "done": 1, "failed": 1, "bad": 1, "skipped": 1, "planned": 4,
    }  # fmt: skip
    assert progress["running_since"] == "2026-11-22T10:00:00.000Z"
    assert progress["ends"] > "2026-11-22T10:00:50"


def test_the_time_that_is_left_goes_by_what_points_cost(
    run: Path,
    journal_of: Journal,
    make_journal: MakeJournal,
    state_of: StateOf,
    held_by_another: Callable[[Path], Any],
) -> None:
    lines = _mixed(journal_of(run))
    make_journal(run, [line for line in lines if line["state"] in ("run_started", "planned") or line["point"] == 0])
    with held_by_another(run / "journal.jsonl"):
        ends = state_of(run)["progress"]["ends"]
    expected = {i: look.expected_s for i, look in planned_looks(read_header(run / "run.yaml")).items()}
    left_s = 10.0 * (sum(expected.values()) - expected[0]) / expected[0]
    found = datetime.fromisoformat(ends) - datetime.fromisoformat("2026-11-22T10:00:10Z")
    assert math.isclose(found.total_seconds(), left_s, abs_tol=0.01)
    assert abs(left_s - 90.0) > 1.0


def test_a_run_whose_writer_died(
    run: Path, journal_of: Journal, make_journal: MakeJournal, state_of: StateOf
) -> None:
    make_journal(run, _mixed(journal_of(run)))
    state = state_of(run)
    assert state["state"]["name"] == "dead"
    assert state["state"]["badge"] == "Nothing is writing this run"
    assert tiles_of(state)[5] == "planned"
    assert "taken again" in state["notes"]["5"][0]["text"]
    assert state["progress"]["running_since"] is None
    assert state["progress"]["measured_s"] == 50.0


def test_a_file_that_was_changed_is_not_shown_and_said(run: Path, state_of: StateOf) -> None:
    with (run / "points/000003.h5").open("ab") as file:
        file.write(b"\0")
    (run / "points/000004.h5").unlink()
    state = state_of(run)
    assert state["notes"]["3"][0]["text"] == ("not shown: points/000003.h5 was changed since it was written")
    assert state["notes"]["4"][0]["text"] == "not shown: points/000004.h5 is not there"
    assert set(state["careful"]) == {3, 4}
    shown = {point[0] for f in state["responses"] for p in f["panels"] for c in p["curves"] for point in c["points"]}
    assert shown == {0, 1, 2, 5, 6, 7}


@pytest.mark.parametrize("name", ["../outside.h5", "/etc/hostname", "points/../../outside.h5"])
def test_the_journal_cannot_lead_out_of_the_folder(
    name: str, run: Path, journal_of: Journal, make_journal: MakeJournal, state_of: StateOf
) -> None:
    (run.parent / "outside.h5").write_bytes((run / "points/000000.h5").read_bytes())
    lines = journal_of(run)
    make_journal(run, [{**ln, "file": name} if (ln["state"], ln.get("point")) == ("done", 0) else ln for ln in lines])
    state = state_of(run)
    assert "lies outside the run folder" in state["notes"]["0"][0]["text"]


def test_a_run_without_journal_and_protocol(run: Path, state_of: StateOf) -> None:
    (run / "journal.jsonl").unlink()
    header = (run / "run.yaml").read_text()
    (run / "run.yaml").write_text(header[: header.index("protocol:")])
    state = state_of(run)
    assert set(tiles_of(state)) == set(range(10))
    assert state["state"]["name"] == "finished"
    assert state["problems"] == ["This run has no journal: all files in its folder are shown."]
    assert len(state["responses"]) == 2
    assert json.dumps(state, allow_nan=False)
