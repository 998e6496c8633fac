"""Commands and questions in SCPI: every command is followed by the question for its error."""

from __future__ import annotations

import contextlib
import math
import re
from typing import TYPE_CHECKING, Final
from urllib.parse import urlsplit

from drivers.errors import ConnectionFailed, DeviceTimeout, UnexpectedAnswer
from drivers.transport.link import Link
from drivers.transport.ports import SocketPort, UsbTmcPort
from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivers.transport.ports import BytePort
    from drivers.transport.trace import Trace

__all__ = ["ScpiTalk", "number_of", "port_at"]

#: SCPI 1999.0, 21.8: a number, a comma and a quoted text; some instruments leave the quotes away.
_ERROR: Final = re.compile(r'\s*([+-]?\d{1,6})\s*,\s*("[^"]*"|[^",]*)\s*')
_MOST_STALE_LINES: Final = 20


class ScpiTalk:
    """A link to an instrument that speaks SCPI, line by line.

    SCPI answers do not say to what they are the answer. After one that was lost, came late or made no sense, the
    next exchange therefore asks who the instrument is, and throws away every line until it says so. After the
    connection broke, the next exchange opens it again.

    Parameters
    ----------
    port
        Where the instrument is.
    device
        Name of the device, for messages.
    timeout_s
        How long an answer may take, s of real time.
    """

    def __init__(self, port: BytePort, device: str, timeout_s: float) -> None:
        self._link = Link(port, device, timeout_s)
        self._device = device
        self._identity = ""
        self._in_step = True
        self._broken = False

    def trace_to(self, trace: Trace | None) -> None:
        """Write every byte into `trace` from now on; None: no more."""
        self._link.trace = trace

    def open(self) -> tuple[str, str, str, str]:
        """Open the link, and return maker, model, serial number and firmware version as the instrument tells them."""
        self._in_step, self._broken, self._identity = True, False, ""
        self._link.open()
        try:
            identity = self.ask("*IDN?")
            fields = [field.strip() for field in identity.split(",", 3)]
            if len(fields) != 4 or not all(fields) or not identity.isprintable():
                raise UnexpectedAnswer(
                    self._device, "say who it is (*IDN?)", repr(identity), "is it this device, at this address?"
                )
        except BaseException:
            self._link.close()
            raise
        self._identity = identity
        return fields[0], fields[1], fields[2], fields[3]

    def close(self) -> None:
        """Close the link; harmless if it is closed."""
        self._link.close()

    def ask(self, question: str) -> str:
        """Return the answer to `question`, without its line end."""
        with self._exchange(question):
            self._link.write(question.encode() + b"\n", question)
            return self._line(question)

    def ask_block(self, question: str, head: bytes, most: int) -> bytes:
        """Return the bytes of an answer that come after `head`; there may be line ends among them.

        Parameters
        ----------
        question
            What is asked.
        head
            What stands before the bytes; ``LENGTH, <n>B`` before it says how many follow.
        most
            So many bytes are expected at the most.

        Raises
        ------
        UnexpectedAnswer
            It is not said how many bytes follow, or there are more.
        """
        with self._exchange(question):
            self._link.write(question.encode() + b"\n", question)
            before = self._link.read_until(head, question)
            length = re.search(rb"LENGTH, ?(\d{1,9})B", before)
            if length is None or int(length[1]) > most:
                raise UnexpectedAnswer(self._device, question, repr(before[-200:]), f"{most} bytes were expected")
            data = self._link.read_exactly(int(length[1]), question)
            self._line(question)
            return data

    def tell(self, command: str, data: bytes | None = None) -> None:
        """Give a command.

        Parameters
        ----------
        command
            The command; what to call it in messages, where it has `data`.
        data
            What is sent in place of its text.

        Raises
        ------
        UnexpectedAnswer
            The instrument has an error to tell.
        """
        with self._exchange(command):
            self._link.write((command.encode() if data is None else data) + b"\n", command)
            self._link.write(b"SYST:ERR?\n", command)
            answer = self._line(command)
            error = _ERROR.fullmatch(answer)
            if error is None:
                raise UnexpectedAnswer(
                    self._device, command, f"{answer!r} to SYST:ERR?", "a number and a text were expected; try again"
                )
            if int(error[1]) != 0:
                self._link.write(b"*CLS\n", command)
        if int(error[1]) != 0:
            raise UnexpectedAnswer(
                self._device,
                command,
                f"error {int(error[1])} ({error[2].strip(chr(34))})",
                "is the dialect right, and can the instrument do this?",
            )

    def _line(self, asked: str) -> str:
        return self._link.read_until(b"\n", asked).decode("ascii", "replace").strip()

    @contextlib.contextmanager
    def _exchange(self, asked: str) -> Iterator[None]:
        """Hold the link, mended if need be, for one exchange."""
        try:
            if self._broken:
                self._link.close()
                self._link.open()
                self._broken = False
            with self._link.exchange(asked):
                if not self._in_step and self._identity:
                    self._find_step(asked)
                self._in_step = False
                yield
                self._in_step = True
        except ConnectionFailed:
            self._broken = True
            raise

    def _find_step(self, asked: str) -> None:
        """Throw away the answers to what was asked before: until the instrument says who it is."""
        self._link.write(b"*CLS\n", asked)
        self._link.write(b"*IDN?\n", asked)
        for _ in range(_MOST_STALE_LINES):
            if self._line(asked) == self._identity:
                return
        raise DeviceTimeout(
            self._device,
            asked,
            f"{_MOST_STALE_LINES} lines, and not who it is",
            "is it the same instrument as before?",
        )


def number_of(device: str, asked: str, answer: str) -> float:
    """Return the number that an answer is; raise :class:`UnexpectedAnswer` if it is none."""
    try:
        number = float(answer)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise UnexpectedAnswer(device, asked, repr(answer), "a number was expected; try again")
    return number


def port_at(address: str, timeout_s: float) -> BytePort:
    """Return the port at `address`: tcp://host:port, or the path of a file of the kernel's usbtmc driver.

    Raises
    ------
    InputError
        It is neither.
    """
    if address.startswith("/dev/"):
        return UsbTmcPort(address)
    try:
        parts = urlsplit(address)
        host, port = parts.hostname, parts.port
    except ValueError:
        host, port = None, None
    if not address.startswith("tcp://") or not host or not port:
        raise InputError(f"address is {address!r}; expected tcp://host:port or /dev/usbtmcN")
    return SocketPort(host, port, timeout_s)
