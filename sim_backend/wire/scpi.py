"""An emulated instrument behind a network socket, as those that speak SCPI have it."""

from __future__ import annotations

import contextlib
import select
import socket
import threading
import weakref
from typing import TYPE_CHECKING, Final

from sim_backend.wire.wire import Wire

if TYPE_CHECKING:
    from sim_backend.wire.faults import Faults
    from sim_backend.wire.wire import Firmware

__all__ = ["ReservedPort", "ScpiWire"]

_CHUNK: Final = 65536
_HERE: Final = "127.0.0.1"


class ReservedPort:
    """A port of this computer that is kept for an instrument which is not switched on yet; calls are refused."""

    def __init__(self) -> None:
        self._socket = _bound(0)
        self._number = int(self._socket.getsockname()[1])
        self._let_go = weakref.finalize(self, self._socket.close)

    @property
    def address(self) -> str:
        """Where the driver finds the instrument."""
        return f"tcp://{_HERE}:{self._number}"

    def use(self) -> int:
        """Return the number of the port, which the instrument now takes."""
        self._let_go()
        return self._number


class ScpiWire(Wire):
    """The network socket of an emulated instrument, on this computer alone; one driver at a time.

    The port stays the same when the cable is out and in again; while it is out, calls are refused.

    Parameters
    ----------
    firmware
        The instrument.
    faults
        What goes wrong, request by request. A request is a line, whether it has an answer or not.
    seed
        Of random bytes.
    port
        Number of the port; 0: any that is free.
    """

    def __init__(self, firmware: Firmware, faults: Faults | None = None, seed: int = 0, port: int = 0) -> None:
        super().__init__(firmware, faults, seed)
        self._port = port
        self._listener: socket.socket | None = None
        self._caller: socket.socket | None = None
        self._closed = threading.Event()
        self._wake, self._waker = socket.socketpair()  # a byte on it ends the thread's waiting
        self._plug_in()
        self._thread = threading.Thread(target=self._live, name=f"wire {self.address}", daemon=True)
        self._thread.start()

    @property
    def address(self) -> str:
        """Where the driver finds the instrument."""
        return f"tcp://{_HERE}:{self._port}"

    def close(self) -> None:
        """Switch the instrument off; harmless if it is."""
        if not self._closed.is_set():
            self._closed.set()
            self.put_back()
            self._waker.send(b"x")
            self._thread.join()
            self._unplug()
            self._wake.close()
            self._waker.close()

    def _plug_in(self) -> None:
        listener = _bound(self._port)
        listener.listen(1)
        self._port = int(listener.getsockname()[1])
        self._listener = listener

    def _unplug(self) -> None:
        listener, self._listener = self._listener, None
        if listener is not None:
            listener.close()  # first, so that who notices that the cable is out cannot come in again
        self._hang_up()

    def _hang_up(self) -> None:
        caller, self._caller = self._caller, None
        if caller is not None:
            caller.close()

    def _live(self) -> None:
        buffer = bytearray()
        while not self._closed.is_set():
            caller = self._caller
            if caller is None:
                buffer.clear()
                self._accept()
                continue
            buffer += self._read(caller)
            for request in self.firmware.requests_in(buffer):
                self._answer(request)
                if self._caller is not caller:
                    break  # the cable was out: what else was on its way is lost

    def _comes(self, waited_for: socket.socket) -> bool:
        """Wait; return whether something comes, and not the end."""
        return waited_for in select.select([waited_for, self._wake], [], [])[0] and not self._closed.is_set()

    def _accept(self) -> None:
        if self._listener is not None and self._comes(self._listener):
            with contextlib.suppress(OSError):
                self._caller, _ = self._listener.accept()
                self._caller.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def _read(self, caller: socket.socket) -> bytes:
        if not self._comes(caller):
            return b""
        try:
            data = caller.recv(_CHUNK)
        except OSError:
            data = b""
        if not data:
            self._hang_up()  # the driver did
        return data

    def _send(self, data: bytes) -> None:
        if self._caller is not None and data:
            try:
                self._caller.sendall(data)
            except OSError:
                self._hang_up()  # nobody listens


def _bound(port: int) -> socket.socket:
    bound = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    bound.bind((_HERE, port))
    return bound
