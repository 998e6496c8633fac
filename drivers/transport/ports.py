"""Ports that carry bytes: a serial port, a network socket, a file of the kernel's usbtmc driver."""

from __future__ import annotations

import contextlib
import errno
import logging
import os
import socket
import sys
from pathlib import Path
from typing import Any, Final, Protocol

__all__ = ["BytePort", "SerialPort", "SocketPort", "UsbTmcPort"]

_log = logging.getLogger("evs_bench.devices")

_CHUNK: Final = 65536
_WRITE_TIMEOUT_S: Final = 5.0


class BytePort(Protocol):
    """What a link needs of a port. Failures are `OSError`."""

    def open(self) -> None:
        """Open it; harmless if it is open."""

    def close(self) -> None:
        """Close it; harmless if it is closed."""

    def write(self, data: bytes) -> None:
        """Write all of `data`."""

    def read(self, timeout_s: float) -> bytes:
        """Return what has come, at least one byte, or nothing after `timeout_s`."""

    def discard(self) -> bool:
        """Throw away what waits unread, and return True; False where reading until all is quiet does it."""


class SerialPort:
    """A serial port, 8N1, nobody else's while it is open.

    Parameters
    ----------
    path
        Name of the port (/dev/ttyUSB0, /dev/serial/by-id/..., COM3).
    baud
        Bits per second.
    """

    def __init__(self, path: str, baud: int) -> None:
        self.path = path
        self._baud = baud
        self._port: Any = None

    def open(self) -> None:
        """Open it, and let an FTDI chip pass on replies at once instead of every 16 ms, where that can be set."""
        import serial

        if self._port is not None:
            return
        self._port = serial.Serial(
            self.path, self._baud, timeout=0.0, write_timeout=_WRITE_TIMEOUT_S, exclusive=os.name == "posix" or None
        )
        with contextlib.suppress(AttributeError, ValueError, OSError, NotImplementedError):
            self._port.set_low_latency_mode(True)

    def close(self) -> None:
        """Close it; harmless if it is closed."""
        port, self._port = self._port, None
        if port is not None:
            port.close()

    def write(self, data: bytes) -> None:
        """Write all of `data`."""
        port = self._opened()
        try:
            port.write(data)
            port.flush()
        except Exception as error:
            if isinstance(error, OSError) or type(error).__module__ != "termios":
                raise
            raise OSError(*error.args) from error  # termios.error, of a cable that is out, is no OSError

    def read(self, timeout_s: float) -> bytes:
        """Return what has come, at least one byte, or nothing after `timeout_s`."""
        port = self._opened()
        port.timeout = max(timeout_s, 0.0)
        first = port.read(1)
        return bytes(first + port.read(port.in_waiting)) if first else b""

    def discard(self) -> bool:
        """Return False: what waits can be read."""
        return False

    @property
    def fd(self) -> int:
        """File descriptor, for a process that goes on with the open port (POSIX only)."""
        return int(self._opened().fileno())

    def _opened(self) -> Any:
        if self._port is None:
            raise OSError(f"port {self.path} is not open")
        return self._port


class SocketPort:
    """A TCP connection to an instrument.

    Parameters
    ----------
    host, port
        Where it listens.
    connect_timeout_s
        How long to wait for it to answer the call.
    """

    def __init__(self, host: str, port: int, connect_timeout_s: float = 5.0) -> None:
        self.path = f"{host}:{port}"
        self._address = (host, port)
        self._connect_timeout_s = connect_timeout_s
        self._socket: socket.socket | None = None

    def open(self) -> None:
        """Open it; harmless if it is open."""
        if self._socket is None:
            self._socket = socket.create_connection(self._address, self._connect_timeout_s)
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def close(self) -> None:
        """Close it; harmless if it is closed."""
        opened, self._socket = self._socket, None
        if opened is not None:
            opened.close()

    def write(self, data: bytes) -> None:
        """Write all of `data`."""
        opened = self._opened()
        opened.settimeout(_WRITE_TIMEOUT_S)
        opened.sendall(data)

    def read(self, timeout_s: float) -> bytes:
        """Return what has come, at least one byte, or nothing after `timeout_s`."""
        opened = self._opened()
        opened.settimeout(max(timeout_s, 1e-4))
        try:
            data = opened.recv(_CHUNK)
        except TimeoutError:
            return b""
        if not data:
            raise ConnectionResetError(f"{self.path} closed the connection")
        return data

    def discard(self) -> bool:
        """Return False: what waits can be read."""
        return False

    def _opened(self) -> socket.socket:
        if self._socket is None:
            raise OSError(f"connection to {self.path} is not open")
        return self._socket


class UsbTmcPort:
    """An instrument behind the kernel's usbtmc driver: one write is a message, one read asks for its answer (Linux).

    A read when nothing was asked is an error of its own, so that there is no listening until the line is quiet;
    :meth:`discard` clears the instrument's buffers instead. Requests: Linux, include/uapi/linux/usb/tmc.h.

    Parameters
    ----------
    path
        /dev/usbtmc0, for example.
    """

    _CLEAR: Final = 0x5B02  # _IO('[', 2)
    _SET_TIMEOUT: Final = 0x40045B0A  # _IOW('[', 10, u32), ms
    _SHORTEST_MS: Final = 100

    def __init__(self, path: str) -> None:
        self.path = path
        self._fd: int | None = None

    def open(self) -> None:
        """Open it, for this process alone; harmless if it is open."""
        import fcntl

        if self._fd is not None:
            return
        fd = os.open(Path(self.path), os.O_RDWR)
        try:
            fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            os.close(fd)
            raise OSError(errno.EBUSY, "another program is using it", self.path) from error
        self._fd = fd

    def close(self) -> None:
        """Close it; harmless if it is closed."""
        fd, self._fd = self._fd, None
        if fd is not None:
            os.close(fd)

    def discard(self) -> bool:
        """Clear the buffers of the instrument."""
        self._control(self._CLEAR, 0)
        return True

    def write(self, data: bytes) -> None:
        """Write all of `data`."""
        os.write(self._opened(), data)

    def read(self, timeout_s: float) -> bytes:
        """Return the answer to what was asked, or nothing after `timeout_s` (0.1 s at the least)."""
        self._control(self._SET_TIMEOUT, max(round(1e3 * timeout_s), self._SHORTEST_MS))
        try:
            return os.read(self._opened(), _CHUNK)
        except TimeoutError:
            return b""

    def _control(self, request: int, value: int) -> None:
        import fcntl

        fcntl.ioctl(self._opened(), request, value.to_bytes(4, sys.byteorder) if value else 0)

    def _opened(self) -> int:
        if self._fd is None:
            raise OSError(f"{self.path} is not open")
        return self._fd
