"""Where the bytes of a recording stay from the moment they come until somebody reads them."""

from __future__ import annotations

import os
import tempfile
import threading
import weakref
from dataclasses import dataclass
from typing import IO, TYPE_CHECKING, Final

from drivers.errors import WrongState

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

__all__ = ["Lost", "Spool", "raw_path"]

_IN_MEMORY: Final = 64 << 20  # bytes; longer recordings go to the disk
_BLOCK: Final = 1 << 20  # bytes that are handed out at once: with their events they fit a processor's cache
_PART: Final = ".part"


@dataclass(frozen=True, slots=True)
class Lost:
    """Transfers that the computer had no room for."""

    transfers: int
    size: int  #: bytes
    seconds: float  #: of the computer's clock, from the last transfer that was kept to the next one


class Spool:
    """The bytes of one recording, in order, and what is missing between them.

    Parameters
    ----------
    device
        Name of the camera, for messages.
    header
        What stands in front of the bytes in a file that is kept.
    path
        Of that file: it carries the name with ``.part`` behind it until :meth:`finish`. None: nothing is kept.
    """

    def __init__(self, device: str, header: bytes = b"", path: Path | None = None) -> None:
        self._device = device
        self._path = path
        self._begin = len(header) if path else 0
        self._size = 0
        self._lost: list[tuple[int, Lost]] = []
        self._closed = False
        self._lock = threading.Lock()
        self._file: IO[bytes]
        if path is None:
            self._keep(tempfile.SpooledTemporaryFile(max_size=_IN_MEMORY))  # noqa: SIM115
        else:
            self._keep(path.with_name(path.name + _PART).open("xb+"))
            self._file.write(header)

    @property
    def size(self) -> int:
        """Bytes so far."""
        return self._size

    def write(self, data: memoryview | bytes) -> None:
        """Add bytes."""
        self._file.write(data)
        self._size += len(data)

    def note_lost(self, lost: Lost) -> None:
        """Note that something is missing between what was added last and what will be next."""
        self._lost.append((self._size, lost))

    def finish(self, *, whole: bool) -> None:
        """Add nothing any more; if the recording is whole, let the file that is kept have its name."""
        self._file.flush()
        if self._path is not None and whole:
            os.fsync(self._file.fileno())
            self._file.close()
            part = self._path.with_name(self._path.name + _PART)
            part.replace(self._path)
            self._keep(self._path.open("rb"))

    def pieces(self) -> Iterator[bytes | Lost]:
        """Yield the bytes, and what is missing where it is missing."""
        at = 0
        for end, lost in [*self._lost, (self._size, None)]:
            while at < end:
                data = self._read(at, min(_BLOCK, end - at))
                at += len(data)
                yield data
            if lost is not None:
                yield lost

    def close(self) -> None:
        """Throw away what is not kept; harmless if that was done."""
        with self._lock:
            self._closed = True
            self._file.close()

    def _keep(self, file: IO[bytes]) -> None:
        """Use this file, and close it at the latest when nobody knows of the spool any more."""
        self._file = file
        weakref.finalize(self, file.close)

    def _read(self, at: int, size: int) -> bytes:
        with self._lock:
            if self._closed:
                raise WrongState(self._device, "read the recording", "it is gone", "read it before the next start()")
            self._file.seek(self._begin + at)
            data = self._file.read(size)
        if len(data) != size:
            raise WrongState(self._device, "read the recording", f"its file was cut to {at + len(data)} bytes")
        return data


def raw_path(folder: Path, label: str) -> Path:
    """Return where to keep a recording: its label, and a number if there is one of that name."""
    stem = "".join(c if c.isalnum() or c in "-_." else "_" for c in label).strip("._") or "recording"
    number, name = 1, f"{stem}.raw"
    while any((folder / taken).exists() for taken in (name, name + _PART)):
        number += 1
        name = f"{stem}-{number}.raw"
    return folder / name
