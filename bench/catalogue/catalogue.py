"""The runs in a folder: the index brought up to date, with as little reading as possible."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Final

from bench.catalogue.index import Index, Known
from bench.catalogue.summary import is_run_folder, summarize
from bench.store.errors import RunError
from bench.store.layout import JOURNAL_FILE, POINTS_FOLDER, RUN_FILE
from bench.store.writer import is_being_written

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Iterable
    from pathlib import Path

    from bench.catalogue.entry import RunEntry

__all__ = ["Catalogue", "read_catalogue", "stamp_of"]

#: After so many folders what was found goes into the index: a long first reading that is stopped is not lost.
_BATCH: Final = 100
#: Between two looks at a lock, s.
_LOOK_S: Final = 0.01
#: States of a run that some process is taking.
_UNDER_WAY: Final = ("running", "paused", "suspended")
_LONG_AGO: Final = datetime.min.replace(tzinfo=UTC)


@dataclass(frozen=True, slots=True)
class Catalogue:
    """The runs of one folder."""

    folder: Path
    entries: tuple[RunEntry, ...]  #: newest first; folders that are no runs at the end
    read: int  #: folders that had to be read, because they were new or had changed
    problem: str = ""  #: why the index could not be used; empty if it could


def read_catalogue(
    folder: Path,
    *,
    rebuild: bool = False,
    at_most: int | None = None,
    tell: Callable[[str], None] | None = None,
) -> Catalogue:
    """Return the runs in `folder`, and bring its index up to date.

    Parameters
    ----------
    folder
        The folder that holds the run folders.
    rebuild
        Read every folder, whatever the index says.
    at_most
        Read no more than so many folders, those that changed last; others that would have to be read are left out.
    tell
        Told in a line that there is much to read, which takes a while.

    Raises
    ------
    RunError
        If `folder` is not there, cannot be read, or is a run itself.
    """
    index = Index(folder)
    stamps = {path: stamp_of(path) for path in _folders_in(folder)}
    before = index.read()
    known = {} if rebuild else _still_true(before, stamps)
    unknown = [path for path in stamps if path.name not in known]
    wanted = unknown if at_most is None else _newest([path for path in unknown if stamps[path]], at_most)
    if tell is not None and len(wanted) > _BATCH:
        tell(f"reading {len(wanted)} folders for the index; the next time is quick")
    for start in range(0, len(wanted), _BATCH):
        fresh = [Known(stamps[path], summarize(path)) for path in wanted[start : start + _BATCH]]
        index.write([one for one in fresh if one.stamp])
        known |= {one.entry.folder: one for one in fresh}
    index.write((), gone=before.keys() - {path.name for path in stamps})
    entries = [_alive(one.entry, folder) for one in known.values()]
    return Catalogue(folder, tuple(_in_order(entries)), sum(bool(stamps[path]) for path in wanted), index.problem)


def _still_true(before: dict[str, Known], stamps: dict[Path, str]) -> dict[str, Known]:
    """Return what is known of folders that have not changed since."""
    now = {path.name: stamp for path, stamp in stamps.items() if stamp}
    return {name: one for name, one in before.items() if now.get(name) == one.stamp}


def _folders_in(folder: Path) -> list[Path]:
    if not folder.is_dir():
        raise RunError(f"{folder}: there is no such folder")
    if is_run_folder(folder):
        raise RunError(f"{folder}: this is one run; name the folder that holds the runs")
    try:
        found = [path for path in folder.iterdir() if not path.name.startswith(".") and path.is_dir()]
    except OSError as error:
        raise RunError(f"{folder}: {error.strerror or error}") from error
    return [path for path in found if _printable(path.name)]


def _printable(name: str) -> bool:
    """Return whether a name is text: one that is not could neither be shown nor be typed."""
    try:
        name.encode()
    except UnicodeEncodeError:
        return False
    return True


def stamp_of(folder: Path) -> str:
    """Return what changes when a run does: sizes and times of its parts; empty for what is no run.

    Stamps are compared for being equal and never for which is later, so that a clock that was set back does no harm.
    They stay as they are when a folder is copied with its times.
    """
    header, journal, points = (_status(folder / name) for name in (RUN_FILE, JOURNAL_FILE, POINTS_FOLDER))
    if header is None:
        return ""
    parts = [f"{s.st_size} {s.st_mtime_ns}" if s else "none" for s in (header, journal)]
    return ", ".join([*parts, f"{points.st_mtime_ns}" if points else "none"])


def _status(path: Path) -> os.stat_result | None:
    try:
        return path.stat()
    except OSError:
        return None


def _newest(folders: list[Path], at_most: int | None) -> list[Path]:
    if at_most is None:
        return folders
    return sorted(folders, key=_changed_at, reverse=True)[:at_most]


def _changed_at(folder: Path) -> float:
    status = _status(folder / RUN_FILE)
    return status.st_mtime if status else 0.0


def _alive(entry: RunEntry, folder: Path) -> RunEntry:
    """Return `entry` with its state of this moment: a run whose journal has no end may have lost its process."""
    if entry.state not in _UNDER_WAY:
        return entry
    # Somebody else may just be looking, which is over at the second look.
    if _is_locked(folder / entry.folder):
        time.sleep(_LOOK_S)
        if _is_locked(folder / entry.folder):
            return entry
    return replace(entry, state="interrupted")


def _is_locked(run: Path) -> bool:
    try:
        return is_being_written(run)
    except RunError:
        return False


def _in_order(entries: Iterable[RunEntry]) -> list[RunEntry]:
    """Return runs newest first, those without a date after them, then what is no run, by name."""
    by_name = sorted(entries, key=lambda entry: entry.folder, reverse=True)
    return sorted(by_name, key=lambda entry: (entry.is_run, entry.created_at or _LONG_AGO), reverse=True)
