"""The journal of a run that grows: each line is read once."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

from bench.store.journal import JournalEntry, entry_of

if TYPE_CHECKING:
    from pathlib import Path

__all__ = ["JournalTail"]


class JournalTail:
    """Reads what was added to a journal since the last time.

    A line without its end is being written, and is left for the next time. A damaged line is left out and counted:
    the page of a run must not end because of it.

    Parameters
    ----------
    path
        The journal; it need not be there yet.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._inode = 0
        self._times_over = 0
        self._start_over()

    def _start_over(self) -> None:
        self._times_over += 1
        self._read = 0
        self._lines = 0
        self.entries: list[JournalEntry] = []  #: all that were read, oldest first
        self.damaged: list[int] = []  #: numbers of the lines that are none, from 1
        self.exists = False

    @property
    def stamp(self) -> tuple[int, int, bool]:
        """What differs whenever something was read, or the journal went away."""
        return self._times_over, self._read, self.exists

    def read(self) -> bool:
        """Take in what was added, and return whether anything changed.

        A journal that became shorter, or is another file, is read from its beginning.

        Raises
        ------
        OSError
            If the journal is there and cannot be read.
        """
        before = self.stamp
        try:
            with self._path.open("rb") as file:
                self._take_from(file)
        except FileNotFoundError:
            if self.exists:
                self._start_over()
        return self.stamp != before

    def _take_from(self, file: Any) -> None:
        status = os.fstat(file.fileno())
        if status.st_ino != self._inode or status.st_size < self._read:
            self._start_over()
        self._inode, self.exists = status.st_ino, True
        file.seek(self._read)
        whole, end, _ = file.read().rpartition(b"\n")
        for line in whole.split(b"\n") if end else ():
            self._take(line)
        self._read += len(whole) + len(end)

    def _take(self, line: bytes) -> None:
        self._lines += 1
        if not line.strip():
            return
        entry = entry_of(line)
        if entry is None or not _is_sound(entry):
            self.damaged.append(self._lines)
        else:
            self.entries.append(entry)


def _is_sound(entry: JournalEntry) -> bool:
    """Return whether point and attempt are numbers that can be."""
    return (entry.point is None or _is_count(entry.point)) and _is_count(entry.attempt)


def _is_count(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 0
