"""What all emulated instruments have in common: firmware that obeys requests, and a wire on which things go wrong."""

from __future__ import annotations

import threading
import time
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Final

import numpy as np

from sim_backend.clock import to_ns
from sim_backend.wire.faults import Fault, FaultPlan, Faults

if TYPE_CHECKING:
    from collections.abc import Callable

    from sim_backend.clock import VirtualClock

__all__ = ["Firmware", "Wire"]

_GARBAGE: Final = 37  # bytes
_LOOK_S: Final = 0.005  # so often the world's clock is looked at while a cable is out


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


class Wire(ABC):
    """A wire between a driver and emulated firmware.

    Parameters
    ----------
    firmware
        The instrument.
    faults
        What goes wrong, request by request.
    seed
        Of random bytes.
    """

    def __init__(self, firmware: Firmware, faults: Faults | None, seed: int) -> None:
        self.firmware = firmware
        self.faults = faults or Faults()
        self._random = np.random.default_rng(seed)
        self._put_back = threading.Event()
        self.clock: VirtualClock | None = None  #: of the world, if the time that a cable is out passes on it too

    def put_back(self) -> None:
        """Plug in a cable that is out before its time is over; one that is in goes in at once the next time."""
        self._put_back.set()

    @abstractmethod
    def _send(self, data: bytes) -> None: ...

    @abstractmethod
    def _plug_in(self) -> None: ...

    @abstractmethod
    def _unplug(self) -> None: ...

    def _answer(self, request: bytes) -> None:
        """Let the firmware obey a request, and the fault befall it that is due."""
        due = self.faults.due()
        if due is None:
            self.firmware.obey(request, self._send)
        elif due.fault is Fault.UNPLUGGED:
            # Before anybody notices that it is out, and lets time pass.
            until_ns = None if self.clock is None else self.clock.now_ns + to_ns(due.seconds)
            self._unplug()
            self._wait_for_the_cable(due.seconds, until_ns)
            self._plug_in()
        elif due.fault is Fault.REBOOT:
            self.firmware.reboot(self._send)
        else:
            sent = bytearray()
            self.firmware.obey(request, sent.extend)
            if due.fault is Fault.REPLY_LATE:
                time.sleep(due.seconds)
            self._send(self._spoilt(bytes(sent), due))

    def _wait_for_the_cable(self, seconds: float, until_ns: int | None) -> None:
        """Wait until it is put back: by somebody, or after these real seconds, or at a time of the world's clock."""
        until_s = time.monotonic() + seconds
        while not self._put_back.wait(min(_LOOK_S, max(0.0, until_s - time.monotonic()))):
            if time.monotonic() >= until_s or (self.clock and until_ns is not None and self.clock.now_ns >= until_ns):
                break
        self._put_back.clear()

    def _spoilt(self, sent: bytes, due: FaultPlan) -> bytes:
        """Return what comes in place of an answer."""
        spoilt: dict[Fault, Callable[[], bytes]] = {
            Fault.REPLY_LOST: lambda: b"",
            Fault.REPLY_CUT: lambda: sent[: len(sent) // 2],
            Fault.GARBAGE: lambda: self._random.integers(0, 256, _GARBAGE, np.uint8).tobytes(),
            Fault.ALARM: lambda: self.firmware.alarm() + sent,
        }
        return spoilt.get(due.fault, lambda: sent)()
