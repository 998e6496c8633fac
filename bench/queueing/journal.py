"""``queue.jsonl``: what became of each run of a queue, one line each, on disk before the next step is taken."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Self

from bench.store.durable import lock_file, sync_folder
from bench.store.journal import read_journal
from bench.store.writer import utc_now
from protocols.errors import InputError

if TYPE_CHECKING:
    from pathlib import Path

    from bench.store.journal import JournalEntry

__all__ = ["JOURNAL_FILE", "JOURNAL_FORMAT", "QUEUE_FILE", "Past", "QueueJournal", "read_past"]

JOURNAL_FILE: Final = "queue.jsonl"
JOURNAL_FORMAT: Final = "evs-bench-queue-journal/1"
QUEUE_FILE: Final = "queue.yaml"
_OUTCOMES: Final = ("run_done", "run_failed", "run_suspended", "run_stopped")


@dataclass(frozen=True, slots=True)
class Past:
    """What the journal of a queue tells."""

    asked: dict[str, Any]  #: what :func:`bench.queueing.loading.restored_queue` takes
    outcomes: dict[int, dict[str, Any]]  #: the last line about each run that came to some end
    begun: frozenset[int]  #: runs that were begun

    @property
    def done(self) -> frozenset[int]:
        """The runs that are done."""
        return frozenset(n for n, line in self.outcomes.items() if line["state"] == "run_done")


def read_past(folder: Path) -> Past:
    """Return what happened so far to the queue in `folder`; a torn last line is ignored.

    Raises
    ------
    InputError
        If there is no queue, or its journal is damaged.
    """
    path = folder / JOURNAL_FILE
    if not path.exists():
        raise InputError(f"{folder}: this is no queue, it has no {JOURNAL_FILE}")
    entries = read_journal(path)
    if not entries or entries[0].state != "queue_started" or entries[0].everything.get("format") != JOURNAL_FORMAT:
        raise InputError(f"{path}:1:1: expected a line with the state queue_started and the format {JOURNAL_FORMAT}")
    outcomes = {_number(e): e.everything for e in entries if e.state in _OUTCOMES}
    begun = frozenset(_number(e) for e in entries if e.state == "run_started")
    return Past(entries[0].everything, outcomes, begun)


def _number(entry: JournalEntry) -> int:
    return int(entry.everything.get("run", 0))


class QueueJournal:
    """Appends to the journal of a queue; one process at a time does.

    Parameters
    ----------
    folder
        The folder of the queue, which is there.

    Raises
    ------
    InputError
        If the journal cannot be written, or another process writes it.
    """

    def __init__(self, folder: Path) -> None:
        self._path = folder / JOURNAL_FILE
        try:
            self._file = self._path.open("a+b", buffering=0)
        except OSError as error:
            raise self._cannot(error) from error
        try:
            lock_file(self._file.fileno())
            self._cut_torn_line()
            sync_folder(folder)
        except BlockingIOError:
            self.close()
            raise InputError(f"{folder}: another process is working through this queue") from None
        except OSError as error:
            self.close()
            raise self._cannot(error) from error

    def __enter__(self) -> Self:
        """Return the journal itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the journal."""
        self.close()

    def close(self) -> None:
        """Close the file, and let others write it."""
        self._file.close()

    def note(self, state: str, **more: Any) -> None:
        """Append a line, and return when it is on disk."""
        line = json.dumps({"t": utc_now(), "state": state, **more}, ensure_ascii=False) + "\n"
        data = memoryview(line.encode("utf-8", "replace"))
        try:
            while data:
                data = data[self._file.write(data) :]
            os.fsync(self._file.fileno())
        except OSError as error:
            raise self._cannot(error) from error

    def _cut_torn_line(self) -> None:
        self._file.truncate(self._path.read_bytes().rfind(b"\n") + 1)

    def _cannot(self, error: OSError) -> InputError:
        return InputError(f"{self._path}: cannot be written: {error.strerror or error}")
