"""The journal of a run that this process writes: locked, each line on disk as a whole or not at all."""

from __future__ import annotations

import contextlib
import os
import time
from typing import TYPE_CHECKING, Any, Final

from bench.store.durable import lock_file
from bench.store.errors import RunError
from bench.store.journal import whole_length
from bench.store.point_writer import cannot_write

if TYPE_CHECKING:
    from pathlib import Path

__all__ = ["JournalFile"]

#: So long a lock is waited for: somebody may only be looking whether there is one.
_LOCK_S: Final = 1.0


class JournalFile:
    """A journal that is open for the whole run, and locked. Making it raises OSError like any other file.

    Parameters
    ----------
    path
        Of the journal.
    new
        Whether it is made; else one is gone on with, and a torn last line is removed.

    Raises
    ------
    BlockingIOError
        If another process has it locked.
    """

    def __init__(self, path: Path, *, new: bool) -> None:
        self._path = path
        self._whole = 0  # length to the end of the last whole line, bytes
        self._file: Any = path.open("x+b" if new else "r+b", buffering=0)
        try:
            self._lock()
            if not new:
                self._whole = whole_length(path.read_bytes())
                self._cut()
        except BaseException:
            self._file.close()
            raise

    def close(self) -> None:
        """Close it, and let others have it."""
        self._file.close()

    def append(self, text: str) -> None:
        """Add whole lines, and return when they are on disk; where that fails there is nothing of them.

        Raises
        ------
        RunError
            If they cannot be written.
        """
        data = text.encode()
        try:
            self._cut()
            rest = memoryview(data)
            while rest:
                rest = rest[self._file.write(rest) :]
            os.fsync(self._file.fileno())
        except OSError as error:
            with contextlib.suppress(OSError):
                self._cut()
            raise cannot_write(self._path, error) from error
        self._whole += len(data)

    def require_place(self) -> None:
        """Raise :class:`RunError` where the folder is not where it was: lines would go where nobody looks."""
        try:
            there = os.path.samestat(self._path.stat(), os.fstat(self._file.fileno()))
        except FileNotFoundError as error:
            raise cannot_write(self._path, error) from error
        except OSError:
            return  # it cannot be looked at: writing tells
        if not there:
            raise RunError(f"{self._path}: another file is in its place; put back the run folder that was here")

    def _cut(self) -> None:
        """Take away what is behind the last whole line: a full disk may have taken a part of one."""
        self._file.truncate(self._whole)
        self._file.seek(self._whole)

    def _lock(self) -> None:
        until = time.monotonic() + _LOCK_S
        while True:
            try:
                lock_file(self._file.fileno())
            except BlockingIOError:
                if time.monotonic() > until:
                    raise
                time.sleep(_LOCK_S / 20)
            else:
                return
