"""The firmware of an emulated EVK4: Treuzell questions in, answers out.

Public source: OpenEB 5.1.1, hal_psee_plugins, boards/treuzell.
"""

from __future__ import annotations

import errno
import struct
from typing import TYPE_CHECKING, Final

from sim_backend.wire.evk4_pixels import Evk4Sensor
from sim_backend.wire.evk4_registers import Refused, RegisterFile

if TYPE_CHECKING:
    from typing import Literal

    from sim_backend.devices.camera import BiasBehaviour
    from sim_backend.world import OpticalBench

__all__ = ["NOT_KNOWN", "Evk4Firmware"]

_WRITE: Final = 0x40000000
_REFUSED: Final = 0x80000000
_REG32: Final = 0x10102
_NAME: Final = b"CCam5 Imx636 Event-Based Camera\0"
_COMPATIBLE: Final = b"psee,ccam5_imx636\0psee,ccam5_gen42\0"

#: The answer to a question that nobody knows.
NOT_KNOWN: Final = struct.pack("<II", _REFUSED, 0)


class Evk4Firmware:
    """A camera from power on to power off.

    Parameters
    ----------
    world
        The world whose light the camera sees, and whose clock its waits are measured by.
    serial
        Serial number.
    release
        Release of the firmware, a byte each for major, minor and patch.
    bias_behaviour, dt_s, engine, seed
        See :class:`sim_backend.wire.evk4_pixels.Evk4Sensor`.
    """

    def __init__(
        self,
        world: OpticalBench,
        *,
        serial: int,
        release: int,
        bias_behaviour: BiasBehaviour,
        dt_s: float,
        engine: Literal["fast", "reference"] | None,
        seed: int,
    ) -> None:
        self.registers = RegisterFile()
        self.sensor = Evk4Sensor(
            world, self.registers, bias_behaviour=bias_behaviour, dt_s=dt_s, engine=engine, seed=seed
        )
        self._world = world
        self._plain = {
            0x71: struct.pack("<I", 1),
            0x72: struct.pack("<Q", serial),
            0x79: struct.pack("<I", release),
            0x7A: struct.pack("<Q", 1_600_000_000),
            0x10000: struct.pack("<I", 1),
        }

    def obey(self, question: bytes) -> bytes:
        """Do what a question asks, and return the answer."""
        if len(question) < 8 or len(question) != 8 + int.from_bytes(question[4:8], "little"):
            return NOT_KNOWN
        prop, payload = int.from_bytes(question[:4], "little"), question[8:]
        of_device = {0x10001: _NAME, 0x10003: _COMPATIBLE}
        if prop in self._plain:
            return struct.pack("<II", prop, len(self._plain[prop])) + self._plain[prop]
        if prop in of_device and payload == bytes(4):
            return struct.pack("<III", prop, 4 + len(of_device[prop]), 0) + of_device[prop]
        if prop & ~_WRITE == _REG32 and len(payload) == 12:
            return self._register(prop, *struct.unpack("<III", payload))
        return NOT_KNOWN

    def _register(self, prop: int, device: int, address: int, number: int) -> bytes:
        """Read or write a register."""
        now_ns = self._world.clock.now_ns
        try:
            if device != 0 or (not prop & _WRITE and number != 1):
                raise Refused(errno.EINVAL, "one register of device 0 at a time")
            if prop & _WRITE:
                self.registers.write(address, number, now_ns)
                return struct.pack("<IIII", prop, 8, device, address)
            value = self.registers.read(address, now_ns)
            return struct.pack("<IIIII", prop, 12, device, address, value)
        except Refused as refused:
            return struct.pack("<IIIII", prop | _REFUSED, 12, device, address, refused.code)
