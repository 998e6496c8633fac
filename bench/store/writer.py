"""Making a run folder: ``run.yaml`` first, then a journal line for every step, then the points one by one."""

from __future__ import annotations

import contextlib
import json
import os
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, Self

from bench.store import layout
from bench.store.durable import sync_folder, write_whole
from bench.store.errors import RunError
from bench.store.header import use_plain_values
from bench.store.journal import POINT_STATES, RUN_STATES
from bench.store.point_writer import PointWriter, cannot_write
from bench.store.run import sha256_of
from bench.store.signals import signals_later

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from bench.store.record import PointRecord

__all__ = ["RunWriter", "utc_now"]


def utc_now() -> str:
    """Return the time in UTC, ISO 8601, with milliseconds."""
    return datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


class RunWriter:
    """Writes one new run folder. It never overwrites one.

    Parameters
    ----------
    folder
        The folder to make; its parents are made where they are missing.
    header
        The keys of ``run.yaml``, without `format`.

    Raises
    ------
    RunError
        If the folder exists, or cannot be written.
    """

    def __init__(self, folder: Path, header: dict[str, Any]) -> None:
        self.folder = folder
        self._done: set[int] = set()
        self._make_folder()
        try:
            write_whole(folder / layout.RUN_FILE, _yaml({"format": layout.RUN_FORMAT, **header}), layout.PART_SUFFIX)
            # It stays open for the whole run: each line goes to disk on its own.
            self._journal = (folder / layout.JOURNAL_FILE).open("ab", buffering=0)
            sync_folder(folder)
        except OSError as error:
            self._remove_folder()
            raise cannot_write(folder / layout.RUN_FILE, error) from error

    def __enter__(self) -> Self:
        """Return the writer itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the journal."""
        self.close()

    def close(self) -> None:
        """Close the journal; nothing can be written after that."""
        self._journal.close()

    def note(self, state: str, point: int | None = None, **more: Any) -> None:
        """Append one line to the journal, and return when it is on disk.

        Parameters
        ----------
        state
            One of the states of the run format.
        point
            Position in the plan; None for the run as a whole.
        **more
            Further keys, as `reason`.
        """
        self._append([_line(state, point, more)])

    def note_plan(self, points: Sequence[int]) -> None:
        """Append a ``planned`` line for each of `points`, and return when all are on disk."""
        self._append([_line("planned", point, {}) for point in points])

    def _append(self, lines: list[dict[str, Any]]) -> None:
        text = "".join(json.dumps(line, ensure_ascii=False) + "\n" for line in lines)
        data = memoryview(text.encode())
        try:
            while data:
                data = data[self._journal.write(data) :]
            os.fsync(self._journal.fileno())
        except OSError as error:
            raise cannot_write(self.folder / layout.JOURNAL_FILE, error) from error

    def point(self, index: int) -> PointWriter:
        """Return a writer for the point `index`; pass it to :meth:`finish` when all events are in."""
        return PointWriter(self.folder / layout.POINTS_FOLDER / f"{index:06d}.h5")

    def finish(self, writer: PointWriter, record: PointRecord) -> Path:
        """Complete the point file, write its ``done`` line, and return its path.

        Ctrl-C and the like are delivered after that: there is no file without its line.
        """
        with signals_later():
            writer.finish(record)
            try:
                digest = sha256_of(writer.path)
            except OSError as error:
                raise cannot_write(writer.path, error) from error
            file = writer.path.relative_to(self.folder).as_posix()
            self.note("done", record.index, file=file, sha256=digest)
            self._done.add(record.index)
        return writer.path

    def is_done(self, index: int) -> bool:
        """Return whether the point `index` has its ``done`` line."""
        return index in self._done

    def _make_folder(self) -> None:
        if self.folder.exists():
            raise RunError(f"{self.folder}: exists already, and a run never overwrites; choose another name")
        try:
            self.folder.parent.mkdir(parents=True, exist_ok=True)
            self.folder.mkdir()
            (self.folder / layout.POINTS_FOLDER).mkdir()
            sync_folder(self.folder.parent)
        except OSError as error:
            raise cannot_write(self.folder, error) from error

    def _remove_folder(self) -> None:
        """Take back what :meth:`_make_folder` made; it holds nothing yet."""
        with contextlib.suppress(OSError):
            (self.folder / layout.RUN_FILE).unlink(missing_ok=True)
            (self.folder / layout.POINTS_FOLDER).rmdir()
            self.folder.rmdir()


def _line(state: str, point: int | None, more: dict[str, Any]) -> dict[str, Any]:
    """Return one line of the journal."""
    if state not in (POINT_STATES if point is not None else RUN_STATES):
        raise ValueError(f"no such state of a {'run' if point is None else 'point'}: {state!r}")
    if point is None:
        return {"t": utc_now(), "state": state, "reason": None, **more}
    line = {"t": utc_now(), "point": point, "state": state, "attempt": 1, "file": None, "sha256": None}
    return {**line, "reason": None, **more}


def _yaml(content: dict[str, Any]) -> str:
    """Return `content` as YAML that keeps the order of the keys, with texts of several lines as blocks."""
    import yaml

    class Dumper(yaml.SafeDumper):
        """Blocks for long texts: run.yaml is read by people."""

    def text(dumper: yaml.SafeDumper, value: str) -> yaml.ScalarNode:
        return dumper.represent_scalar("tag:yaml.org,2002:str", value, style="|" if "\n" in value else None)

    use_plain_values(Dumper)
    Dumper.add_representer(str, text)
    return str(yaml.dump(content, Dumper=Dumper, sort_keys=False, allow_unicode=True, width=110))
