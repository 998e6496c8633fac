"""`evs-bench runs`: the table, JSON, filters, and what it says of folders that are no runs."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest
from click.testing import CliRunner, Result

from bench.commands.runs import command

if TYPE_CHECKING:
    from pathlib import Path

RUN = """\
format: evs-bench-run/1
id: 2026-11-20T21-00-00.000Z-{name}
created: 2026-11-{day}T12:00:00Z
sensor: {{name: {sensor}, width: 8, height: 8}}
roi: {{x: 0, y: 0, width: 4, height: 4}}
"""


@pytest.fixture(name="runs")
def three_runs(tmp_path: Path) -> Path:
    for name, day, sensor in (("a", 20, "IMX636"), ("b", 22, "IMX636"), ("c", 21, "GenX320")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "run.yaml").write_text(RUN.format(name=name, day=day, sensor=sensor))
    (tmp_path / "notes").mkdir()
    return tmp_path


def _list(folder: Path, *options: str) -> Result:
    return CliRunner().invoke(command, [str(folder), *options], catch_exceptions=False, standalone_mode=False)


def _names(folder: Path, *options: str) -> list[str]:
    return [run["folder"] for run in json.loads(_list(folder, "--json", *options).stdout)["runs"]]


def test_a_table_newest_first(runs: Path) -> None:
    done = _list(runs)
    assert done.return_value == 0
    lines = done.stdout.splitlines()
    assert [line.split()[2] for line in lines[2:5]] == ["b", "c", "a"]
    assert lines[-1] == "notes: this is no run, it has no run.yaml"
    assert done.stderr == f"3 runs in {runs}\n"


def test_what_is_asked_for(runs: Path) -> None:
    assert _names(runs) == ["b", "c", "a", "notes"]
    assert _names(runs, "--sensor", "imx") == ["b", "a"]
    assert _names(runs, "--since", "2026-11-21T00:00Z") == ["b", "c"]
    assert _names(runs, "--until", "2026-11-21T18:00Z", "--since", "2026-11-21T00:00Z") == ["c"]
    assert _names(runs, "--state", "aborted") == []
    assert _list(runs, "--protocol", "b").stderr == f"1 of 3 runs in {runs}\n"


def test_an_index_in_the_way_is_told(runs: Path) -> None:
    (runs / ".evs-bench-runs.sqlite").write_bytes(b"no database at all" * 1000)
    done = _list(runs)
    assert done.return_value == 0
    assert "was damaged" in done.stderr
    assert _list(runs, "--rebuild").stderr == f"3 runs in {runs}\n"


def test_an_empty_folder(tmp_path: Path) -> None:
    done = _list(tmp_path)
    assert (done.stdout, done.stderr) == ("", f"0 runs in {tmp_path}\n")
