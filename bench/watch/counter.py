"""Counting finished points one after the other, in the background, each once."""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from typing import TYPE_CHECKING, Final

from bench.store.errors import RunError
from bench.store.probe import is_known, probe
from bench.watch.counting import count_point

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from bench.watch.counting import PointCounts
    from bench.watch.history import DoneFile
    from protocols.points import Roi

__all__ = ["Counter"]

_log = logging.getLogger("evs_bench.watch")
_RETRY_S: Final = 30.0  #: a file that could not be read is looked at again after so long: a disk may come back
_PROBED_AT_ONCE: Final = 50


class Counter:
    """Knows what finished points say, and finds it out for new ones.

    A file is known by its name and the checksum in the journal: a point that was taken again is counted again.

    Parameters
    ----------
    folder
        The run folder.
    roi
        The run's window.
    """

    def __init__(self, folder: Path, roi: Roi) -> None:
        self._folder = folder
        self._roi = roi
        self._wanted: Sequence[DoneFile] = ()
        self._counts: dict[DoneFile, PointCounts] = {}
        self._failed: dict[DoneFile, tuple[str, float]] = {}  # why, and when
        self._lock = threading.Lock()
        self.revision = 0  #: grows with each point that was counted, or could not be

    def want(self, files: Sequence[DoneFile]) -> None:
        """Ask for these points, and forget all others; the last one is counted first."""
        with self._lock:
            self._wanted = files
            wanted = set(files)
            for known in (self._counts, self._failed):
                for file in [file for file in known if file not in wanted]:
                    del known[file]

    def known(self) -> tuple[dict[int, PointCounts], dict[int, str]]:
        """Return what is known of the points asked for, and why each of the others cannot be read."""
        with self._lock:
            counts = {file.point: found for file, found in self._counts.items()}
            return counts, {file.point: why for file, (why, _) in self._failed.items()}

    def work_once(self) -> bool:
        """Count one point that is asked for and not known; return whether there was one."""
        with self._lock:
            file = self._next()
        if file is None:
            return False
        if file.sha256 is None:
            self._probe_some()
        try:
            self._keep(file, count_point(self._folder, file, self._roi))
        except (RunError, OSError, MemoryError) as error:
            self._fail(file, self._relative(error))
        except Exception as error:  # noqa: BLE001 - one strange file must not end the page of a run
            _log.exception("point %d", file.point)
            self._fail(file, f"cannot be shown: {type(error).__name__}: {error}")
        return True

    def _next(self) -> DoneFile | None:
        late = time.monotonic() - _RETRY_S
        for file in reversed(self._wanted):
            if file not in self._counts and self._failed.get(file, ("", -1e9))[1] < late:
                return file
        return None

    def _probe_some(self) -> None:
        """Find out which files without a checksum can be read: for several at once, as that needs a process."""
        paths = [self._folder / file.file for file in reversed(self._wanted) if file.sha256 is None and file.file]
        inside = [path for path in paths if path.resolve().is_relative_to(self._folder.resolve()) and path.is_file()]
        unknown = [path for path in inside if not is_known(path)][:_PROBED_AT_ONCE]
        with contextlib.suppress(RunError):
            probe(unknown)

    def _keep(self, file: DoneFile, counts: PointCounts) -> None:
        with self._lock:
            self._failed.pop(file, None)
            self._counts[file] = counts
            self.revision += 1

    def _fail(self, file: DoneFile, why: str) -> None:
        with self._lock:
            self.revision += self._failed.get(file, ("", 0.0))[0] != why
            self._failed[file] = (why, time.monotonic())

    def _relative(self, error: BaseException) -> str:
        """Return what went wrong; files are named from the run folder on."""
        return " ".join(str(error).split()).replace(f"{self._folder}/", "") or type(error).__name__
