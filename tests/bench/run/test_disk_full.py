"""A disk that is full, at any moment of a run: one line, nothing that was done is lost, and the run goes on later."""

from __future__ import annotations

import errno
import os
import resource
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from failing_disk import FailingDisk, is_as, short_protocol  # type: ignore[import-not-found]
from night_devices import Telling  # type: ignore[import-not-found]

from bench.catalogue.catalogue import read_catalogue
from bench.cli import run as command
from bench.run import resume, run_protocol
from bench.run.stop import StopFlag
from bench.station import load_station
from bench.store import Run, RunError
from bench.store.durable import replace_file
from bench.store.journal import read_journal, whole_length
from protocols import parse_protocol

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bench.station import Station

_FOR_EVER = 10**9
_EVERY = 15  #: of the many equal writes of HDF5 into one file, every so-many-th is tried


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the undisturbed run."""
    folder = tmp_path_factory.mktemp("whole") / "run"
    run_protocol(short_protocol(), load_station("simulated"), folder)
    return folder


def _calls(folder: Path) -> list[str]:
    """Return what an undisturbed run asks of the disk."""
    disk = FailingDisk(folder, errno.ENOSPC, None, 0)
    with pytest.MonkeyPatch.context() as patch, disk.used(patch):
        run_protocol(short_protocol(), load_station("simulated"), folder / "run")
    shutil.rmtree(folder / "run")
    calls: list[str] = disk.calls
    return calls


def _moments(calls: list[str]) -> Iterator[int]:
    for number, call in enumerate(calls, 1):
        if not call.endswith(".h5.part") or not call.startswith("write") or number % _EVERY == 0:
            yield number


def _take_on(disk: FailingDisk, station: Station, folder: Path) -> str:
    """Take the run on this disk, and return the line with which it ended; empty if it came to its end."""
    with pytest.MonkeyPatch.context() as patch, disk.used(patch):
        try:
            run_protocol(short_protocol(), station, folder)
        except RunError as error:
            return str(error)
    return ""


def _is_sound(folder: Path) -> dict[int, str | None]:
    """Return the checksums of what is done, all of which is there; nothing half-written is left."""
    run = Run.open(folder)
    run.verify()
    assert not list(folder.rglob("*.part*"))
    assert not list(folder.rglob("*.tmp"))
    return {int(file.path.name[:6]): file.sha256 for file in run.files}


def _try(at: int, lasts: int, tmp_path: Path, whole: Path) -> None:
    """Take a run on a disk that is full from the so-many-th call on, and go on with it when there is room again."""
    folder = tmp_path / "run"
    disk, station = FailingDisk(tmp_path, errno.ENOSPC, at, lasts), load_station("simulated")
    line = _take_on(disk, station, folder)
    assert disk.failed, at
    if all(call.endswith("evs-bench.log") for call in disk.failed):
        assert not line  # the log is not worth a night
    else:
        assert "could not be written: No space left on device; make room on this disk" in line, disk.failed[:1]
        assert "\n" not in line
    assert station.light._world.level == 0.0  # type: ignore[attr-defined]
    if not folder.exists():
        return  # it was not begun: there is nothing to go on with, and nothing in the way of the next try
    done = _is_sound(folder)
    assert read_catalogue(tmp_path).entries[0].done == len(done)
    resume(folder)
    is_as(folder, whole)
    now = _is_sound(folder)
    assert {index: now[index] for index in done} == done, disk.failed[:1]
    shutil.rmtree(folder)


def test_a_disk_may_be_full_at_many_moments(whole: Path, tmp_path: Path) -> None:
    first: dict[str, int] = {}
    for at in range(1, len(calls := _calls(tmp_path)) + 1):
        first.setdefault(calls[at - 1], at)
    assert len(first) > 15  # each kind of call, into each file
    for number, at in enumerate(first.values()):
        _try(at, (1, _FOR_EVER)[number % 2], tmp_path, whole)


@pytest.mark.slow
@pytest.mark.parametrize("lasts", [1, 2, _FOR_EVER])
def test_a_disk_may_be_full_at_every_moment(whole: Path, tmp_path: Path, lasts: int) -> None:
    for at in _moments(_calls(tmp_path)):
        _try(at, lasts, tmp_path, whole)


def test_what_is_written_after_half_a_line_stands_in_a_line_of_its_own(whole: Path, tmp_path: Path) -> None:
    # The disk takes half of a "done" line, then has room again for the lines that say how the run ended.
    done = [n for n, call in enumerate(_calls(tmp_path), 1) if call == "write journal.jsonl"][3]
    line = _take_on(FailingDisk(tmp_path, errno.ENOSPC, done, 1), load_station("simulated"), tmp_path / "run")
    assert "journal.jsonl" in line
    states = [entry.state for entry in read_journal(tmp_path / "run/journal.jsonl")]
    assert states[-2:] == ["failed", "run_aborted"]
    resume(tmp_path / "run")
    is_as(tmp_path / "run", whole)


def test_a_journal_that_an_older_version_left_torn_can_be_gone_on_with(whole: Path, tmp_path: Path) -> None:
    shutil.copytree(whole, tmp_path / "run")
    file = tmp_path / "run/journal.jsonl"
    lines = file.read_bytes().splitlines(keepends=True)
    torn = lines[-2][:40] + lines[-1]
    file.write_bytes(b"".join([*lines[:-2], torn]))
    resume(tmp_path / "run")
    is_as(tmp_path / "run", whole)
    assert torn not in file.read_bytes()


@pytest.mark.parametrize(
    ("content", "length"),
    [
        (b"", 0),
        (b'{"state": "started"', 0),
        (b'{"state": "started"}\n', 21),
        (b'{"state": "started"}\n{"sta', 21),
        (b'{"state": "started"}\n{"sta{"state": "done"}\n', 21),
        (b'{"state": "started"}\n{"sta\n{"state', 21),
        (b"torn\n", 0),
    ],
)
def test_a_journal_is_whole_up_to_its_last_line_that_can_be_read(content: bytes, length: int) -> None:
    assert whole_length(content) == length


class _Stopping(Telling):  # type: ignore[misc]
    """Stops the run as soon as it is paused."""

    def __init__(self, stop: StopFlag) -> None:
        super().__init__()
        self._wish = stop

    def message(self, text: str) -> None:
        super().message(text)
        if text.startswith("paused"):
            self._wish.request()


def test_a_run_that_waited_for_room_for_too_long_says_so_when_it_is_paused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("shutil.disk_usage", lambda _: SimpleNamespace(free=5 << 20))
    wait = "suspend: {disk_free_mib: 200, give_up_after_s: 100, then: pause}"
    text = short_protocol().text.replace("suspend: {disk_free_mib: null}", wait)
    stop = StopFlag()
    told = _Stopping(stop)
    result = run_protocol(
        parse_protocol(text, "short.yaml"), load_station("simulated"), tmp_path / "run", stop=stop, progress=told
    )
    assert result.stopped
    why = f"given up: the disk of {tmp_path / 'run'} has 5 MiB free, 210 MiB are wanted"
    paused = [entry.reason or "" for entry in read_journal(tmp_path / "run/journal.jsonl") if entry.state == "paused"]
    assert [reason.endswith(why) for reason in paused] == [True]
    assert f"go on with: evs-bench continue {tmp_path / 'run'}" in told.text


def test_a_run_that_cannot_be_begun_leaves_nothing(tmp_path: Path) -> None:
    first = next(n for n, call in enumerate(_calls(tmp_path), 1) if "evs-bench.log" in call)
    for at in range(1, first):
        _take_on(FailingDisk(tmp_path, errno.ENOSPC, at, 1), load_station("simulated"), tmp_path / "run")
        assert list(tmp_path.iterdir()) == []


def test_the_command_ends_with_one_line_and_goes_on_later(
    whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # A real limit of the system on the size of a file; a full disk answers in the same places.
    protocol, folder = tmp_path / "short.yaml", tmp_path / "run"
    protocol.write_text(short_protocol().text)

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (30_000, 30_000))

    done = subprocess.run(
        [sys.executable, "-m", "bench", "run", str(protocol), "--out", str(folder)],
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=limit,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(path or "." for path in sys.path)},
    )
    assert done.returncode == 1, done.stderr
    said = [line for line in done.stderr.splitlines() if line.startswith("evs-bench: ")]
    wanted = "points/000000.h5: could not be written: File too large; this disk, or your account, takes no file of"
    assert len(said) == 1
    assert wanted in said[0]
    assert f"go on with: evs-bench resume {folder}" in done.stderr
    assert "Traceback" not in done.stderr
    assert command(["resume", str(folder)]) == 0, capsys.readouterr().err
    is_as(folder, whole)


def test_a_result_that_a_full_disk_does_not_take_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # Open, then write: the system names no file for the latter.
    with (
        FailingDisk(tmp_path, errno.ENOSPC, 2, 1).used(monkeypatch),
        pytest.raises(OSError, match="No space") as told,
    ):
        replace_file(tmp_path / "curves.csv", b"a,b\n")
    assert told.value.filename == str(tmp_path / "curves.csv")
    assert list(tmp_path.iterdir()) == []
