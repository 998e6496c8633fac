"""What a worker does: one point of a simulated run, on a station of its own, into a file.

The station is made anew for each point. A simulated point depends on itself alone (its seed, its settings, its
light), so the events are those that a run in one process has.
"""

from __future__ import annotations

import logging
import queue
import tempfile
import threading
from contextlib import contextmanager
from dataclasses import dataclass
from logging.handlers import QueueHandler
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from bench.compute.work import Failure
from bench.run.judging import Judge
from bench.run.recorder import Recorder
from bench.station import station_from
from bench.store.errors import RunError
from bench.store.layout import PART_SUFFIX
from bench.store.point_writer import PointWriter
from bench.store.run import sha256_of
from drivers.errors import DeviceError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bench.run.judging import Judged
    from bench.run.plan import PlannedPoint
    from protocols.points import Roi

__all__ = ["Measured", "NotMeasured", "PointJob", "measure"]

#: The largest file that is sent back over a network.
_MOST_BYTES: Final = 1 << 30
_logger: Final = logging.getLogger("evs_bench")


@dataclass(frozen=True, slots=True)
class PointJob:
    """A point, and all that a worker needs to measure it."""

    planned: PlannedPoint
    station: dict[str, Any]  #: resolved
    source: str  #: where the station was found, for messages
    roi: Roi  #: the run's window
    file: Path | None  #: where to leave the file; None to send its content back


@dataclass(frozen=True, slots=True)
class Measured:
    """A point that was measured."""

    index: int
    sha256: str  #: of the file
    content: bytes | None  #: of the file, unless it was left where it was asked for
    log: tuple[logging.LogRecord, ...]  #: what was logged meanwhile
    judged: Judged  #: what it is worth


@dataclass(frozen=True, slots=True)
class NotMeasured:
    """A point over which a device failed."""

    index: int
    failure: Failure
    log: tuple[logging.LogRecord, ...]


def measure(job: PointJob) -> Measured | NotMeasured:
    """Measure a point; its file is whole when this returns, unless a device failed.

    Raises
    ------
    RunError
        The file cannot be written, or is too large to be sent.
    """
    index = job.planned.point.index
    with _what_is_logged() as log:
        try:
            if job.file is not None:
                judged = _record(job, job.file)
                return Measured(index, sha256_of(job.file), None, tuple(log), judged)
            with tempfile.TemporaryDirectory(prefix="evs-bench-") as folder:
                file = Path(folder) / f"{index:06d}.h5{PART_SUFFIX}"
                judged = _record(job, file)
                return Measured(index, sha256_of(file), _content(index, file), tuple(log), judged)
        except DeviceError as error:
            return NotMeasured(index, Failure.of(error), tuple(log))


def _content(index: int, file: Path) -> bytes:
    size = file.stat().st_size
    if size > _MOST_BYTES:
        raise RunError(
            f"point {index}: its file has {size / 1e9:.2f} GB, and a worker sends at most "
            f"{_MOST_BYTES / 1e9:.2f} GB; run it with --workers, or take fewer pulses or pixels"
        )
    return file.read_bytes()


def _record(job: PointJob, file: Path) -> Judged:
    station = station_from(job.station, job.source)
    with station:
        station.connect()
        recorder = Recorder(station, job.roi)
        recorder.prepare(job.planned)
        with PointWriter(file) as writer:
            record, judged = Judge().record(recorder, job.planned, writer)
            writer.finish(record)
    return judged


class _Kept(QueueHandler):
    """Keeps what this thread logs, in a form that can be pickled."""

    def __init__(self) -> None:
        super().__init__(queue.SimpleQueue())
        self.records: list[logging.LogRecord] = []
        self._thread = threading.get_ident()

    def enqueue(self, record: logging.LogRecord) -> None:
        """Keep the record."""
        if record.thread == self._thread:
            self.records.append(record)


@contextmanager
def _what_is_logged() -> Iterator[list[logging.LogRecord]]:
    """Gather what this thread logs meanwhile, for the log of the run."""
    kept = _Kept()
    _logger.addHandler(kept)
    try:
        yield kept.records
    finally:
        _logger.removeHandler(kept)
