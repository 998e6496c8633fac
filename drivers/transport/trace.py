"""Every byte that goes over a link, with its time, in a text file."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal

from drivers.clock import RealClock

if TYPE_CHECKING:
    from drivers.clock import Clock

__all__ = ["Trace"]

_HEAD: Final = "# evs-bench-trace/1: seconds, device, > sent or < received or ! noted, bytes as a Python literal\n"
_MARKS: Final = {"sent": ">", "received": "<", "noted": "!"}


class Trace:
    """A text file with one line for each write and read of any link; threads may share it.

    Parameters
    ----------
    path
        The file; what it held is gone.
    clock
        Whose time is written; None for the real clock.
    """

    def __init__(self, path: Path | str, clock: Clock | None = None) -> None:
        self._clock = clock or RealClock()
        self._begin = self._clock.now()
        self._lock = threading.Lock()
        self._file = Path(path).open("w", encoding="utf-8", buffering=1)  # noqa: SIM115 - close() closes it
        self._file.write(_HEAD)

    def add(self, device: str, what: Literal["sent", "received", "noted"], data: bytes) -> None:
        """Add a line; nothing is written once the trace is closed."""
        with self._lock:
            if not self._file.closed:
                seconds = self._clock.now() - self._begin
                self._file.write(f"{seconds:.6f} {device.replace(' ', '_')} {_MARKS[what]} {bytes(data)!r}\n")

    def close(self) -> None:
        """Close the file; harmless if it is closed."""
        with self._lock:
            self._file.close()
