"""The runs in a folder: what is known of each, and that the index never is in the way."""

from __future__ import annotations

import os
import shutil
import sqlite3
import subprocess
import sys
import threading
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bench.catalogue.catalogue import Catalogue, read_catalogue
from bench.catalogue.index import INDEX_FILE
from bench.catalogue.summary import summarize
from bench.store import RunError, RunWriter

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from bench.catalogue.entry import RunEntry


def _by_name(catalogue: Catalogue) -> dict[str, RunEntry]:
    return {entry.folder: entry for entry in catalogue.entries}


def test_what_is_known_of_a_run(make_run: Callable[..., Path], runs: Path) -> None:
    make_run("quick-look")
    (entry,) = read_catalogue(runs).entries
    assert (entry.id, entry.protocol) == ("2026-11-20T21-00-00.000Z-quick-look", "quick-look")
    assert (entry.station, entry.drivers, entry.sensor, entry.serial) == ("box", "light: a:B", "IMX636", "00042")
    assert (entry.planned, entry.done, entry.failed, entry.state) == (2, 2, 0, "finished")
    assert entry.duration_s == 20.0
    assert entry.bytes == 2000 + sum((runs / "quick-look" / n).stat().st_size for n in ("run.yaml", "journal.jsonl"))
    assert entry.problem == ""


def test_the_hash_tells_measurements_and_not_their_words(make_run: Callable[..., Path], runs: Path) -> None:
    make_run("one")
    make_run("other")
    make_run("more", protocol={"title": "x", "measurements": [{"name": "on", "pulses": 31}]})
    found = _by_name(read_catalogue(runs))
    assert found["one"].protocol_hash == found["other"].protocol_hash
    assert found["one"].protocol_hash != found["more"].protocol_hash


def test_only_what_has_changed_is_read_again(make_run: Callable[..., Path], runs: Path) -> None:
    for name in "abc":
        make_run(name)
    assert read_catalogue(runs).read == 3
    first = read_catalogue(runs)
    assert first.read == 0
    assert len(first.entries) == 3
    with (runs / "b" / "journal.jsonl").open("a") as journal:
        journal.write('{"state": "resumed"}\n{"state": "run_aborted"}\n')
    again = read_catalogue(runs)
    assert again.read == 1
    assert _by_name(again)["b"].state == "aborted"
    assert read_catalogue(runs, rebuild=True).read == 3
    shutil.rmtree(runs / "a")
    assert [entry.folder for entry in read_catalogue(runs).entries] == ["c", "b"]
    with sqlite3.connect(runs / INDEX_FILE) as connection:
        assert connection.execute("SELECT count(*) FROM run").fetchone() == (2,)
    connection.close()


def test_a_point_that_is_deleted_is_noticed(make_run: Callable[..., Path], runs: Path) -> None:
    folder = make_run("a")
    assert read_catalogue(runs).entries[0].problem == ""
    (folder / "points" / "000001.h5").unlink()
    os.utime(folder / "points", (1, 1))  # the clock was set back, and the time of change is earlier now
    assert read_catalogue(runs).entries[0].problem == "points/000001.h5 is done, but not there"


def test_newest_first_and_what_is_no_run_last(make_run: Callable[..., Path], runs: Path) -> None:
    make_run("a", created="2026-11-20T21:00:00Z")
    make_run("b", created="2026-11-20T23:30:00+03:00")
    make_run("c", created="2026-11-20T20:59:00Z")
    make_run("d", created=None)
    (runs / "empty").mkdir()
    assert [entry.folder for entry in read_catalogue(runs).entries] == ["a", "c", "b", "d", "empty"]


@pytest.mark.parametrize(
    ("damage", "problem"),
    [
        (lambda run: (run / "run.yaml").unlink(), "this is no run, it has no run.yaml"),
        (lambda run: (run / "run.yaml").write_text("format: ["), "run.yaml: not YAML: "),
        (lambda run: (run / "run.yaml").write_bytes(b"\xff\xfe\x00"), "run.yaml: not YAML: "),
        (lambda run: (run / "run.yaml").write_text("[]"), "run.yaml: expected keys and values, found list"),
        (lambda run: (run / "run.yaml").write_text("format: evs-bench-run/9"), "run.yaml: format evs-bench-run/9 is"),
        (lambda run: (run / "journal.jsonl").write_text("}\n{}\n"), "journal.jsonl:1:1: damaged line"),
    ],
)
def test_a_damaged_run_is_listed_with_one_line(
    make_run: Callable[..., Path], runs: Path, damage: Callable[[Path], object], problem: str
) -> None:
    make_run("good")
    damage(make_run("bad"))
    found = _by_name(read_catalogue(runs))
    assert found["bad"].problem.startswith(problem)
    assert "\n" not in found["bad"].problem
    assert found["good"].problem == ""


def test_a_folder_of_folders_is_told(make_run: Callable[..., Path], runs: Path) -> None:
    make_run("old/a")
    assert read_catalogue(runs).entries[0].problem == "no run.yaml, but 1 run in it: list that folder by itself"


def test_one_run_is_no_folder_of_runs(make_run: Callable[..., Path], runs: Path) -> None:
    with pytest.raises(RunError, match="this is one run; name the folder that holds the runs"):
        read_catalogue(make_run("a"))
    with pytest.raises(RunError, match="there is no such folder"):
        read_catalogue(runs / "none")


def test_points_count_as_they_stand_in_the_end(
    make_run: Callable[..., Path], runs: Path, journal_line: Callable[..., dict[str, Any]]
) -> None:
    line = journal_line
    make_run(
        "a",
        [
            line("run_started", 0, points=6),
            *(line("planned", 0, i) for i in range(6)),
            line("done", 1, 0, file="points/000000.h5", verdict="green"),
            line("rejected", 2, 1, verdict="red"),
            line("done", 3, 1, file="points/000001.r1.h5", verdict="amber"),
            line("rejected", 4, 2, verdict="red"),
            line("skipped", 5, 2),
            line("failed", 6, 3, reason="no light"),
            line("rejected", 7, 4, verdict="mauve"),
            line("run_aborted", 8),
        ],
    )
    (entry,) = read_catalogue(runs).entries
    assert (entry.planned, entry.done, entry.failed, entry.skipped, entry.rejected) == (6, 2, 1, 1, 1)
    assert entry.verdicts == {"green": 1, "amber": 1, "red": 1}
    assert entry.state == "aborted"


def test_an_interruption_is_not_counted(
    make_run: Callable[..., Path], runs: Path, journal_line: Callable[..., dict[str, Any]]
) -> None:
    times = [("run_started", 0), ("run_aborted", 10), ("resumed", 5000), ("run_finished", 5007)]
    make_run("a", [journal_line(state, at_s) for state, at_s in times])
    back = [("run_started", 100), ("run_aborted", 50), ("resumed", 60), ("run_finished", 67)]
    make_run("b", [journal_line(state, at_s) for state, at_s in back])
    found = _by_name(read_catalogue(runs))
    assert found["a"].duration_s == 17.0
    assert found["b"].duration_s == 7.0


def test_a_run_under_way_and_one_that_was_killed(make_run: Callable[..., Path], runs: Path) -> None:
    header = {"id": "live", "sensor": {"name": "s", "width": 4, "height": 4}, "roi": dict.fromkeys("xy", 0)}
    header["roi"] |= {"width": 4, "height": 4}  # type: ignore[operator]
    with RunWriter(runs / "live", header) as writer:
        writer.note("run_started", points=1)
        assert read_catalogue(runs).entries[0].state == "running"
        writer.note("paused")
        assert read_catalogue(runs).entries[0].state == "paused"
    assert read_catalogue(runs).entries[0].state == "interrupted"


def test_a_damaged_index_is_made_anew(make_run: Callable[..., Path], runs: Path) -> None:
    make_run("a")
    read_catalogue(runs)
    (runs / INDEX_FILE).write_bytes(b"this is no database, it is a text that is long enough to be read as one" * 100)
    first = read_catalogue(runs)
    assert first.entries[0].folder == "a"
    assert "was damaged" in first.problem
    assert read_catalogue(runs).read == 0


def test_an_index_of_another_version_is_made_anew(make_run: Callable[..., Path], runs: Path) -> None:
    make_run("a")
    connection = sqlite3.connect(runs / INDEX_FILE)
    connection.executescript("CREATE TABLE run (other TEXT); PRAGMA user_version = 99;")
    connection.close()
    first = read_catalogue(runs)
    assert (first.read, first.problem) == (1, "")
    assert read_catalogue(runs).read == 0


def test_a_table_that_is_not_ours_is_made_anew(make_run: Callable[..., Path], runs: Path) -> None:
    make_run("a")
    read_catalogue(runs)
    connection = sqlite3.connect(runs / INDEX_FILE)
    connection.executescript("DROP TABLE run; CREATE TABLE run (other TEXT);")
    connection.close()
    assert read_catalogue(runs).entries[0].planned == 2
    assert read_catalogue(runs).read == 0


def test_rows_that_we_never_wrote_are_not_believed(make_run: Callable[..., Path], runs: Path) -> None:
    make_run("a")
    read_catalogue(runs)
    connection = sqlite3.connect(runs / INDEX_FILE)
    connection.executescript("UPDATE run SET planned = 'many';")
    connection.close()
    again = read_catalogue(runs)
    assert (again.read, again.entries[0].planned) == (1, 2)


def test_a_locked_index_is_done_without(
    make_run: Callable[..., Path], runs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bench.catalogue.index._BUSY_S", 0.05)
    make_run("a")
    read_catalogue(runs)
    make_run("b")
    holder = sqlite3.connect(runs / INDEX_FILE, isolation_level=None)
    holder.execute("BEGIN EXCLUSIVE")
    try:
        found = read_catalogue(runs)
    finally:
        holder.execute("ROLLBACK")
        holder.close()
    assert {entry.folder for entry in found.entries} == {"a", "b"}
    assert "cannot be used (database is locked)" in found.problem
    assert read_catalogue(runs).read == 1


def test_a_folder_stands_where_the_index_should_be(make_run: Callable[..., Path], runs: Path) -> None:
    make_run("a")
    (runs / INDEX_FILE).mkdir()
    found = read_catalogue(runs)
    assert found.entries[0].folder == "a"
    assert "cannot be used" in found.problem


def test_no_more_is_read_than_is_allowed(make_run: Callable[..., Path], runs: Path) -> None:
    for i, name in enumerate("abcd"):
        os.utime(make_run(name) / "run.yaml", (1000 + i, 1000 + i))
    (runs / "empty").mkdir()
    first = read_catalogue(runs, at_most=2)
    assert {entry.folder for entry in first.entries} == {"c", "d"}
    assert {entry.folder for entry in read_catalogue(runs, at_most=1).entries} == {"b", "c", "d"}


def test_two_processes_at_once(make_run: Callable[..., Path], runs: Path) -> None:
    for i in range(20):
        make_run(f"run-{i}")
    code = (
        "import sys; from pathlib import Path; from bench.catalogue.catalogue import read_catalogue\n"
        "for i in range(10):\n"
        "    found = read_catalogue(Path(sys.argv[1]), rebuild=True)\n"
        "    assert len(found.entries) == 20 and not found.problem, found.problem\n"
    )
    both = [
        subprocess.Popen([sys.executable, "-c", code, str(runs)], stderr=subprocess.PIPE, text=True) for _ in "ab"
    ]
    for process in both:
        _, error = process.communicate(timeout=60)
        assert process.returncode == 0, error
    assert read_catalogue(runs).read == 0


def test_an_index_that_another_process_is_making_is_waited_for(make_run: Callable[..., Path], runs: Path) -> None:
    make_run("run-0")
    other = sqlite3.connect(runs / INDEX_FILE, isolation_level=None, check_same_thread=False)
    other.execute("BEGIN IMMEDIATE")
    release = threading.Timer(0.3, lambda: other.execute("COMMIT"))
    release.start()
    try:
        found = read_catalogue(runs)
    finally:
        release.join()
        other.close()
    assert found.problem == ""
    assert len(found.entries) == 1
    assert read_catalogue(runs).read == 0


_VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)
_KEYS = st.sampled_from(["id", "created", "title", "sensor", "protocol", "station", "seed", "roi"])


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(changes=st.dictionaries(_KEYS, _VALUES, max_size=4), journal=st.lists(_VALUES, max_size=4))
def test_whatever_a_run_says_it_can_be_listed(tmp_path: Path, changes: dict[str, Any], journal: list[Any]) -> None:
    import json

    import yaml

    from bench.catalogue.telling import runs_text

    folder = tmp_path / "runs" / "a"
    (folder / "points").mkdir(parents=True, exist_ok=True)
    content = {"format": "evs-bench-run/1", "sensor": {"name": "s", "width": 1, "height": 1}, "id": "x", **changes}
    content.setdefault("roi", {"x": 0, "y": 0, "width": 1, "height": 1})
    (folder / "run.yaml").write_text(yaml.safe_dump(content))
    (folder / "journal.jsonl").write_text("".join(json.dumps(line) + "\n" for line in journal))
    entry = summarize(folder)
    assert "\n" not in entry.problem + entry.title + entry.station
    catalogue = read_catalogue(folder.parent, rebuild=True)
    assert catalogue.problem == ""
    assert runs_text(catalogue.entries, 80)
