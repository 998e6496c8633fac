"""A file that HDF5 can write to without ever being told that the disk is full.

HDF5 cannot close a file whose writes fail, and no exception of any kind may pass through its C code: it takes the
whole process down. This file keeps the first error to itself, drops what comes after, and so lets HDF5 close in
peace; the writer asks it after each step.
"""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

__all__ = ["Sink"]


class Sink(io.RawIOBase):
    """A new file at `path`, open for reading and writing. Making it raises OSError like any other file."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._file = path.open("w+b", buffering=0)
        self._error: BaseException | None = None

    def check(self) -> None:
        """Raise the first error that any call met."""
        if self._error is not None:
            raise self._error

    def write(self, data: object) -> int:
        """Write all of `data` (bytes-like) at the current position; after an error, only pretend to."""
        view = memoryview(data).cast("B")  # type: ignore[arg-type]
        rest = view
        try:
            while rest and self._error is None:
                rest = rest[self._file.write(rest) :]
        except BaseException as error:  # noqa: BLE001 - see above; check() raises it
            self._error = error
        return len(view)

    def truncate(self, size: int | None = None) -> int:
        """Set the length of the file; after an error, only pretend to."""
        try:
            if self._error is None:
                return self._file.truncate(size)
        except BaseException as error:  # noqa: BLE001 - see above; check() raises it
            self._error = error
        return size or 0

    def readinto(self, buffer: object) -> int:
        """Read into `buffer`; what an error kept from the file reads as zeros."""
        view = memoryview(buffer).cast("B")  # type: ignore[arg-type]
        read = 0
        try:
            read = self._file.readinto(view) or 0
        except BaseException as error:  # noqa: BLE001 - see above; check() raises it
            self._error = self._error or error
        if self._error is not None and read < len(view):
            view[read:] = bytes(len(view) - read)
            return len(view)
        return read

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        """Go to a position; after an error, only pretend to."""
        try:
            return self._file.seek(offset, whence)
        except BaseException as error:  # noqa: BLE001 - see above; check() raises it
            self._error = self._error or error
        return offset

    def tell(self) -> int:
        """Return the position; 0 if the file does not tell."""
        try:
            return self._file.tell()
        except BaseException as error:  # noqa: BLE001 - see above; check() raises it
            self._error = self._error or error
        return 0

    def readable(self) -> bool:
        """Return True."""
        return True

    def writable(self) -> bool:
        """Return True."""
        return True

    def seekable(self) -> bool:
        """Return True."""
        return True

    def close(self) -> None:
        """Close the file; an error of this is kept like that of a write."""
        if not self.closed:
            try:
                self._file.close()
            except BaseException as error:  # noqa: BLE001 - see above; check() raises it
                self._error = self._error or error
            super().close()
