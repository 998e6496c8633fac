"""A serial instrument behind a pseudo-terminal: firmware in a thread of its own (POSIX only)."""

from __future__ import annotations

import os
import select
import tempfile
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Final

from sim_backend.wire.wire import Wire

if TYPE_CHECKING:
    from sim_backend.wire.faults import Faults
    from sim_backend.wire.wire import Firmware

__all__ = ["SerialWire"]

_CHUNK: Final = 65536
_WAIT_S: Final = 0.05


class SerialWire(Wire):
    """The pseudo-terminal of an emulated instrument. The path stays the same when the cable is out and in again.

    Parameters
    ----------
    firmware
        The instrument.
    name
        Of the link that leads to the pseudo-terminal.
    faults
        What goes wrong, request by request.
    seed
        Of random bytes.
    folder
        Where that link lies; None for a folder of its own.
    """

    def __init__(
        self, firmware: Firmware, name: str, faults: Faults | None = None, seed: int = 0, folder: Path | None = None
    ) -> None:
        super().__init__(firmware, faults, seed)
        self._own = tempfile.TemporaryDirectory(prefix="evs-bench-wire-") if folder is None else None
        self._link = Path(self._own.name if self._own else folder or "") / name
        self._ends: tuple[int, int] | None = None
        self._closed = threading.Event()
        self._plug_in()
        self._thread = threading.Thread(target=self._live, name=f"wire {name}", daemon=True)
        self._thread.start()

    @property
    def path(self) -> str:
        """Where the driver finds the port."""
        return str(self._link)

    def close(self) -> None:
        """Switch the instrument off; harmless if it is."""
        self._closed.set()
        self.put_back()
        self._thread.join()
        self._unplug()
        if self._own:
            self._own.cleanup()

    def _plug_in(self) -> None:
        import pty
        import tty

        inner, outer = pty.openpty()
        tty.setraw(outer)
        self._ends = (inner, outer)  # the outer end stays open here, so that a driver may close it and come again
        self._link.unlink(missing_ok=True)
        self._link.symlink_to(os.ttyname(outer))

    def _unplug(self) -> None:
        ends, self._ends = self._ends, None
        if ends is not None:
            self._link.unlink(missing_ok=True)
            for end in ends:
                os.close(end)

    def _live(self) -> None:
        buffer = bytearray()
        while not self._closed.is_set():
            data = self._read()
            if not data:
                continue
            buffer += data
            for request in self.firmware.requests_in(buffer):
                self._answer(request)

    def _read(self) -> bytes:
        if self._ends is None:
            return b""
        ready, _, _ = select.select([self._ends[0]], [], [], _WAIT_S)
        try:
            return os.read(self._ends[0], _CHUNK) if ready else b""
        except OSError:
            return b""  # the driver is away

    def _send(self, data: bytes) -> None:
        if self._ends is not None and data:
            try:
                os.write(self._ends[0], data)
            except OSError:
                return  # nobody listens
