"""Making a run folder: ``run.yaml`` first, then a journal line for every step, then the points one by one.

One process at a time writes a run; where workers measure, they hand whole files to it.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, Final, Self

from bench.store import layout
from bench.store.durable import lock_file, sync_file, sync_folder, write_whole
from bench.store.errors import RunError
from bench.store.header import use_plain_values
from bench.store.journal import PLAN_CHANGED, POINT_STATES, RUN_STATES, attempts, last_done, read_journal, skipped
from bench.store.journal_file import JournalFile
from bench.store.point_writer import PointWriter, cannot_write
from bench.store.run import sha256_of
from bench.store.signals import signals_later
from bench.store.writer_lock import is_written

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from bench.store.journal import JournalEntry
    from bench.store.record import PointRecord

__all__ = ["RunWriter", "is_being_written", "utc_now"]

#: States that promise something of files: only of those in the place where the run was begun.
_PROMISES: Final = ("done", "rejected", "run_finished")


def utc_now() -> str:
    """Return the time in UTC, ISO 8601, with milliseconds."""
    return datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def is_being_written(folder: Path) -> bool:
    """Return whether a process is writing the run in `folder`; False where the platform cannot tell.

    Raises
    ------
    RunError
        If there is no journal that can be read.
    """
    path = folder / layout.JOURNAL_FILE
    told = is_written(path)
    if told is not None:
        return told
    try:
        with path.open("rb") as journal:
            lock_file(journal.fileno())
    except BlockingIOError:
        return True
    except OSError as error:
        raise RunError(f"{path}: {error.strerror or error}") from error
    return False


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
        self._skipped: set[int] = set()
        self._attempts: dict[int, int] = {}
        self._named: set[str] = set()  # names of files of points that the journal knows
        self._journal: JournalFile | None = None
        self._made = False  # the folder, by us
        if header is None:
            self._go_on()
        else:
            self._begin(header)

    def _begin(self, header: dict[str, Any]) -> None:
        folder, path = self.folder, self.folder
        if folder.exists():
            raise RunError(f"{folder}: exists already, and a run never overwrites; choose another name")
        try:
            self._make_folder()
            path = folder / layout.RUN_FILE
            write_whole(path, _yaml({"format": layout.RUN_FORMAT, **header}), layout.PART_SUFFIX)
            path = folder / layout.JOURNAL_FILE
            self._journal = JournalFile(path, new=True)
            sync_folder(folder)
        except OSError as error:
            self._remove_folder()
            raise cannot_write(path, error) from error

    def _go_on(self) -> None:
        path = self.folder / layout.JOURNAL_FILE
        try:
            self._journal = JournalFile(path, new=False)
            self._know(read_journal(path))
            self._remove_halves()
            (self.folder / layout.CONTROL_FILE).unlink(missing_ok=True)  # a wish of before
        except BlockingIOError:
            raise RunError(f"{self.folder}: another process is writing this run") from None
        except OSError as error:
            self.close()
            raise cannot_write(path, error) from error
        except RunError:
            self.close()
            raise

    def _know(self, journal: list[JournalEntry]) -> None:
        self._done, self._skipped = set(last_done(journal)), set(skipped(journal))
        self._attempts = attempts(journal)
        self._named = {entry.file.rpartition("/")[2] for entry in journal if entry.file is not None}

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
        if self._journal is not None:
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
        if state in _PROMISES:
            self._opened.require_place()
        attempt = {} if point is None else {"attempt": max(1, self._attempts.get(point, 1))}
        self._append([_line(state, point, attempt | more)])

    def note_plan(self, points: Sequence[int]) -> None:
        """Append a ``planned`` line for each of `points`, and return when all are on disk."""
        self._append([_line("planned", point, {}) for point in points])

    def _append(self, lines: list[dict[str, Any]]) -> None:
        self._opened.append("".join(json.dumps(line, ensure_ascii=False) + "\n" for line in lines))

    @property
    def _opened(self) -> JournalFile:
        if self._journal is None:
            raise ValueError("the journal is not open")
        return self._journal

    def begin(self, index: int) -> int:
        """Note that the point `index` is begun, and return the number of the attempt, from 1."""
        self._attempts[index] = self._attempts.get(index, 0) + 1
        self.note("started", index)
        return self._attempts[index]

    def skip(self, index: int, reason: str) -> None:
        """Note that the point `index` is left out."""
        self._skipped.add(index)
        self.note("skipped", index, reason=reason)

    def point(self, index: int) -> PointWriter:
        """Return a writer for the point `index`; pass it to :meth:`finish` when all events are in."""
        return PointWriter(self._file_of(index))

    def finish(self, writer: PointWriter, record: PointRecord, **more: Any) -> Path:
        """Complete the point file, write its ``done`` line with the further keys `more`, and return its path.

        Ctrl-C and the like are delivered after that: there is no file without its line.
        """
        with signals_later():
            writer.finish(record)
            self._note_file("done", record.index, writer.path, self._digest_of(writer.path), more)
        return writer.path

    def reject(self, writer: PointWriter, record: PointRecord, **more: Any) -> Path:
        """Complete the file of a point that was judged bad, as evidence; the next one gets another name."""
        with signals_later():
            writer.finish(record)
            self._note_file("rejected", record.index, writer.path, self._digest_of(writer.path), more)
        return writer.path

    def give_up(self, index: int, reason: str) -> None:
        """Note that the file of a point that is done cannot be used: the point is not done any more."""
        self._done.discard(index)
        self.note("rejected", index, reason=reason)

    def part_of(self, index: int) -> Path:
        """Return where a worker is to leave the whole file of the point `index`, for :meth:`commit`."""
        file = self._file_of(index)
        return file.with_name(file.name + layout.PART_SUFFIX)

    def commit(
        self, index: int, sha256: str, content: bytes | None = None, *, state: str = "done", **more: Any
    ) -> None:
        """Give the file that a worker left its name, and write its line.

        Parameters
        ----------
        index
            The point.
        sha256
            Of the file, as the worker has it.
        content
            The file itself, where the worker could not leave it.
        state
            ``done`` or ``rejected``.
        **more
            Further keys of the line.

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
            self._note_file(state, index, file, sha256, more)

    def adopt(self, index: int, file: Path) -> None:
        """Write the ``done`` line of a file that is whole under a final name, but has none."""
        self._note_file("done", index, file, self._digest_of(file), {})

    def discard(self, index: int) -> None:
        """Remove what a worker left of a point that it did not finish, if there is something."""
        with contextlib.suppress(OSError):
            for rest in (self.folder / layout.POINTS_FOLDER).glob(f"{index:06d}.*{layout.PART_SUFFIX}*"):
                rest.unlink()

    def unadopted(self) -> list[tuple[int, Path]]:
        """Return point and path of the files under a final name that no line names and whose point is not done."""
        files = sorted((self.folder / layout.POINTS_FOLDER).glob("[0-9]*.h5"))
        found = [(layout.point_of(file.name), file) for file in files if file.name not in self._named]
        return [(point[0], file) for point, file in found if point is not None and point[0] not in self._done]

    def _file_of(self, index: int) -> Path:
        """Return the first name that no file of the point has had."""
        repeat = 0
        while True:
            file = self.folder / layout.POINTS_FOLDER / layout.point_file(index, repeat)
            if file.name not in self._named and not file.exists():
                return file
            repeat += 1

    def _digest_of(self, file: Path) -> str:
        try:
            return sha256_of(file)
        except OSError as error:
            raise cannot_write(file, error) from error

    def _note_file(self, state: str, index: int, file: Path, sha256: str, more: dict[str, Any]) -> None:
        self._named.add(file.name)
        self.note(state, index, file=file.relative_to(self.folder).as_posix(), sha256=sha256, **more)
        if state == "done":
            self._done.add(index)
            self._skipped.discard(index)

    def is_done(self, index: int) -> bool:
        """Return whether the point `index` has its ``done`` line."""
        return index in self._done

    def is_skipped(self, index: int) -> bool:
        """Return whether the point `index` was left out."""
        return index in self._skipped

    def _remove_halves(self) -> None:
        for part in (self.folder / layout.POINTS_FOLDER).glob(f"*{layout.PART_SUFFIX}"):
            part.unlink()

    def _make_folder(self) -> None:
        self.folder.parent.mkdir(parents=True, exist_ok=True)
        self.folder.mkdir()
        self._made = True
        (self.folder / layout.POINTS_FOLDER).mkdir()
        sync_folder(self.folder.parent)

    def _remove_folder(self) -> None:
        """Take back what was made of a run that cannot be begun; it holds nothing yet."""
        if self._journal is not None:
            self._journal.close()
        if not self._made:
            return
        for name in (layout.RUN_FILE, layout.JOURNAL_FILE):
            with contextlib.suppress(OSError):
                (self.folder / name).unlink(missing_ok=True)
        for folder in (self.folder / layout.POINTS_FOLDER, self.folder):
            with contextlib.suppress(OSError):
                folder.rmdir()


def _line(state: str, point: int | None, more: dict[str, Any]) -> dict[str, Any]:
    """Return one line of the journal."""
    if state not in (POINT_STATES if point is not None else (*RUN_STATES, PLAN_CHANGED)):
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
