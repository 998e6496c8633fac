"""Treuzell: questions and answers of Prophesee's USB controllers, one answer for each question.

A frame is a property, the number of bytes that follow, and these, all in little-endian 32-bit words (public source:
OpenEB 5.1.1, hal_psee_plugins, boards/treuzell). A write sets a bit of the property; a refusal sets another one in
the answer.
"""

from __future__ import annotations

import errno
import logging
import struct
from enum import IntEnum
from typing import TYPE_CHECKING, Final

from drivers.errors import DeviceError, UnexpectedAnswer

if TYPE_CHECKING:
    from drivers.transport.usb_link import UsbLink

__all__ = ["ANSWER", "COMMAND", "EVENTS", "Property", "Treuzell", "frame", "parse_answer", "parse_register"]

_log = logging.getLogger("evs_bench.devices")

COMMAND: Final = 0x02  #: bulk endpoint for questions
ANSWER: Final = 0x82  #: bulk endpoint for answers
EVENTS: Final = 0x81  #: bulk endpoint of the event stream

_WRITE: Final = 0x40000000
_REFUSED: Final = 0x80000000
_HEAD: Final = struct.Struct("<II")
_LONGEST_ANSWER: Final = 1024
_MOST_STALE: Final = 64  # answers that may wait in front of the one that is looked for
_SENSOR: Final = 0  # number of the device behind the controller


class Property(IntEnum):
    """What can be asked."""

    SERIAL = 0x72
    RELEASE_VERSION = 0x79
    BUILD_DATE = 0x7A
    DEVICE_NAME = 0x10001
    DEVICE_COMPATIBLE = 0x10003
    DEVICE_REG32 = 0x10102


#: Asked to find the place in the row of answers again; any that every camera knows will do.
_LANDMARKS: Final = (Property.RELEASE_VERSION, Property.BUILD_DATE, Property.SERIAL)


def frame(prop: int, payload: bytes) -> bytes:
    """Return the bytes of a question."""
    return _HEAD.pack(prop, len(payload)) + payload


def parse_answer(device: str, asked: str, data: bytes, prop: int) -> bytes:
    """Return the payload of an answer to the question `prop`.

    Raises
    ------
    UnexpectedAnswer
        It is no frame, or none that answers this question.
    DeviceError
        The camera refused.
    """
    if len(data) < _HEAD.size:
        raise _odd(device, asked, data)
    answered, size = _HEAD.unpack_from(data)
    payload = data[_HEAD.size :]
    if size != len(payload):
        raise _odd(device, asked, data)
    if answered == prop:
        return payload
    if answered == _REFUSED:
        raise DeviceError(device, asked, "the camera does not know this", "is it an EVK4, with its own firmware?")
    if answered == prop | _REFUSED:
        raise DeviceError(device, asked, f"the camera refused: {_reason(prop, payload)}", "connect it anew")
    raise _odd(device, asked, data)


def parse_register(device: str, asked: str, payload: bytes, address: int, count: int) -> tuple[int, ...]:
    """Return the `count` values in the payload of an answer about registers.

    Raises
    ------
    UnexpectedAnswer
        It speaks of other registers, or of fewer.
    """
    if len(payload) >= 8 + 4 * count and len(payload) % 4 == 0:
        words = struct.unpack(f"<{len(payload) // 4}I", payload)
        if words[:2] == (_SENSOR, address) and len(words) == 2 + count:
            return words[2:]
    raise _odd(device, asked, payload)


class Treuzell:
    """Questions to the controller of a camera, and to the registers of its sensor.

    Parameters
    ----------
    link
        To the camera; whoever owns it opens and closes it.
    device
        Name of the camera, for messages.
    """

    def __init__(self, link: UsbLink, device: str) -> None:
        self._link = link
        self._device = device
        self._unanswered: set[int] = set()

    def ask(self, prop: int, payload: bytes, asked: str) -> bytes:
        """Return the payload of the answer to a question.

        Raises
        ------
        DeviceError
            There is no answer, it makes no sense, or the camera refuses.
        """
        with self._link.exchange() as in_step:
            if not in_step:
                self._find_step(asked)
            self._unanswered.add(prop)
            self._link.write(COMMAND, frame(prop, payload), asked)
            data = self._link.read(ANSWER, _LONGEST_ANSWER, asked)
            self._require_whole(asked, data, prop)
            self._unanswered.clear()
        return parse_answer(self._device, asked, data, prop)

    def number(self, prop: int, asked: str) -> int:
        """Return the number that is the answer to a question without arguments."""
        payload = self.ask(prop, b"", asked)
        if len(payload) not in (4, 8):
            raise _odd(self._device, asked, payload)
        return int.from_bytes(payload, "little")

    def texts(self, prop: int, asked: str) -> tuple[str, ...]:
        """Return the texts that the sensor's device has for a question."""
        payload = self.ask(prop, struct.pack("<I", _SENSOR), asked)
        if payload[:4] != struct.pack("<I", _SENSOR):
            raise _odd(self._device, asked, payload)
        return tuple(part.decode("ascii", "replace") for part in payload[4:].split(b"\0") if part)

    def read_register(self, address: int) -> int:
        """Return the value of a register of the sensor."""
        asked = f"read register 0x{address:04X}"
        payload = self.ask(Property.DEVICE_REG32, struct.pack("<III", _SENSOR, address, 1), asked)
        (value,) = parse_register(self._device, asked, payload, address, 1)
        return value

    def write_register(self, address: int, value: int) -> None:
        """Set a register of the sensor."""
        asked = f"write 0x{value:08X} to register 0x{address:04X}"
        payload = self.ask(Property.DEVICE_REG32 | _WRITE, struct.pack("<III", _SENSOR, address, value), asked)
        parse_register(self._device, asked, payload[:8], address, 0)

    def _require_whole(self, asked: str, data: bytes, prop: int) -> None:
        """Raise unless `data` is an answer to the question `prop`, be it a refusal: else a later one may come."""
        if len(data) >= _HEAD.size and len(data) == _HEAD.size + _HEAD.unpack_from(data)[1]:
            answered = _HEAD.unpack_from(data)[0]
            if answered in (prop, prop | _REFUSED, _REFUSED):
                return
        raise _odd(self._device, asked, data)

    def _find_step(self, asked: str) -> None:
        """Throw away answers until the one that was asked for here: the camera answers in turn.

        Waiting alone would not do: an answer that comes later than that looks like the answer to the next question.
        """
        thrown = self._link.drain(ANSWER, _LONGEST_ANSWER, asked)
        landmark = next((prop for prop in _LANDMARKS if prop not in self._unanswered), _LANDMARKS[0])
        self._unanswered.add(landmark)
        self._link.write(COMMAND, frame(landmark, b""), asked)
        for _ in range(_MOST_STALE):
            data = self._link.read(ANSWER, _LONGEST_ANSWER, asked)
            if data[:4] == struct.pack("<I", landmark):
                _log.warning("%s: out of step; %d bytes thrown away", self._device, len(thrown))
                self._unanswered.clear()
                return
            thrown += data
        raise _odd(self._device, asked, thrown)


def _reason(prop: int, payload: bytes) -> str:
    """Return why the camera refused: an error number, behind device and address or behind the device alone."""
    place = 2 if prop & ~_WRITE == Property.DEVICE_REG32 else 1
    number = payload[4 * place : 4 * place + 4]
    if len(number) < 4:
        return "it does not say why"
    code = abs(int.from_bytes(number, "little", signed=True))
    return f"error {errno.errorcode.get(code, code)}"


def _odd(device: str, asked: str, data: bytes) -> UnexpectedAnswer:
    text = data[:32].hex(" ") + (" ..." if len(data) > 32 else "")
    return UnexpectedAnswer(device, asked, f"came {len(data)} bytes: {text or 'none'}", "unplug it once")
