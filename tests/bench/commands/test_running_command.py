"""Steps of an operator on the command line, and who is told of a run that is taken there."""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING, Any

import click
import pytest

from bench.cli import run

if TYPE_CHECKING:
    from pathlib import Path

PROTOCOL = """\
format: evs-bench-protocol/1
title: the cap on
roi: {x: 10, y: 20, width: 2, height: 2}
measurements:
  - name: dark
    stimulus: {kind: constant, duration_s: 0.1}
    sweep: {illuminance_lux: [100]}
    operator: {before: Put the lens cap on.}
"""


@pytest.fixture(name="arguments")
def run_arguments(tmp_path: Path) -> list[str]:
    (tmp_path / "cap.yaml").write_text(PROTOCOL)
    return ["run", str(tmp_path / "cap.yaml"), "--out", str(tmp_path / "run")]


def test_without_a_terminal_a_step_is_refused_before_anything_is_taken(
    arguments: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(arguments) == 1
    error = capsys.readouterr().err
    assert "dark: somebody has to do this first: 'Put the lens cap on.'" in error
    assert "--operator-steps assume" in error
    assert not (tmp_path / "run").exists()


def test_a_step_is_taken_as_done_where_that_is_asked_for(
    arguments: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run([*arguments, "--operator-steps", "assume"]) == 0
    assert "operator step, taken as done: Put the lens cap on." in capsys.readouterr().err
    assert "operator step taken as done" in (tmp_path / "run/evs-bench.log").read_text()
    again = ["rerun", str(tmp_path / "run"), "--out", str(tmp_path / "again")]
    assert run(again) == 1
    assert run([*again, "--operator-steps", "assume"]) == 0


def test_ctrl_c_at_the_prompt_ends_the_run(
    arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def prompt(*_: Any, **__: Any) -> str:
        raise click.Abort

    monkeypatch.setattr("bench.commands.running.interactive", lambda: True)
    monkeypatch.setattr(click, "prompt", prompt)
    assert run(arguments) == 130
    last = json.loads((tmp_path / "run/journal.jsonl").read_text().splitlines()[-1])
    assert (last["state"], last["reason"]) == ("run_aborted", "stopped at once by the operator")
    assert "Traceback" not in (tmp_path / "run/evs-bench.log").read_text()


TELL = "import os, sys; open(sys.argv[1], 'a').write(os.environ['EVS_BENCH_TEXT'] + chr(10))"


@pytest.fixture(name="notices")
def notices_file(tmp_path: Path) -> Path:
    script = json.dumps([sys.executable, "-c", TELL, str(tmp_path / "told.txt")])
    path = tmp_path / "notices.yaml"
    path.write_text(
        f"format: evs-bench-notices/1\nnotices:\n  - {{kind: command, arguments: {script}, on: [end, failure]}}\n"
    )
    return path


def test_run_resume_and_rerun_tell_that_they_ended(arguments: list[str], notices: Path, tmp_path: Path) -> None:
    again = ["rerun", str(tmp_path / "run"), "--out", str(tmp_path / "again")]
    for command in (arguments, ["resume", str(tmp_path / "run")], again):
        assert run([*command, "--operator-steps", "assume", "--notify", str(notices)]) == 0
    told = (tmp_path / "told.txt").read_text().splitlines()
    folders = [tmp_path / "run", tmp_path / "run", tmp_path / "again"]
    assert told == [f"EVS bench: the cap on ended: done: 1 of 1 points, in {folder}" for folder in folders]


def test_a_rerun_that_fails_is_told(arguments: list[str], notices: Path, tmp_path: Path) -> None:
    assert run([*arguments, "--operator-steps", "assume"]) == 0
    (tmp_path / "there").touch()
    again = ["rerun", str(tmp_path / "run"), "--out", str(tmp_path / "there"), "--notify", str(notices)]
    assert run([*again, "--operator-steps", "assume"]) == 1
    (told,) = (tmp_path / "told.txt").read_text().splitlines()
    assert told.startswith("EVS bench: the cap on failed: ")
    assert str(tmp_path / "there") in told
