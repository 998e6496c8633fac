"""`evs-bench notify-test`: each notice, and what became of it."""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING

import pytest

from bench import cli

if TYPE_CHECKING:
    from pathlib import Path

SCRIPT = "import os, sys; open(sys.argv[1], 'a').write(os.environ['EVS_BENCH_TEXT'] + chr(10))"


@pytest.fixture(name="file")
def notices_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setitem(cli._COMMANDS, "notify-test", "Try the notices.")
    monkeypatch.setitem(cli._MODULES, "notify-test", "notify_test")
    monkeypatch.delenv("EVS_BENCH_NOTIFY", raising=False)
    arguments = json.dumps([sys.executable, "-c", SCRIPT, str(tmp_path / "told.txt")])
    path = tmp_path / "notices.yaml"
    path.write_text(
        "format: evs-bench-notices/1\nnotices:\n"
        f"  - {{kind: command, arguments: {arguments}, on: [end, failure]}}\n"
        "  - {kind: command, arguments: [./missing], on: [paused]}\n"
    )
    return path


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    code = cli.run(["notify-test", *arguments])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


def test_it_says_what_left_and_what_did_not(file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, err = run(capsys, str(file))
    assert code == 1
    rows = out.splitlines()
    assert [row.split()[3] for row in rows[1:]] == ["sent", "sent", "NOT"]
    assert rows[3].endswith("NOT SENT: cannot be started: No such file or directory")
    assert err.endswith("1 of 3 notices did not leave\n")
    told = (tmp_path / "told.txt").read_text().splitlines()
    assert told[1] == "[test] EVS bench: a trial of the notices failed: nothing happened, this is a test"


def test_the_environment_names_the_file(
    file: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    file.write_text("\n".join(file.read_text().splitlines()[:-1]) + "\n")
    monkeypatch.setenv("EVS_BENCH_NOTIFY", str(file))
    code, out, _ = run(capsys, "--json")
    assert code == 0
    assert [(o["kind"], o["sent"], o["reason"]) for o in json.loads(out)["notices"]] == [
        ("end", True, None), ("failure", True, None),
    ]  # fmt: skip


def test_without_a_file_it_says_what_is_missing(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, _, err = run(capsys)
    assert code == 1
    assert "name a FILE of notices, or set EVS_BENCH_NOTIFY" in err
