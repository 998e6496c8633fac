"""Whether a run is being written is seen without taking its lock."""

from __future__ import annotations

import os
import threading
from typing import TYPE_CHECKING, Any

import pytest

from bench.store import writer_lock
from bench.store.writer_lock import is_written

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

pytestmark = pytest.mark.skipif(not writer_lock._LOCKS.exists(), reason="the kernel lists no locks here")


@pytest.fixture
def journal(tmp_path: Path) -> Path:
    path = tmp_path / "journal.jsonl"
    path.touch()
    return path


def test_a_lock_of_another_process_is_seen(journal: Path, held_by_another: Callable[[Path], Any]) -> None:
    assert is_written(journal) is False
    with held_by_another(journal):
        assert is_written(journal) is True
    assert is_written(journal) is False


def test_a_file_on_a_numbered_otherwise_disk_is_known_by_who_has_it_open(
    journal: Path, tmp_path: Path, held_by_another: Callable[[Path], Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    with held_by_another(journal):
        listed = writer_lock._LOCKS.read_text()
        device = f"{os.major(journal.stat().st_dev):02x}:{os.minor(journal.stat().st_dev):02x}"
        table = tmp_path / "locks"
        table.write_text(listed.replace(device, "00:ff"))
        monkeypatch.setattr(writer_lock, "_LOCKS", table)
        assert is_written(journal) is True


def test_looking_never_keeps_a_writer_out(journal: Path, lockable: Callable[[Path], bool]) -> None:
    over = threading.Event()

    def look() -> None:
        while not over.is_set():
            is_written(journal)

    looker = threading.Thread(target=look)
    looker.start()
    try:
        assert all(lockable(journal) for _ in range(2000))
    finally:
        over.set()
        looker.join()


def test_what_cannot_be_told_is_not_told(journal: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(writer_lock, "_LOCKS", tmp_path / "missing")
    assert is_written(journal) is None
    monkeypatch.undo()
    number = f"{os.major(journal.stat().st_dev)}:{os.minor(journal.stat().st_dev)}"
    mounts = tmp_path / "mountinfo"
    mounts.write_text(f"27 1 {number} / / rw - nfs4 server:/runs rw\n")
    monkeypatch.setattr(writer_lock, "_MOUNTS", mounts)
    assert is_written(journal) is None
    assert is_written(tmp_path / "no journal") is None
