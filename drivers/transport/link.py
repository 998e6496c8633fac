"""A link to an instrument that is asked and answers: one exchange at a time, never a byte of the one before."""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from typing import TYPE_CHECKING, Final

from drivers.errors import ConnectionFailed, DeviceTimeout, UnexpectedAnswer

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivers.transport.ports import BytePort
    from drivers.transport.trace import Trace

__all__ = ["Link"]

_log = logging.getLogger("evs_bench.devices")

_QUIET_S: Final = 0.05
_LONGEST_DRAIN_S: Final = 2.0
_SHOWN: Final = 80  # bytes of an answer that a message shows
_LONGEST_ANSWER: Final = 1 << 20  # bytes: no instrument here has more to say


class Link:
    """Questions and answers over a port. A driver owns one.

    After an answer that did not come, came in part or made no sense, what else comes belongs to nobody: the next
    exchange first waits until the line is quiet, and throws that away.

    Parameters
    ----------
    port
        It is opened by :meth:`open`.
    device
        Name of the device, for messages.
    timeout_s
        How long an answer may take, s, where nothing else is said. Of real time, whatever the clock of the station.
    quiet_s
        For how long nothing must come for the line to be quiet, s.
    """

    def __init__(self, port: BytePort, device: str, timeout_s: float = 1.0, quiet_s: float = _QUIET_S) -> None:
        self.port = port
        self.timeout_s = timeout_s
        self.trace: Trace | None = None
        self._device = device
        self._quiet_s = quiet_s
        self._lock = threading.RLock()
        self._rest = bytearray()
        self._in_step = True

    def open(self) -> None:
        """Open the port, and throw away what an earlier talk left in it.

        Raises
        ------
        ConnectionFailed
            It cannot be opened.
        """
        path = getattr(self.port, "path", "its port")
        try:
            self.port.open()
        except (OSError, ValueError) as error:
            raise ConnectionFailed(
                self._device, f"open {path}", str(error), "is it plugged in, switched on, and nobody else's?"
            ) from error
        self.drain("open the link")

    def close(self) -> None:
        """Close the port; harmless if it is closed."""
        with contextlib.suppress(OSError):
            self.port.close()

    @contextlib.contextmanager
    def exchange(self, asked: str) -> Iterator[None]:
        """Hold the link for a question and its answer; other threads wait.

        Parameters
        ----------
        asked
            What is asked, for messages.
        """
        with self._lock:
            if not self._in_step:
                thrown = self.drain(asked)
                _log.warning("%s: out of step; %d bytes thrown away", self._device, len(thrown))
            self._in_step = False
            yield
            self._in_step = True

    def lost_step(self) -> None:
        """Say that what comes next belongs to no question: the next exchange throws it away."""
        self._in_step = False

    def write(self, data: bytes, asked: str) -> None:
        """Send `data`.

        Raises
        ------
        ConnectionFailed
            The device is gone.
        """
        with self._failing(asked):
            self.port.write(data)
        self._note("sent", data)

    def read_until(self, end: bytes, asked: str, timeout_s: float | None = None) -> bytes:
        """Return what comes until `end`, without it.

        Raises
        ------
        DeviceTimeout
            It does not come in time; the message has what did.
        ConnectionFailed
            The device is gone.
        UnexpectedAnswer
            No end comes, but far more than any answer has.
        """
        seconds = self.timeout_s if timeout_s is None else timeout_s
        deadline = time.monotonic() + seconds
        while (at := self._rest.find(end)) < 0:
            if len(self._rest) > _LONGEST_ANSWER:
                raise UnexpectedAnswer(self._device, asked, f"{len(self._rest)} bytes without an end")
            if not self._receive(max(deadline - time.monotonic(), 0.0), asked) and time.monotonic() >= deadline:
                raise self._late(asked, seconds)
        found = bytes(self._rest[:at])
        del self._rest[: at + len(end)]
        return found

    def read_exactly(self, count: int, asked: str, timeout_s: float | None = None) -> bytes:
        """Return the next `count` bytes; raises as :meth:`read_until`."""
        seconds = self.timeout_s if timeout_s is None else timeout_s
        deadline = time.monotonic() + seconds
        while len(self._rest) < count:
            if not self._receive(max(deadline - time.monotonic(), 0.0), asked) and time.monotonic() >= deadline:
                raise self._late(asked, seconds)
        found = bytes(self._rest[:count])
        del self._rest[:count]
        return found

    def drain(self, asked: str, quiet_s: float | None = None) -> bytes:
        """Throw away what comes until the line is quiet, and return it.

        Raises
        ------
        UnexpectedAnswer
            It does not fall quiet.
        ConnectionFailed
            The device is gone.
        """
        thrown, self._rest = bytes(self._rest), bytearray()
        with self._failing(asked):
            if self.port.discard():
                return thrown
        deadline = time.monotonic() + _LONGEST_DRAIN_S
        while self._receive(self._quiet_s if quiet_s is None else quiet_s, asked):
            thrown += bytes(self._rest)
            self._rest.clear()
            if time.monotonic() > deadline:
                raise UnexpectedAnswer(
                    self._device, asked, f"does not fall quiet: {shown(thrown)}", "is it this device, at this speed?"
                )
        return thrown

    def _receive(self, timeout_s: float, asked: str) -> bool:
        """Take in what comes; return whether anything did."""
        with self._failing(asked):
            data = self.port.read(timeout_s)
        if data:
            self._rest += data
            self._note("received", data)
        return bool(data)

    def _late(self, asked: str, seconds: float) -> DeviceTimeout:
        came = f"only {shown(bytes(self._rest))}" if self._rest else "nothing"
        return DeviceTimeout(
            self._device, asked, f"{came} within {seconds:.3g} s", "is it switched on, and is the cable in?"
        )

    def _note(self, what: str, data: bytes) -> None:
        if self.trace is not None:
            self.trace.add(self._device, "sent" if what == "sent" else "received", data)

    @contextlib.contextmanager
    def _failing(self, asked: str) -> Iterator[None]:
        """Turn what a port raises into words."""
        try:
            yield
        except OSError as error:
            raise ConnectionFailed(
                self._device, asked, str(error) or type(error).__name__, "was it unplugged or switched off?"
            ) from error


def shown(data: bytes) -> str:
    """Return bytes as a message shows them."""
    return repr(data) if len(data) <= _SHOWN else f"{data[:_SHOWN]!r}... ({len(data)} bytes)"
