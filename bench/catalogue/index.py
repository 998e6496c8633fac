"""The index of a folder of runs: an SQLite file in it that spares reading what has not changed.

It is a cache, and lies beside the runs so that it goes with them to another disk or computer. Whatever is wrong with
it (locked, damaged, of another version, a folder that cannot be written) never stops anybody: what it does not give
is read from the folders. Nothing is kept in it that is not in them.
"""

from __future__ import annotations

import contextlib
import json
from dataclasses import astuple, dataclass, fields
from typing import TYPE_CHECKING, Any, Final

from bench.catalogue.entry import STATES, RunEntry

if TYPE_CHECKING:
    import sqlite3
    from collections.abc import Iterable, Iterator, Mapping
    from pathlib import Path

__all__ = ["INDEX_FILE", "Index", "Known"]

INDEX_FILE: Final = ".evs-bench-runs.sqlite"
#: Of the tables. An index of another number is made anew; count it up whenever what is read of a run changes.
_SCHEMA: Final = 1
#: How long to wait for another process, s: longer than its transactions take, shorter than reading all runs.
_BUSY_S: Final = 2.0
_COLUMNS: Final = tuple(f.name for f in fields(RunEntry))
_BESIDE: Final = ("", "-wal", "-shm", "-journal")


@dataclass(frozen=True, slots=True)
class Known:
    """A folder as it was when it was read."""

    stamp: str  #: sizes and times of change, see :func:`bench.catalogue.catalogue.stamp_of`
    entry: RunEntry
    pace: dict[str, Any] | None = None  #: what its points took beside their recordings, as far as it was asked for


class Index:
    """What was read of the runs of one folder.

    Parameters
    ----------
    folder
        The folder that holds the runs.

    Attributes
    ----------
    problem
        Why the index could not be used the last time, for people; empty if it could.
    """

    def __init__(self, folder: Path) -> None:
        self._file = folder / INDEX_FILE
        self.problem = ""

    def read(self) -> dict[str, Known]:
        """Return what is known, by the name of the folder; nothing where the index cannot be used."""
        rows: list[tuple[Any, ...]] = []
        if self._file.exists():
            names = ", ".join(_COLUMNS)
            with self._or_without(), self._opened() as connection:
                rows = connection.execute(f"SELECT stamp, pace, {names} FROM run").fetchall()  # noqa: S608 - our names
        return {known.entry.folder: known for row in rows if (known := _known(row)) is not None}

    def write(self, changed: Iterable[Known], gone: Iterable[str] = ()) -> None:
        """Take note of the folders in `changed`, and forget those in `gone`."""
        rows = [(known.stamp, _json(known.pace), *astuple(known.entry)) for known in changed]
        places = ", ".join("?" * (len(_COLUMNS) + 2))
        insert = f"INSERT OR REPLACE INTO run (stamp, pace, {', '.join(_COLUMNS)}) VALUES ({places})"  # noqa: S608
        forget = [(name,) for name in gone]
        if not rows and not forget:
            return
        with self._or_without(), self._opened() as connection, connection:
            connection.executemany(insert, rows)
            connection.executemany("DELETE FROM run WHERE folder = ?", forget)

    def write_paces(self, paces: Mapping[str, tuple[str, dict[str, Any]]]) -> None:
        """Take note of paces: for each folder its stamp, and its pace; one that has changed since is left out."""
        rows = [(json.dumps(pace), name, stamp) for name, (stamp, pace) in paces.items()]
        if rows:
            with self._or_without(), self._opened() as connection, connection:
                connection.executemany("UPDATE run SET pace = ? WHERE folder = ? AND stamp = ?", rows)

    @contextlib.contextmanager
    def _or_without(self) -> Iterator[None]:
        """Do without the index where it cannot be used; one that is damaged is thrown away."""
        import sqlite3

        try:
            yield
        except sqlite3.Error as error:
            if _passes(error):
                self.problem = f"the index {self._file} cannot be used ({error}); every run was read"
            else:
                self._throw_away()
                self.problem = f"the index {self._file} was damaged ({error}); it is made anew"

    def _throw_away(self) -> None:
        for ending in _BESIDE:
            with contextlib.suppress(OSError):
                self._file.with_name(self._file.name + ending).unlink(missing_ok=True)

    @contextlib.contextmanager
    def _opened(self) -> Iterator[sqlite3.Connection]:
        import sqlite3

        connection = sqlite3.connect(self._file, timeout=_BUSY_S)
        try:
            if connection.execute("PRAGMA user_version").fetchone() != (_SCHEMA,):
                _make_tables(connection)
            yield connection
        finally:
            connection.close()


def _passes(error: sqlite3.Error) -> bool:
    """Return whether it is not the index itself that is wrong: it is in use, or the disk takes or gives nothing."""
    import sqlite3 as codes

    code = getattr(error, "sqlite_errorcode", None)
    return code is not None and code & 0xFF in (
        codes.SQLITE_BUSY,
        codes.SQLITE_LOCKED,
        codes.SQLITE_READONLY,
        codes.SQLITE_CANTOPEN,
        codes.SQLITE_FULL,
        codes.SQLITE_IOERR,
        codes.SQLITE_PERM,
    )


def _make_tables(connection: sqlite3.Connection) -> None:
    """Make the table anew: the index is empty, or of another version."""
    kinds = {"int": "INTEGER", "str": "TEXT", "float | None": "REAL"}
    columns = ", ".join(f"{f.name} {kinds[str(f.type)]}" for f in fields(RunEntry))
    with connection:
        connection.execute("BEGIN IMMEDIATE")
        if connection.execute("PRAGMA user_version").fetchone() == (_SCHEMA,):
            return  # another process was faster
        for (name,) in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'").fetchall():
            connection.execute(f'DROP TABLE "{name}"')
        connection.execute(f"CREATE TABLE run (stamp TEXT, pace TEXT, {columns}, PRIMARY KEY (folder))")
        connection.execute(f"PRAGMA user_version = {_SCHEMA}")


def _known(row: tuple[Any, ...]) -> Known | None:
    """Return a row of the table; None for one that holds what we never wrote."""
    stamp, pace, *values = row
    entry = RunEntry(*values)
    if not isinstance(stamp, str) or not all(_fits(value, f.type) for value, f in zip(values, _FIELDS, strict=True)):
        return None
    if entry.state not in ("", *STATES):
        return None
    return Known(stamp, entry, _from_json(pace))


_FIELDS: Final = fields(RunEntry)


def _fits(value: Any, kind: Any) -> bool:
    kinds = {"int": int, "str": str, "float | None": float | int | None}
    return isinstance(value, kinds[str(kind)])


def _json(pace: dict[str, Any] | None) -> str | None:
    return None if pace is None else json.dumps(pace)


def _from_json(text: Any) -> dict[str, Any] | None:
    try:
        found = json.loads(text) if isinstance(text, str) else None
    except ValueError:
        return None
    return found if isinstance(found, dict) else None
