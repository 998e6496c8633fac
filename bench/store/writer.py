"""Making a run folder: ``run.yaml`` first, then a journal line for every step, then the points one by one.

One process at a time writes a run; where workers measure, they hand whole files to it.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, Self

from bench.store import layout
from bench.store.durable import lock_file, sync_file, sync_folder, write_whole
from bench.store.errors import RunError
from bench.store.header import use_plain_values
from bench.store.journal import POINT_STATES, RUN_STATES, last_done, read_journal
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
    """Writes one new run folder, or goes on with one. It never overwrites one.

    Parameters
    ----------
    folder
        The folder to make; its parents are made where they are missing.
    header
        The keys of ``run.yaml``, without `format`; None to go on with the run that is in `folder`. Then half-written
        points are removed, and so is a torn last line of the journal.

    Raises
    ------
    RunError
        If the folder exists (or does not, without `header`), cannot be written, or another process is writing it.
    """

    def __init__(self, folder: Path, header: dict[str, Any] | None) -> None:
        self.folder = folder
        self._done: set[int] = set()
        if header is None:
            self._go_on()
        else:
            self._begin(header)

    def _begin(self, header: dict[str, Any]) -> None:
        folder = self.folder
        self._make_folder()
        try:
            write_whole(folder / layout.RUN_FILE, _yaml({"format": layout.RUN_FORMAT, **header}), layout.PART_SUFFIX)
            # It stays open for the whole run: each line goes to disk on its own.
            self._journal = (folder / layout.JOURNAL_FILE).open("ab", buffering=0)
            lock_file(self._journal.fileno())
            sync_folder(folder)
        except OSError as error:
            self._remove_folder()
            raise cannot_write(folder / layout.RUN_FILE, error) from error

    def _go_on(self) -> None:
        path = self.folder / layout.JOURNAL_FILE
        try:
            self._journal = path.open("r+b", buffering=0)
        except OSError as error:
            raise cannot_write(path, error) from error
        try:
            lock_file(self._journal.fileno())
            whole = path.read_bytes().rfind(b"\n") + 1
            self._journal.truncate(whole)
            self._journal.seek(whole)
            self._done = set(last_done(read_journal(path)))
            self._remove_halves()
        except BlockingIOError:
            self.close()
            raise RunError(f"{self.folder}: another process is writing this run") from None
        except OSError as error:
            self.close()
            raise cannot_write(path, error) from error
        except RunError:
            self.close()
            raise

    def __enter__(self) -> Self:
        """Return the writer itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Remove half-written points, and close the journal.

        A writer of a point removes its own; not so where an interrupt came before anybody had that writer in hand.
        """
        with contextlib.suppress(OSError):
            self._remove_halves()
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
        return PointWriter(self._file_of(index))

    def finish(self, writer: PointWriter, record: PointRecord) -> Path:
        """Complete the point file, write its ``done`` line, and return its path.

        Ctrl-C and the like are delivered after that: there is no file without its line.
        """
        with signals_later():
            writer.finish(record)
            self._note_done(record.index, self._digest_of(record.index))
        return writer.path

    def part_of(self, index: int) -> Path:
        """Return where a worker is to leave the whole file of the point `index`, for :meth:`commit`."""
        file = self._file_of(index)
        return file.with_name(file.name + layout.PART_SUFFIX)

    def commit(self, index: int, sha256: str, content: bytes | None = None) -> None:
        """Give the file that a worker left its name, and write its ``done`` line.

        Parameters
        ----------
        index
            The point.
        sha256
            Of the file, as the worker has it.
        content
            The file itself, where the worker could not leave it.

        Raises
        ------
        RunError
            If the file cannot be written, or did not arrive as it was sent.
        """
        part, file = self.part_of(index), self._file_of(index)
        if content is not None and hashlib.sha256(content).hexdigest() != sha256:
            raise RunError(f"{file}: did not arrive as its worker sent it (its SHA-256 differs)")
        with signals_later():
            try:
                if content is not None:
                    part.write_bytes(content)
                    sync_file(part)
                part.replace(file)
                sync_folder(file.parent)
            except OSError as error:
                raise cannot_write(file, error) from error
            self._note_done(index, sha256)

    def adopt(self, index: int) -> None:
        """Write the ``done`` line of a file that is whole under its final name, but has none."""
        self._note_done(index, self._digest_of(index))

    def discard(self, index: int) -> None:
        """Remove what a worker left of a point that it did not finish, if there is something."""
        with contextlib.suppress(OSError):
            for rest in (self.folder / layout.POINTS_FOLDER).glob(f"{index:06d}.h5{layout.PART_SUFFIX}*"):
                rest.unlink()

    def unadopted(self) -> dict[int, Path]:
        """Return the files under a final name that have no ``done`` line, by point."""
        files = sorted((self.folder / layout.POINTS_FOLDER).glob("[0-9]*.h5"))
        found = {int(file.stem): file for file in files if file.stem.isdecimal()}
        return {index: file for index, file in found.items() if index not in self._done}

    def _file_of(self, index: int) -> Path:
        return self.folder / layout.POINTS_FOLDER / f"{index:06d}.h5"

    def _digest_of(self, index: int) -> str:
        try:
            return sha256_of(self._file_of(index))
        except OSError as error:
            raise cannot_write(self._file_of(index), error) from error

    def _note_done(self, index: int, sha256: str) -> None:
        file = self._file_of(index).relative_to(self.folder).as_posix()
        self.note("done", index, file=file, sha256=sha256)
        self._done.add(index)

    def is_done(self, index: int) -> bool:
        """Return whether the point `index` has its ``done`` line."""
        return index in self._done

    def _remove_halves(self) -> None:
        for part in (self.folder / layout.POINTS_FOLDER).glob(f"*{layout.PART_SUFFIX}"):
            part.unlink()

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
