"""Looking at a run folder again and again, and keeping the latest state of the run for whoever asks."""

from __future__ import annotations

import gzip
import hashlib
import json
import logging
import threading
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from bench.logs import LOG_FILE
from bench.store.errors import RunError
from bench.store.header import read_header
from bench.store.journal import JournalEntry
from bench.store.layout import JOURNAL_FILE, POINTS_FOLDER, RUN_FILE
from bench.store.writer_lock import is_written
from bench.watch.counter import Counter
from bench.watch.document import Seen, document
from bench.watch.history import History, history_of
from bench.watch.journal_tail import JournalTail
from bench.watch.planned import SpareLooks, planned_looks

if TYPE_CHECKING:
    from pathlib import Path

    from bench.store.data import RunHeader

__all__ = ["Snapshot", "Watcher", "open_header"]

_log = logging.getLogger("evs_bench.watch")
_EVERY_S: Final = 0.5
_SHARE_OF_TIME: Final = 0.2  #: most of its time that looking may take: the run needs the computer more
_LOG_BYTES: Final = 16_384
_COMPRESSION: Final = 4
_NO_JOURNAL: Final = "This run has no journal: all files in its folder are shown."


@dataclass(frozen=True, slots=True)
class Snapshot:
    """The state of the run as it was last seen."""

    version: str  #: the same for the same state
    body: bytes  #: JSON
    packed: bytes  #: the same, with gzip


def open_header(folder: Path) -> RunHeader:
    """Return what ``run.yaml`` of a run folder says.

    Raises
    ------
    RunError
        If there is no run that can be read.
    """
    if not folder.is_dir():
        raise RunError(f"{folder}: there is no such run folder")
    if not (folder / RUN_FILE).exists():
        raise RunError(f"{folder}: this is no run, it has no {RUN_FILE}")
    return read_header(folder / RUN_FILE)


class Watcher:
    """Follows one run folder, and never writes into it.

    Parameters
    ----------
    folder
        The run folder.

    Raises
    ------
    RunError
        If there is no run that can be read.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._closing = threading.Event()
        self._threads: list[threading.Thread] = []
        self._begin(open_header(folder))
        self.snapshot = Snapshot("", b"", b"")
        self.look()

    def _begin(self, header: RunHeader) -> None:
        """Follow the run of this header, from its beginning."""
        self._header = header
        self._header_file = self._identity()
        self._looks = self._planned = planned_looks(header)
        self._spare = SpareLooks.of(header)
        self._may_add = 0
        self._tail = JournalTail(self._folder / JOURNAL_FILE)
        self._counter = Counter(self._folder, header.roi)
        self._history: History = history_of(())
        self._seen: object = None

    def start(self) -> None:
        """Look and count in the background until :meth:`close` is called."""
        for work in (self._keep_looking, self._keep_counting):
            thread = threading.Thread(target=work, daemon=True, name=work.__name__.strip("_"))
            thread.start()
            self._threads.append(thread)

    def close(self) -> None:
        """End what :meth:`start` began."""
        self._closing.set()
        for thread in self._threads:
            thread.join(5.0)

    def _keep_looking(self) -> None:
        wait_s = 0.0
        while not self._closing.wait(max(_EVERY_S, wait_s)):
            start = time.monotonic()
            self.look()
            wait_s = (time.monotonic() - start) / _SHARE_OF_TIME

    def _keep_counting(self) -> None:
        while not self._closing.is_set():
            if not self.count_one():
                self._closing.wait(0.1)

    def count_one(self) -> bool:
        """Count one finished point that was not counted yet; return whether there was one."""
        return self._counter.work_once()

    def look(self) -> None:
        """Look at the folder once, and renew the snapshot where something changed."""
        problems = self._look_at_folder()
        written = is_written(self._folder / JOURNAL_FILE) if self._tail.exists else False
        log = self._log_stamp()
        seen = (self._tail.stamp, self._counter.revision, written, log, tuple(problems))
        if seen == self._seen:
            return
        counts, unreadable = self._counter.known()
        state = document(
            Seen(
                self._header,
                self._history,
                written,
                self._planned,
                counts,
                unreadable,
                self._log_lines(),
                problems,
                self._may_add,
            )
        )
        body = json.dumps(state, separators=(",", ":"), allow_nan=False).encode()
        packed = gzip.compress(body, _COMPRESSION, mtime=0)
        self.snapshot = Snapshot(hashlib.sha256(body).hexdigest()[:16], body, packed)
        self._seen = seen

    def _look_at_folder(self) -> list[str]:
        """Take in what is new in the folder, and return what is wrong with it."""
        try:
            if self._identity() != self._header_file:
                header = open_header(self._folder)
                if header != self._header:
                    self._begin(header)
                self._header_file = self._identity()
            changed = self._tail.read()
        except RunError:
            return self._missing()
        except OSError as error:
            return [f"The run folder cannot be read: {error.strerror or error}. Shown is what was seen last."]
        if not self._tail.exists:
            return self._without_journal()
        if changed:
            self._history = history_of(self._tail.entries)
            self._planned = {**self._looks, **self._spare.added(self._tail.entries)}
            self._may_add = self._spare.may_add(self._tail.entries)
            self._counter.want(self._history.files)
        lines = ", ".join(str(line) for line in self._tail.damaged[:5])
        return [f"The journal is damaged in line {lines}; these lines are left out."] if lines else []

    def _missing(self) -> list[str]:
        if (self._folder / RUN_FILE).exists():
            return ["The file run.yaml cannot be read any more. Shown is what was seen last."]
        return ["The run folder is not there any more: it was moved, removed, or its disk is gone. Shown is what was "
                "seen last."]  # fmt: skip

    def _without_journal(self) -> list[str]:
        files = sorted((self._folder / POINTS_FOLDER).glob("[0-9]*.h5"))
        entries = [
            JournalEntry("done", int(f.stem), file=f"{POINTS_FOLDER}/{f.name}") for f in files if f.stem.isdecimal()
        ]
        self._history = history_of([*entries, JournalEntry("run_finished")])
        self._counter.want(self._history.files)
        return [_NO_JOURNAL]

    def _identity(self) -> tuple[int, int, int] | None:
        """Return by what the file ``run.yaml`` is known from another one; None if it is not there."""
        try:
            status = (self._folder / RUN_FILE).stat()
        except OSError:
            return None
        return status.st_ino, status.st_size, status.st_mtime_ns

    def _log_stamp(self) -> tuple[int, int] | None:
        try:
            status = (self._folder / LOG_FILE).stat()
        except OSError:
            return None
        return status.st_size, status.st_mtime_ns

    def _log_lines(self) -> list[str]:
        """Return the last lines of the log."""
        try:
            with (self._folder / LOG_FILE).open("rb") as file:
                start = max(0, file.seek(0, 2) - _LOG_BYTES)
                file.seek(start)
                lines = file.read().decode("utf-8", "replace").splitlines()
        except OSError:
            return []
        return lines[1:] if start else lines
