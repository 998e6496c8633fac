"""A run folder, for reading."""

from __future__ import annotations

import contextlib
import hashlib
import logging
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from bench.store import layout
from bench.store.errors import RunError
from bench.store.event_reader import read_events
from bench.store.header import read_header
from bench.store.journal import RUN_STATES, JournalEntry, last_done, read_journal, skipped
from bench.store.probe import is_known, probe, remember
from bench.store.reader import read_point

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from bench.store.data import PointData, RunHeader
    from protocols.points import Roi

_log = logging.getLogger("evs_bench.store")

__all__ = ["PointFile", "Run", "sha256_of", "unsound_points"]

_MOST_REASONS: Final = 3  #: why points were skipped, in a remark

#: Files that were found changed when they were read in this process.
_changed: set[Path] = set()


@dataclass(frozen=True, slots=True)
class PointFile:
    """One finished point: its file, and the checksum that the journal has of it."""

    path: Path
    sha256: str | None = None  #: None where there is no journal


@dataclass(frozen=True, slots=True)
class Run:
    """A run folder as a reader sees it: what was asked, and the points that were finished."""

    folder: Path
    header: RunHeader
    files: tuple[PointFile, ...]  #: finished points, in the order of the plan
    journal: tuple[JournalEntry, ...] = ()  #: empty where there is none
    damaged: tuple[str, ...] = ()  #: what is wrong with each point that :meth:`without_damaged` left out

    @classmethod
    def open(cls, path: Path | str) -> Run:
        """Open the run in the folder `path`.

        With a journal, the file of each point's last ``done`` line is taken; without one, all of ``points/*.h5``.

        Raises
        ------
        RunError
            If there is no run, its format is newer, or a file that the journal calls done is not there.
        """
        folder = Path(path)
        if not folder.is_dir():
            raise RunError(f"{folder}: there is no such run folder")
        if not (folder / layout.RUN_FILE).exists():
            raise RunError(f"{folder}: this is no run, it has no {layout.RUN_FILE}")
        header = read_header(folder / layout.RUN_FILE)
        journal_file = folder / layout.JOURNAL_FILE
        if not journal_file.exists():
            return cls(folder, header, _all_files(folder))
        journal = read_journal(journal_file)
        return cls(folder, header, _done_files(folder, journal), tuple(journal))

    def __len__(self) -> int:
        """Return the number of finished points."""
        return len(self.files)

    def points(self) -> Iterator[PointData]:
        """Yield the finished points in the order of the plan, each read when it is asked for.

        Raises
        ------
        RunError
            For a file that is damaged. One that is sound but not as it was written is noted in the log.
        """
        self._require_readable()
        for file in self.files:
            yield read_point(file.path, self.header.roi)

    def without_damaged(self) -> Run:
        """Return this run without the points whose files cannot be read; `damaged` says which, and why.

        A file that is as it was written, by its checksum, is taken for sound.

        Raises
        ------
        RunError
            If there were points, and none is left: a line for each.
        """
        doubtful = [file for file in self.files if not _is_as_written(file)]
        with contextlib.suppress(RunError):  # at one go, a child process for each file takes long; if need be, below
            probe(file.path for file in doubtful)
        damaged = {}
        for file in doubtful:
            try:
                _require_sound(file, self.header.roi)
            except RunError as error:
                damaged[file.path] = str(error)
        kept = tuple(file for file in self.files if file.path not in damaged)
        if damaged and not kept:
            raise RunError(*damaged.values())
        return replace(self, files=kept, damaged=(*self.damaged, *damaged.values()))

    def verify(self) -> None:
        """Read every point to its last event, and compare checksums with the journal.

        Raises
        ------
        RunError
            For the first file that is damaged or is not the one that was written.
        """
        self._require_readable()
        for file in self.files:
            if file.sha256 is not None and sha256_of(file.path) != file.sha256:
                raise RunError(f"{file.path}: the file was changed since it was written (its SHA-256 differs)")
            point = read_point(file.path, self.header.roi)
            for _ in read_events(file.path, roi=point.roi):
                pass

    def remarks(self) -> tuple[str, ...]:
        """Return what a reader of results should know of this run, in plain words: what is missing, what was changed.

        Files that were changed are known once the points have been read.
        """
        found = []
        planned = {entry.point for entry in self.journal if entry.state == "planned"}
        taken = len(self.files) + len(self.damaged)
        left_out = skipped(self.journal)
        if left_out:
            reasons = sorted({entry.reason for entry in left_out.values() if entry.reason})
            why = f" ({'; '.join(reasons[:_MOST_REASONS])})" if reasons else ""
            found.append(f"{len(left_out)} of {len(planned)} planned points were skipped{why}")
        if self.journal and taken + len(left_out) < len(planned):
            found.append(f"only {taken} of {len(planned)} planned points were taken: {self._end()}")
        elif not self.files:
            found.append("there is no finished point in this run")
        changed = sorted(file.path.name for file in self.files if file.path in _changed)
        if changed:
            found.append(f"points were changed after they were written (SHA-256 differs): {', '.join(changed)}")
        return tuple(found)

    def _end(self) -> str:
        last = [entry for entry in self.journal if entry.state in RUN_STATES][-1:]
        if not last or last[0].state in ("run_started", "resumed"):
            return "the run did not come to its end"
        return f"{last[0].state.replace('_', ' ')}{f' ({last[0].reason})' if last[0].reason else ''}"

    def _require_readable(self) -> None:
        """Raise if the HDF5 library would not survive a file; see :mod:`bench.store.probe`."""
        doubtful = [file for file in self.files if not is_known(file.path)]
        for file in doubtful:
            if not _is_as_written(file) and file.sha256 is not None:
                _changed.add(file.path)
                _log.warning("%s: the file was changed since it was written", file.path)
        probe(file.path for file in doubtful)


def _is_as_written(file: PointFile) -> bool:
    """Return whether `file` has the checksum of the journal; then it can be read."""
    same = file.sha256 is not None and sha256_of(file.path) == file.sha256
    if same:
        remember([file.path])
    return same


def _require_sound(file: PointFile, window: Roi) -> None:
    """Raise :class:`RunError` if `file` cannot be read to its last event."""
    probe([file.path])
    point = read_point(file.path, window)
    for _ in read_events(file.path, roi=point.roi):
        pass
    if file.sha256 is not None:
        _changed.add(file.path)


def _all_files(folder: Path) -> tuple[PointFile, ...]:
    return tuple(PointFile(path) for path in sorted((folder / layout.POINTS_FOLDER).glob("*.h5")))


def _done_files(folder: Path, journal: list[JournalEntry]) -> tuple[PointFile, ...]:
    return tuple(PointFile(_file_of(folder, entry), entry.sha256) for entry in last_done(journal).values())


def unsound_points(folder: Path, journal: Iterable[JournalEntry]) -> dict[int, str]:
    """Return the points that the journal calls done, and whose files are not there as they were written, with why.

    Raises
    ------
    RunError
        If the journal names a file outside of the run folder.
    """
    found = {}
    for index, entry in last_done(journal).items():
        why = _why_unsound(folder, entry)
        if why:
            found[index] = why
    return found


def _why_unsound(folder: Path, entry: JournalEntry) -> str:
    if entry.file is None:
        return "no file is named"
    path = folder / entry.file
    if path.resolve().is_relative_to(folder.resolve()) and not path.is_file():
        return f"{entry.file} is not there"
    try:
        changed = entry.sha256 is not None and sha256_of(_file_of(folder, entry)) != entry.sha256
    except OSError as error:
        return f"{entry.file} cannot be read ({error.strerror or error})"
    return f"{entry.file} is not as it was written (its SHA-256 differs)" if changed else ""


def _file_of(folder: Path, entry: JournalEntry) -> Path:
    where = folder / layout.JOURNAL_FILE
    if entry.file is None:
        raise RunError(f"{where}: point {entry.point} is done, but no file is named")
    path = folder / entry.file
    if not path.resolve().is_relative_to(folder.resolve()):
        raise RunError(f"{where}: point {entry.point}: {entry.file} lies outside the run folder")
    if not path.is_file():
        raise RunError(
            f"{where}: point {entry.point} is done, but {entry.file} is not there; bring it back, or take the point "
            f"again with: evs-bench resume {folder}"
        )
    return path


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of the file `path`, in hexadecimal."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()
