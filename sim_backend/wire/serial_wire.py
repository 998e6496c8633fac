"""A serial instrument behind a pseudo-terminal: firmware in a thread of its own (POSIX only)."""

from __future__ import annotations

import os
import select
import tempfile
import threading
import time
from abc import ABC, abstractmethod
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from sim_backend.wire.faults import Fault, FaultPlan, Faults

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["Firmware", "SerialWire"]

_CHUNK: Final = 65536
_WAIT_S: Final = 0.05
_GARBAGE: Final = 37  # bytes


class Firmware(ABC):
    """What an instrument does with the bytes that it gets, on the clock of the world that it was made with."""

    @abstractmethod
    def requests_in(self, buffer: bytearray) -> list[bytes]:
        """Take the whole requests off the front of `buffer`, and return them; what is not whole stays."""

    @abstractmethod
    def obey(self, request: bytes, send: Callable[[bytes], None]) -> None:
        """Do what a request asks, and send what the instrument sends, piece by piece."""

    @abstractmethod
    def reboot(self, send: Callable[[bytes], None]) -> None:
        """Lose the power for a moment: be as after switching on, and send what it then sends."""

    def alarm(self) -> bytes:
        """Return what the instrument says when something happens that nobody asked for."""
        return b""


class SerialWire:
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
        self.firmware = firmware
        self.faults = faults or Faults()
        self._random = np.random.default_rng(seed)
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

    def _answer(self, request: bytes) -> None:
        due = self.faults.due()
        if due is None:
            self.firmware.obey(request, self._send)
        else:
            self._fail(request, due)

    def _fail(self, request: bytes, due: FaultPlan) -> None:
        if due.fault is Fault.UNPLUGGED:
            self._unplug()
            time.sleep(due.seconds)
            self._plug_in()
            return
        if due.fault is Fault.REBOOT:
            self.firmware.reboot(self._send)
            return
        sent = bytearray()
        self.firmware.obey(request, sent.extend)
        if due.fault is Fault.REPLY_LATE:
            time.sleep(due.seconds)
            self._send(bytes(sent))
        elif due.fault is Fault.REPLY_CUT:
            self._send(bytes(sent[: len(sent) // 2]))
        elif due.fault is Fault.GARBAGE:
            self._send(self._random.integers(0, 256, _GARBAGE, np.uint8).tobytes())
        elif due.fault is Fault.ALARM:
            self._send(self.firmware.alarm() + bytes(sent))
        elif due.fault is not Fault.REPLY_LOST:
            self._send(bytes(sent))
