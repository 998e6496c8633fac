"""A link to a USB instrument with bulk endpoints, through pyusb."""

from __future__ import annotations

import contextlib
import errno
import importlib
import importlib.util
import logging
import threading
from typing import TYPE_CHECKING, Any, Final

from drivers.errors import ConnectionFailed, DeviceError, DeviceTimeout, UnexpectedAnswer

if TYPE_CHECKING:
    from array import array
    from collections.abc import Callable, Iterator

    from drivers.transport.trace import Trace

__all__ = ["UsbLink"]

_log = logging.getLogger("evs_bench.devices")

_QUIET_S: Final = 0.05
_MOST_DRAINED: Final = 256  # answers: no instrument here has more of them waiting
_INTERFACE: Final = 0
_SUPER_SPEED: Final = 4  # as libusb counts speeds; the first that is USB 3


class UsbLink:
    """Bulk transfers to and from one of the devices of a kind. A driver owns one.

    Parameters
    ----------
    vendor, product
        Numbers by which the kind is known.
    device
        Name of the device, for messages.
    backend
        A backend of pyusb; None for libusb: the one that the package libusb-package brings if it is installed, else
        the one that pyusb finds.
    timeout_s
        How long a transfer may take, s, where nothing else is said.
    """

    def __init__(
        self, vendor: int, product: int, device: str, *, backend: Any = None, timeout_s: float = 1.0
    ) -> None:
        self.timeout_s = timeout_s
        self.trace: Trace | None = None
        self._kind = (vendor, product)
        self._device = device
        self._backend = backend
        self._usb: Any = None
        self._lock = threading.RLock()
        self._in_step = True

    @property
    def bcd_device(self) -> int:
        """Release number in the device's descriptor, binary coded decimal."""
        return int(self._opened("read the descriptor").bcdDevice)

    @property
    def is_super_speed(self) -> bool:
        """Whether the device is connected through USB 3; also where the speed is not known."""
        speed = self._opened("read the speed").speed
        return speed is None or int(speed) == 0 or int(speed) >= _SUPER_SPEED

    def open(self, serial: str | None, ask_serial: Callable[[], str]) -> None:
        """Open the device whose serial number is `serial`.

        Parameters
        ----------
        serial
            None if there is only one of the kind.
        ask_serial
            Asks the device that is open at that time for its serial number.

        Raises
        ------
        ConnectionFailed
            There is no such device, more than one, or it cannot be opened.
        """
        candidates = self._candidates()
        if serial is None and len(candidates) > 1:
            raise ConnectionFailed(
                self._device, "open it", f"there are {len(candidates)} of its kind", "say which by its serial number"
            )
        seen = []
        for candidate in candidates:
            self._attach(candidate)
            if serial is None:
                return
            found = self._asked_serial(ask_serial)
            if found.lower() == serial.lower():
                return
            seen.append(found)
            self.close()
        wanted = self._name() if serial is None else f"{self._name()} with serial number {serial}"
        there = f"there is only {', '.join(seen)}" if seen else "no such device on USB"
        raise ConnectionFailed(self._device, f"find {wanted}", there, "is it plugged in, and does its light shine?")

    def close(self) -> None:
        """Let go of the device; harmless if it is not open."""
        opened, self._usb = self._usb, None
        if opened is not None:
            import usb.util

            with contextlib.suppress(OSError):
                usb.util.dispose_resources(opened)

    @contextlib.contextmanager
    def exchange(self) -> Iterator[bool]:
        """Hold the link for a question and its answer; other threads wait.

        Yields whether the exchange before came to its end. Where it did not, what comes next may belong to it.
        """
        with self._lock:
            was_in_step, self._in_step = self._in_step, False
            yield was_in_step
            self._in_step = True

    def set_alternate(self, asked: str) -> None:
        """Select alternate setting 0 of the interface: the device throws away what it had to say."""
        with self._failing(asked):
            self._opened(asked).set_interface_altsetting(_INTERFACE, 0)

    def clear_halt(self, endpoint: int, asked: str) -> None:
        """Make an endpoint ready; never while a read of it is queued, or it stays dead."""
        with self._failing(asked):
            self._opened(asked).clear_halt(endpoint)

    def write(self, endpoint: int, data: bytes, asked: str) -> None:
        """Send `data` in one transfer.

        Raises
        ------
        ConnectionFailed
            The device is gone.
        DeviceTimeout
            It does not take the data.
        """
        with self._failing(asked):
            sent = self._opened(asked).write(endpoint, data, self._ms(self.timeout_s))
        self._note("sent", data[:sent])
        if sent != len(data):
            raise DeviceTimeout(self._device, asked, f"took only {sent} of {len(data)} bytes")

    def read(self, endpoint: int, size: int, asked: str, timeout_s: float | None = None) -> bytes:
        """Return what comes in one transfer of at most `size` bytes.

        Raises
        ------
        ConnectionFailed
            The device is gone.
        DeviceTimeout
            Nothing comes.
        """
        seconds = self.timeout_s if timeout_s is None else timeout_s
        with self._failing(asked):
            data = bytes(self._opened(asked).read(endpoint, size, self._ms(seconds)))
        self._note("received", data)
        return data

    def read_into(self, endpoint: int, buffer: array[int], asked: str, timeout_s: float) -> int:
        """Fill `buffer` with one transfer, and return its size, or 0 if nothing came in time. It is not traced.

        Raises
        ------
        ConnectionFailed
            The device is gone.
        """
        try:
            with self._failing(asked):
                return int(self._opened(asked).read(endpoint, buffer, self._ms(timeout_s)))
        except DeviceTimeout:
            return 0

    def drain(self, endpoint: int, size: int, asked: str) -> bytes:
        """Throw away what comes until nothing does, and return it.

        Raises
        ------
        UnexpectedAnswer
            It does not fall quiet.
        """
        thrown = b""
        for _ in range(_MOST_DRAINED):
            try:
                thrown += self.read(endpoint, size, asked, _QUIET_S)
            except DeviceTimeout:
                return thrown
        raise UnexpectedAnswer(self._device, asked, f"does not fall quiet, {len(thrown)} bytes", "unplug it once")

    def _candidates(self) -> list[Any]:
        import usb.core

        vendor, product = self._kind
        backend = _libusb() if self._backend is None else self._backend
        with self._failing(f"look for {self._name()}"):
            return list(usb.core.find(find_all=True, backend=backend, idVendor=vendor, idProduct=product))

    def _attach(self, found: Any) -> None:
        """Open one of the candidates, and take its interface from the kernel and everybody else."""
        import usb.util

        self._usb = found
        self._in_step = True
        asked = "open it"
        try:
            with contextlib.suppress(NotImplementedError), self._failing(asked):
                if found.is_kernel_driver_active(_INTERFACE):
                    found.detach_kernel_driver(_INTERFACE)
            with self._failing(asked):
                usb.util.claim_interface(found, _INTERFACE)
        except DeviceError:
            self.close()
            raise

    def _asked_serial(self, ask_serial: Callable[[], str]) -> str:
        try:
            return ask_serial()
        except BaseException:
            self.close()
            raise

    def _opened(self, asked: str) -> Any:
        if self._usb is None:
            raise ConnectionFailed(self._device, asked, "it is not open", "connect it first")
        return self._usb

    def _name(self) -> str:
        return "USB device {:04x}:{:04x}".format(*self._kind)

    @staticmethod
    def _ms(seconds: float) -> int:
        return max(round(seconds * 1000.0), 1)  # 0 would be for ever

    def _note(self, what: str, data: bytes) -> None:
        if self.trace is not None:
            self.trace.add(self._device, "sent" if what == "sent" else "received", data)

    @contextlib.contextmanager
    def _failing(self, asked: str) -> Iterator[None]:
        """Turn what pyusb raises into words."""
        import usb.core

        try:
            yield
        except usb.core.USBTimeoutError as error:
            raise DeviceTimeout(self._device, asked, "nothing within the time for it", "unplug it once") from error
        except usb.core.USBError as error:
            advice = "was it unplugged?"
            if error.errno in (errno.EACCES, errno.EPERM):
                advice = "allow users to open it, by a udev rule for its vendor, and plug it in again"
            elif error.errno == errno.EBUSY:
                advice = "close the other program that uses it"
            raise ConnectionFailed(self._device, asked, str(error), advice) from error
        except usb.core.NoBackendError as error:
            raise ConnectionFailed(
                self._device, asked, str(error), "install libusb, or the Python package libusb-package"
            ) from error
        except ValueError as error:  # an endpoint that this device does not have
            raise ConnectionFailed(self._device, asked, str(error), "is it this kind of device?") from error


def _libusb() -> Any:
    """Return the libusb that the package libusb-package brings, None if it is not installed."""
    if importlib.util.find_spec("libusb_package") is None:
        return None
    return importlib.import_module("libusb_package").get_libusb1_backend()
