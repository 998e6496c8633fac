"""What goes wrong on USB, in words."""

from __future__ import annotations

import errno
from array import array
from typing import TYPE_CHECKING, Any

import pytest
import usb.core

from drivers.errors import ConnectionFailed, DeviceTimeout, UnexpectedAnswer
from drivers.transport.usb_link import UsbLink
from tests.drivers.camera.evk4_rigs import emulated

if TYPE_CHECKING:
    from collections.abc import Iterator


def opened() -> tuple[UsbLink, Any]:
    _, _, backend = emulated()
    link = UsbLink(0x04B4, 0x00F5, "camera", backend=backend, timeout_s=0.01)
    link.open(None, lambda: "")
    return link, backend


def failing(code: int) -> Any:
    def fail(*_: Any) -> None:
        raise usb.core.USBError("it failed", None, code)

    return fail


@pytest.mark.parametrize(
    ("code", "advice"), [(errno.EACCES, "udev rule"), (errno.EBUSY, "other program"), (errno.EIO, "unplugged")]
)
def test_a_device_that_cannot_be_claimed_says_what_to_do(code: int, advice: str) -> None:
    _, _, backend = emulated()
    backend.claim_interface = failing(code)  # type: ignore[method-assign]
    link = UsbLink(0x04B4, 0x00F5, "camera", backend=backend)
    with pytest.raises(ConnectionFailed, match=rf"camera: open it: .*it failed; .*{advice}"):
        link.open(None, lambda: "")
    with pytest.raises(ConnectionFailed, match="it is not open"):
        link.write(0x02, b"", "ask")


def test_a_computer_without_libusb_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    def find(**_: Any) -> None:
        raise usb.core.NoBackendError("No backend available")

    monkeypatch.setattr(usb.core, "find", find)
    with pytest.raises(ConnectionFailed, match=r"No backend available; install libusb, or .* libusb-package"):
        UsbLink(0x04B4, 0x00F5, "camera").open(None, lambda: "")


def test_two_devices_of_a_kind_are_told_apart_by_their_serial_numbers() -> None:
    _, _, backend = emulated()
    found: list[str] = []
    one = backend.enumerate_devices

    def two() -> Iterator[str]:
        yield from one()
        yield from one()

    def serial() -> str:
        found.append("a")
        return f"0000000{len(found)}"

    backend.enumerate_devices = two  # type: ignore[method-assign]
    with pytest.raises(ConnectionFailed, match="there are 2 of its kind; say which by its serial number"):
        UsbLink(0x04B4, 0x00F5, "camera", backend=backend).open(None, serial)
    link = UsbLink(0x04B4, 0x00F5, "camera", backend=backend)
    link.open("00000002", serial)
    assert len(found) == 2
    with pytest.raises(ConnectionFailed, match="there is only 00000003, 00000004"):
        link.open("00000009", serial)


def test_an_endpoint_that_is_not_there_is_said() -> None:
    link, _ = opened()
    with pytest.raises(ConnectionFailed, match="Invalid endpoint address"):
        link.read(0x85, 64, "ask")


def test_silence_is_a_time_out_and_no_error_of_a_stream() -> None:
    link, _ = opened()
    with pytest.raises(DeviceTimeout, match="camera: ask: nothing within the time"):
        link.read(0x82, 64, "ask")
    assert link.read_into(0x81, array("B", bytes(64)), "stream", 0.01) == 0
    assert link.drain(0x82, 64, "ask") == b""


def test_a_device_that_never_falls_quiet_is_said() -> None:
    link, backend = opened()
    backend.bulk_read = lambda *_: 8
    with pytest.raises(UnexpectedAnswer, match="does not fall quiet, 2048 bytes"):
        link.drain(0x82, 64, "ask")


def test_an_exchange_that_broke_off_is_told_to_the_next_one() -> None:
    link, _ = opened()
    with pytest.raises(DeviceTimeout), link.exchange():
        link.read(0x82, 64, "ask")
    with link.exchange() as in_step:
        assert not in_step
    with link.exchange() as in_step:
        assert in_step


def test_texts_of_the_descriptor_can_be_read() -> None:
    _, _, backend = emulated()
    (found,) = usb.core.find(find_all=True, backend=backend)
    assert (found.manufacturer, found.product, found.serial_number) == ("Prophesee", "EVK4", None)
    assert bytes(found.ctrl_transfer(0xC0, 0x72, 0, 0, 2)) == b"\x31\x00"
    (configuration,) = found
    (interface,) = configuration
    assert (interface.bInterfaceClass, interface.bInterfaceSubClass) == (0xFF, 0x19)
    assert [endpoint.bEndpointAddress for endpoint in interface] == [0x82, 0x02, 0x81]
