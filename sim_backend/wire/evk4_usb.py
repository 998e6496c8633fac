# ruff: noqa: ARG002 - pyusb says which arguments a backend gets
"""An emulated EVK4 on USB: a backend of pyusb, so that the real driver is what runs.

It hands out the stream of a recording once the sensor is stopped. It knows when nothing will come, and says so early:
a time-out takes a few ms, however long the driver would wait.
"""

from __future__ import annotations

import errno
import threading
import time
from collections import deque
from dataclasses import dataclass
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import usb.backend
import usb.core

from sim_backend.clock import to_ns
from sim_backend.wire.evk4_firmware import NOT_KNOWN, Evk4Firmware
from sim_backend.wire.faults import Fault, FaultPlan, Faults

if TYPE_CHECKING:
    from array import array
    from collections.abc import Callable, Iterator
    from typing import Literal

    from drivers.interfaces import Recording
    from sim_backend.devices.camera import BiasBehaviour
    from sim_backend.wire.evk4_registers import Operation
    from sim_backend.world import OpticalBench

__all__ = ["Evk4Usb"]

_COMMAND: Final = 0x02
_ANSWER: Final = 0x82
_EVENTS: Final = 0x81
_ENDPOINTS: Final = (_ANSWER, _COMMAND, _EVENTS)
_STRINGS: Final = {1: "Prophesee", 2: "EVK4"}

_RELEASE: Final = 0x00030900

_EARLY_S: Final = 2e-3  # a time-out
_GARBAGE: Final = 37  # bytes
_OF_A_RECORDING: Final = (Fault.OVERFLOW, Fault.TRIGGERS_MISSED, Fault.TRIGGERS_SWAPPED)


@dataclass
class _Answer:
    """An answer that waits to be read."""

    data: bytes
    late_s: float = 0.0  #: of the time for which a driver waits


@dataclass
class _Handle:
    """A device that somebody opened; dead once the cable was out."""

    plugged: int


class Evk4Usb(usb.backend.IBackend):  # type: ignore[misc]
    """A pyusb backend with one EVK4 on it.

    Faults are counted by question. What befalls the stream happens to the recording that is running at that question,
    or else to the next one.

    Parameters
    ----------
    world
        The world whose light the camera sees, and whose clock its waits are measured by.
    bias_behaviour, dt_s, engine
        See :class:`sim_backend.devices.camera.SimulatedCamera`.
    serial
        Serial number, eight hexadecimal digits.
    faults
        What goes wrong.
    seed
        Of random bytes and of what faults do to a recording.
    """

    def __init__(
        self,
        world: OpticalBench,
        *,
        bias_behaviour: BiasBehaviour,
        serial: str = "00001234",
        faults: Faults | None = None,
        dt_s: float = 1e-5,
        engine: Literal["fast", "reference"] | None = None,
        seed: int = 0,
    ) -> None:
        super().__init__()
        self.faults = faults or Faults()
        self.release = _RELEASE  #: release of the firmware
        self.bcd_device = 0x0400  #: release in the descriptor
        self.speed = 4  #: as libusb counts: USB 3
        self.queued_at_start = 0  #: reads of the stream that waited when the sensor was started last
        self._powered: Callable[[], Evk4Firmware] = lambda: Evk4Firmware(
            world,
            serial=int(serial, 16),
            release=self.release,
            bias_behaviour=bias_behaviour,
            dt_s=dt_s,
            engine=engine,
            seed=seed,
        )
        self._random = np.random.default_rng(seed)
        self._answers: deque[_Answer] = deque()
        self._unsent = memoryview(b"")
        self._condition = threading.Condition()
        self._queued = 0
        self._plugged = 0
        self._clock = world.clock
        self._gone_until_s: float | None = None
        self._gone_until_ns = 0
        self._switch_on()

    @property
    def log(self) -> list[Operation]:
        """What was read from and written to registers since the camera was plugged in."""
        return self._firmware.registers.log

    @property
    def register_values(self) -> dict[int, int]:
        """What stands in the registers."""
        return self._firmware.registers.values

    @property
    def state(self) -> str:
        """Whether the sensor is off, ready or streaming."""
        return self._firmware.registers.state

    def expect(self, recording: Recording) -> None:
        """Hear what a real camera is not told of the next recording: its seed, and what surrounds the sensor."""
        self._firmware.sensor.expect(recording)

    def replay(self, stream: bytes) -> None:
        """Send these words from the start of the next recording on, whatever the pixels do."""
        self._firmware.sensor.replay(stream)

    def unplug(self, seconds: float) -> None:
        """Pull the cable out, and put it in again after so many seconds, of real time or on the world's clock."""
        with self._condition:
            self._gone_until_s = time.monotonic() + seconds
            self._gone_until_ns = self._clock.now_ns + to_ns(seconds)
            self._plugged += 1
            self._firmware.sensor.power_off()
            self._switch_on()
            self._condition.notify_all()

    def enumerate_devices(self) -> Iterator[str]:
        """Yield the camera, if its cable is in."""
        if not self._is_gone():
            yield "evk4"

    def get_device_descriptor(self, dev: str) -> SimpleNamespace:
        """Return the descriptor of the camera."""
        return SimpleNamespace(
            bLength=18, bDescriptorType=1, bcdUSB=0x0300, bDeviceClass=0, bDeviceSubClass=0, bDeviceProtocol=0,
            bMaxPacketSize0=9, idVendor=0x04B4, idProduct=0x00F5, bcdDevice=self.bcd_device, iManufacturer=1,
            iProduct=2, iSerialNumber=0, bNumConfigurations=1, address=1, bus=1, port_number=1, port_numbers=(1,),
            speed=self.speed,
        )  # fmt: skip

    def get_configuration_descriptor(self, dev: str, config: int) -> SimpleNamespace:
        """Return the descriptor of the only configuration."""
        if config:
            raise IndexError(f"no configuration {config}")
        return SimpleNamespace(
            bLength=9, bDescriptorType=2, wTotalLength=39, bNumInterfaces=1, bConfigurationValue=1, iConfiguration=0,
            bmAttributes=0x80, bMaxPower=112, extra_descriptors=[],
        )  # fmt: skip

    def get_interface_descriptor(self, dev: str, intf: int, alt: int, config: int) -> SimpleNamespace:
        """Return the descriptor of the only interface."""
        if intf or alt or config:
            raise IndexError(f"no interface {intf}, {alt} in configuration {config}")
        return SimpleNamespace(
            bLength=9, bDescriptorType=4, bInterfaceNumber=0, bAlternateSetting=0, bNumEndpoints=3,
            bInterfaceClass=0xFF, bInterfaceSubClass=0x19, bInterfaceProtocol=0, iInterface=0, extra_descriptors=[],
        )  # fmt: skip

    def get_endpoint_descriptor(self, dev: str, ep: int, intf: int, alt: int, config: int) -> SimpleNamespace:
        """Return the descriptor of an endpoint."""
        return SimpleNamespace(
            bLength=7, bDescriptorType=5, bEndpointAddress=_ENDPOINTS[ep], bmAttributes=2, wMaxPacketSize=1024,
            bInterval=0, bRefresh=0, bSynchAddress=0, extra_descriptors=[],
        )  # fmt: skip

    def open_device(self, dev: str) -> _Handle:
        """Return a handle that lives until the cable is out."""
        if self._is_gone():
            raise _gone()
        return _Handle(self._plugged)

    def close_device(self, dev_handle: _Handle) -> None:
        """Let go of the camera; it goes on with what it does."""

    def get_configuration(self, dev_handle: _Handle) -> int:
        """Return the value of the active configuration."""
        return 1

    def set_configuration(self, dev_handle: _Handle, config_value: int) -> None:
        """Select the only configuration."""
        self._require_alive(dev_handle)

    def claim_interface(self, dev_handle: _Handle, intf: int) -> None:
        """Give the interface away."""
        self._require_alive(dev_handle)

    def release_interface(self, dev_handle: _Handle, intf: int) -> None:
        """Take the interface back."""
        self._require_alive(dev_handle)

    def set_interface_altsetting(self, dev_handle: _Handle, intf: int, altsetting: int) -> None:
        """Throw away what the camera had to say."""
        self._require_alive(dev_handle)
        self._answers.clear()

    def is_kernel_driver_active(self, dev_handle: _Handle, intf: int) -> bool:
        """Return that no kernel driver has the camera."""
        self._require_alive(dev_handle)
        return False

    def clear_halt(self, dev_handle: _Handle, ep: int) -> None:
        """Make an endpoint ready; refused while a read of it is queued, as Linux does."""
        self._require_alive(dev_handle)
        if ep == _EVENTS and self._queued:
            raise usb.core.USBError("Resource busy", -6, errno.EBUSY)

    def ctrl_transfer(
        self, dev_handle: _Handle, request_type: int, request: int, value: int, index: int, data: Any, timeout: int
    ) -> int:
        """Answer what is asked of endpoint 0: the texts of the descriptor, and which sensor it is."""
        self._require_alive(dev_handle)
        if (request_type, request) == (0xC0, 0x72):
            answer = b"\x31\x00"
        elif (request_type, request, value >> 8) == (0x80, 0x06, 0x03):
            text = _STRINGS.get(value & 0xFF, "").encode("utf-16-le") if value & 0xFF else b"\x09\x04"
            answer = bytes([len(text) + 2, 3]) + text
        else:
            raise usb.core.USBError("Pipe error", -9, errno.EPIPE)
        size = min(len(answer), len(data))
        memoryview(data)[:size] = answer[:size]
        return size

    def bulk_write(self, dev_handle: _Handle, ep: int, intf: int, data: array[int], timeout: int) -> int:
        """Take a question."""
        self._require_alive(dev_handle)
        if ep != _COMMAND:
            raise usb.core.USBError("Entity not found", -5, errno.ENOENT)
        due = self.faults.due()
        if due is not None and due.fault in (Fault.UNPLUGGED, Fault.REBOOT):
            self.unplug(due.seconds)
            raise _gone()
        if due is not None and due.fault in _OF_A_RECORDING:
            self._firmware.sensor.faults.append(due.fault)
            due = None
        sensor, queued = self._firmware.sensor, self._queued
        begun, ended = sensor.begun, sensor.ended
        answer = self._firmware.obey(data.tobytes())
        if sensor.begun != begun:
            self.queued_at_start = queued
        if sensor.begun != begun if sensor.replays else sensor.ended != ended:
            with self._condition:
                self._unsent = memoryview(sensor.stream)
                self._condition.notify_all()
        self._send(answer, due)
        return len(data)

    def bulk_read(self, dev_handle: _Handle, ep: int, intf: int, buff: array[int], timeout: int) -> int:
        """Hand out the next answer, or what fits of the stream."""
        self._require_alive(dev_handle)
        if ep == _ANSWER:
            return self._read_answer(buff, timeout * 1e-3)
        if ep != _EVENTS:
            raise usb.core.USBError("Entity not found", -5, errno.ENOENT)
        with self._condition:
            self._queued += 1
            try:
                self._condition.wait_for(
                    lambda: len(self._unsent) or self._is_dead(dev_handle), min(timeout * 1e-3, _EARLY_S)
                )
            finally:
                self._queued -= 1
            self._require_alive(dev_handle)
            size = min(len(self._unsent), len(buff))
            if not size:
                raise usb.core.USBTimeoutError("Operation timed out", -7, errno.ETIMEDOUT)
            memoryview(buff)[:size] = self._unsent[:size]
            self._unsent = self._unsent[size:]
        return size

    def _read_answer(self, buff: array[int], timeout_s: float) -> int:
        if not self._answers or self._answers[0].late_s > timeout_s:
            time.sleep(_EARLY_S)
            for answer in self._answers:
                answer.late_s -= timeout_s
            raise usb.core.USBTimeoutError("Operation timed out", -7, errno.ETIMEDOUT)
        data = self._answers.popleft().data
        size = min(len(data), len(buff))
        memoryview(buff)[:size] = data[:size]
        return size

    def _send(self, answer: bytes, due: FaultPlan | None) -> None:
        """Queue an answer, or what a fault makes of it."""
        fault = None if due is None else due.fault
        if fault is Fault.REPLY_LOST:
            return
        if fault is Fault.REPLY_CUT:
            answer = answer[: len(answer) // 2]
        elif fault is Fault.GARBAGE:
            answer = self._random.integers(0, 256, _GARBAGE, np.uint8).tobytes()
        elif fault is Fault.ALARM:
            self._answers.append(_Answer(NOT_KNOWN))
        self._answers.append(_Answer(answer, due.seconds if due and fault is Fault.REPLY_LATE else 0.0))

    def _switch_on(self) -> None:
        self._firmware = self._powered()
        self._answers.clear()
        self._unsent = memoryview(b"")

    def _is_gone(self) -> bool:
        if self._gone_until_s is None:
            return False
        if time.monotonic() >= self._gone_until_s or self._clock.now_ns >= self._gone_until_ns:
            self._gone_until_s = None
        return self._gone_until_s is not None

    def _is_dead(self, handle: _Handle) -> bool:
        return handle.plugged != self._plugged or self._is_gone()

    def _require_alive(self, handle: _Handle) -> None:
        if self._is_dead(handle):
            raise _gone()


def _gone() -> usb.core.USBError:
    return usb.core.USBError("No such device (it may have been disconnected)", -4, errno.ENODEV)
