"""A folder that cannot be written: from the start, or from some moment of a run on."""

from __future__ import annotations

import errno
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from failing_disk import FailingDisk, is_as, short_protocol  # type: ignore[import-not-found]

from bench.cli import run as command
from bench.run import resume, run_protocol
from bench.station import load_station
from bench.store import Run, RunError
from bench.store.point_writer import cannot_write

_FOR_EVER = 10**9
_WORDS = "could not be written: Read-only file system; let it be written, or choose another folder"


def _read_only(folder: Path, at: int) -> FailingDisk:
    return FailingDisk(folder, errno.EROFS, at, _FOR_EVER)


def test_a_run_is_not_begun_in_a_folder_that_cannot_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    protocol = tmp_path / "short.yaml"
    protocol.write_text(short_protocol().text)
    with _read_only(tmp_path, 1).used(monkeypatch):
        assert command(["run", str(protocol), "--out", str(tmp_path / "run")]) == 1
    said = capsys.readouterr().err.splitlines()
    assert said[-1] == f"evs-bench: {tmp_path / 'run'}: {_WORDS}"
    assert not (tmp_path / "run").exists()
    assert len([line for line in said if line.startswith("evs-bench: ")]) == 1


def test_a_run_that_is_read_only_is_read_and_not_gone_on_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "run"
    run_protocol(short_protocol(), load_station("simulated"), folder)
    before = {path.name: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    with _read_only(tmp_path, 1).used(monkeypatch):
        assert command(["resume", str(folder)]) == 1
        assert f"evs-bench: {folder / 'journal.jsonl'}: {_WORDS}" in capsys.readouterr().err.splitlines()
        assert command(["runs", str(tmp_path)]) == 0
        assert "finished" in capsys.readouterr().out
    assert {path.name: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before


def test_a_folder_that_becomes_read_only_ends_the_run_dark_and_resumable(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run_protocol(short_protocol(), load_station("simulated"), tmp_path / "whole")
    counting = FailingDisk(tmp_path, errno.EROFS, None, 0)
    with counting.used(monkeypatch):
        run_protocol(short_protocol(), load_station("simulated"), tmp_path / "counted")
    first: dict[str, int] = {}
    for at, call in enumerate(counting.calls, 1):
        first.setdefault(call, at)
    moments = [at for call, at in first.items() if at > first["write evs-bench.log"]][::3]
    assert len(moments) > 3
    for at in moments:
        folder, station = tmp_path / f"run{at}", load_station("simulated")
        with _read_only(tmp_path, at).used(monkeypatch), pytest.raises(RunError, match="Read-only file system"):
            run_protocol(short_protocol(), station, folder)
        assert station.light._world.level == 0.0  # type: ignore[attr-defined]
        Run.open(folder).verify()
        resume(folder)
        is_as(folder, tmp_path / "whole")
        assert not list(folder.rglob("*.part"))


@pytest.mark.parametrize(
    ("number", "advice"),
    [
        (errno.ENOSPC, "make room on this disk"),
        (errno.EROFS, "let it be written, or choose another folder"),
        (errno.EACCES, "let it be written, or choose another folder"),
        (errno.EIO, "the disk fails: look at it before you go on"),
    ],
)
def test_what_cannot_be_written_is_told_with_what_to_do(tmp_path: Path, number: int, advice: str) -> None:
    line = str(cannot_write(tmp_path / "x", OSError(number, "why")))
    assert line == f"{tmp_path / 'x'}: could not be written: why; {advice}"


def test_what_nothing_is_known_of_is_told_as_it_came(tmp_path: Path) -> None:
    assert str(cannot_write(tmp_path / "x", OSError("odd"))) == f"{tmp_path / 'x'}: could not be written: odd"
