"""What the rest of the bench makes of runs whose curves are refined: estimates, tables, the page, the catalogue."""

from __future__ import annotations

import json
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from refining_runs import REFINE, TEXT, contents, lines, protocol  # type: ignore[import-not-found]

from bench.analysis import analyze
from bench.catalogue.counts import count_journal
from bench.cli import run as command
from bench.run import check, run_protocol
from bench.run.foretelling import points_text, time_lines
from bench.station import load_station
from bench.store import Run
from bench.store.journal import read_journal
from bench.watch.planned import SpareLooks
from bench.watch.watcher import Watcher
from protocols import load_protocol


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a run of five planned points, four that were added, and one number that stayed free."""
    folder = tmp_path_factory.mktemp("whole") / "run"
    run_protocol(protocol(REFINE.replace("4", "5").replace("0.02", "0.2")), load_station("simulated"), folder)
    return folder


@pytest.fixture
def interrupted(whole: Path, tmp_path: Path) -> Path:
    """Return it as it was after its first decision."""
    shutil.copytree(whole, tmp_path / "run")
    text = (whole / "journal.jsonl").read_text().splitlines(keepends=True)
    first = next(n for n, line in enumerate(text) if "plan_changed" in line)
    (tmp_path / "run/journal.jsonl").write_text("".join(text[: first + 4]))
    return tmp_path / "run"


def test_check_tells_the_worst_case_and_says_so(tmp_path: Path) -> None:
    report = check(protocol().protocol, load_station("simulated"))
    plain = check(protocol("").protocol, load_station("simulated"))
    told = report.lines()
    assert told[0].startswith("a curve that is refined: at most 9 points (5 planned, 4 more where curves rise) on")
    assert told[1].startswith("time: at most ")
    assert report.foresight.duration_s == pytest.approx(report.estimate.duration_s)
    assert report.foresight.duration_s > plain.foresight.duration_s
    assert report.to_dict()["estimate"]["added"] == 4
    assert "at most" not in "".join(plain.lines()[:2])
    assert points_text(plain.estimate) == "5 points"


def test_on_a_real_clock_the_end_is_the_latest() -> None:
    report = check(protocol().protocol, load_station("simulated"))
    (first, *_) = time_lines(report.estimate, replace(report.foresight, real_clock=True), report.end)
    assert first.startswith("time: at most ")
    assert "; it ends at the latest 20" in first


def test_a_mistake_ends_the_command_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "wrong.yaml").write_text(TEXT.replace("REFINE", "refine: {until: {gap: 2}, at_most: 3}"))
    assert command(["check", str(tmp_path / "wrong.yaml")]) != 0
    told = capsys.readouterr().err.strip().splitlines()
    assert len(told) == 1
    assert f"{tmp_path / 'wrong.yaml'}:17:31: " in told[0]


def test_the_list_of_protocols_says_at_most(capsys: pytest.CaptureFixture[str]) -> None:
    assert command(["protocols"]) == 0
    shown = {line.split()[0]: line for line in capsys.readouterr().out.splitlines() if line}
    assert "at most 48" in shown["refined_quick_look"]
    assert "at most" not in shown["quick_look"]


def test_the_ready_protocol_covers_the_expected_threshold_widely() -> None:
    made = load_protocol("refined_quick_look").protocol
    assert (len(made.expand()), made.estimate().points) == (16, 48)
    for curve in made.refined_curves():
        contrasts = [point.log_contrast for point in curve.planned]
        assert max(contrasts) > 30 * min(contrasts)


def test_a_finished_run_has_nothing_to_remark(whole: Path) -> None:
    run = Run.open(whole)
    assert run.remarks() == ()
    assert max(contents(whole)) < 10
    assert len(analyze(run).curves[0].log_contrast) == len(run) - 1


def test_an_interrupted_one_counts_what_was_added(interrupted: Path) -> None:
    (remark,) = Run.open(interrupted).remarks()
    assert remark == "only 4 of 8 planned points were taken: the run did not come to its end"


def test_the_catalogue_counts_what_was_added(whole: Path, interrupted: Path) -> None:
    for folder, state in ((whole, "finished"), (interrupted, "running")):
        counts = count_journal(read_journal(folder / "journal.jsonl"))
        points = {line["point"] for line in lines(folder) if "point" in line}
        assert (counts.planned, counts.state) == (len(points), state)


def test_the_page_shows_what_was_added_with_its_contrast(whole: Path) -> None:
    state = json.loads(Watcher(whole).snapshot.body)
    (row,) = next(group for group in state["points"] if group["title"] == "on")["rows"]
    assert sorted(row["index"]) == sorted(set(contents(whole)) - {4})
    taken = contents(whole)
    assert [taken[index][0] for index in row["index"]] == sorted(taken[index][0] for index in row["index"])
    assert state["progress"]["at_most"] == state["progress"]["total"] == len(taken)


def test_the_page_says_how_many_there_can_be(interrupted: Path) -> None:
    progress = json.loads(Watcher(interrupted).snapshot.body)["progress"]
    assert (progress["total"], progress["at_most"]) == (8, 10)


def test_a_journal_that_nobody_can_have_written_adds_nothing_to_the_page(whole: Path) -> None:
    entries = read_journal(whole / "journal.jsonl")
    run = Run.open(whole)
    assert SpareLooks.of(run.header).added([e for e in entries if e.state != "plan_changed"]) == {}
    assert SpareLooks().added(entries) == {}
    assert SpareLooks().may_add(entries) == 0
