"""`evs-bench queue`: the timetable, the night, the morning after."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import pytest

from bench import cli
from bench.queueing import taking
from drivers.errors import DeviceError

if TYPE_CHECKING:
    from pathlib import Path

PROTOCOL = """\
format: evs-bench-protocol/1
title: two levels
seed: 1
roi: {x: 632, y: 352, width: 4, height: 4}
measurements:
  - name: light
    stimulus: {kind: constant, duration_s: 1}
    sweep: {illuminance_lux: [1, 100]}
"""
QUEUE = """\
format: evs-bench-queue/1
title: night
reference: {protocol: levels.yaml, every: 1}
entries:
  - {protocol: levels.yaml, name: first, warm_up: {minutes: 10}}
"""


@pytest.fixture(name="file")
def queue_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setitem(cli._COMMANDS, "queue", "Run several protocols.")
    monkeypatch.delenv("EVS_BENCH_NOTIFY", raising=False)
    (tmp_path / "levels.yaml").write_text(PROTOCOL)
    (tmp_path / "night.yaml").write_text(QUEUE)
    return str(tmp_path / "night.yaml")


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    code = cli.run(["queue", *arguments])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


def test_a_dry_run_prints_the_timetable_and_makes_nothing(
    file: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = sorted(tmp_path.iterdir())
    code, out, err = run(capsys, file, "--dry-run")
    lines = out.splitlines()
    assert code == 0
    assert lines[0].split() == ["run", "name", "protocol", "station", "points", "takes", "begins", "ends"]
    assert lines[1].split()[:5] == ["1", "reference", "levels.yaml", "simulated", "2"]
    assert lines[1].endswith("warm-up, 10 min at most")
    assert lines[-1].startswith("3 runs, 10 min at most, until 20")
    assert "starting the instruments" in err
    code, out, _ = run(capsys, file, "--dry-run", "--json")
    plan = json.loads(out)
    assert [entry["name"] for entry in plan["runs"]] == ["reference", "first", "reference"]
    assert plan["runs"][0]["warm_up_s"] == 600.0
    assert sorted(tmp_path.iterdir()) == before


def test_a_night_ends_with_its_runs_and_the_drift(
    file: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, err = run(capsys, file, "--out", str(tmp_path / "out"))
    assert code == 0
    assert [line.split()[:3] for line in out.splitlines()[1:4]] == [
        ["1", "reference", "done"], ["2", "first", "done"], ["3", "reference", "done"],
    ]  # fmt: skip
    assert "ON background at 100 lux" in out
    assert "run 2 of 3: levels.yaml on simulated\n" in err
    assert err.endswith(f"3 of 3 runs done; everything is in {tmp_path / 'out'}\n")
    code, out, err = run(capsys, "--resume", str(tmp_path / "out"), "--json")
    summary = json.loads(out)
    assert (code, summary["left"], summary["stopped"]) == (0, 0, False)
    assert [entry["state"] for entry in summary["runs"]] == ["done"] * 3
    assert "run 1 of 3" not in err
    assert run(capsys, "--resume", str(tmp_path / "out"), "--dry-run")[2] == "all runs of this queue are done\n"


@pytest.mark.parametrize(
    ("error", "code"), [(DeviceError("camera", "start", "unplugged"), 2), (ZeroDivisionError("oops"), 70)]
)
def test_the_exit_code_says_what_failed(
    file: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    error: Exception,
    code: int,
) -> None:
    def fail(*_: Any, **__: Any) -> None:
        raise error

    monkeypatch.setattr(taking, "run_protocol", fail)
    found, out, err = run(capsys, file, "--out", str(tmp_path / "out"))
    assert found == code
    assert out.count("failed") == 3
    assert f"go on with: evs-bench queue --resume {tmp_path / 'out'}" in err


def test_stopping_at_once_is_one_line_and_130(
    file: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(taking, "run_protocol", stop)
    code, _, err = run(capsys, file, "--out", str(tmp_path / "out"))
    assert code == 130
    assert err.splitlines()[-1].endswith(f"go on with: evs-bench queue --resume {tmp_path / 'out'}")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((), "name a queue FILE, or a folder with --resume"),
        (("--resume", "x", "--out", "y"), "leave out --station and --out"),
        (("--resume", "x"), "x: this is no queue, it has no queue.jsonl"),
        (("missing.yaml",), "missing.yaml: cannot be read: No such file or directory"),
    ],
)
def test_wrong_usage_is_one_line(
    file: str, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], said: str
) -> None:
    code, _, err = run(capsys, *arguments)
    assert (code, len(err.splitlines())) == (1, 1)
    assert said in err


def test_a_bad_file_of_notices_is_said_before_anything_begins(
    file: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "n.yaml").write_text("format: evs-bench-notices/1\nnotices: []\n")
    code, _, err = run(capsys, file, "--out", str(tmp_path / "out"), "--notify", str(tmp_path / "n.yaml"))
    assert code == 1
    assert "n.yaml:2:10: notices: must have at least 1 item" in err
    assert not (tmp_path / "out").exists()
