"""What is plugged in: serial ports, USB cameras, test instruments; and whether this user may open them."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

__all__ = ["UDEV_RULES", "PluggedIn", "plugged_in"]

#: USB identifiers by vendor and product (None: any), and what they most likely are.
_KNOWN: Final[dict[tuple[int, int | None], str]] = {
    (0x04B4, 0x00F5): "Prophesee EVK4",
    (0x04B4, 0x00F4): "Prophesee EVK3",
    (0x0403, 0x6001): "FTDI serial port (SpectralLED RS-7, Thorlabs wheel)",
    (0x1313, None): "Thorlabs instrument",
    (0x16C0, 0x0483): "Teensy (LED driver)",
    (0x2341, None): "Arduino (LED driver)",
}
_CAMERAS: Final = ((0x04B4, 0x00F5), (0x04B4, 0x00F4))

#: Rules that let everybody at this computer open the instruments, and FTDI chips answer at once.
UDEV_RULES: Final = """\
# EVS bench: save as /etc/udev/rules.d/60-evs-bench.rules, then
#   sudo udevadm control --reload && sudo udevadm trigger
# Prophesee EVK3 and EVK4
SUBSYSTEM=="usb", ATTR{idVendor}=="04b4", ATTR{idProduct}=="00f4", MODE="0666"
SUBSYSTEM=="usb", ATTR{idVendor}=="04b4", ATTR{idProduct}=="00f5", MODE="0666"
# Serial ports: FTDI, Thorlabs, Teensy, Arduino
SUBSYSTEM=="tty", ATTRS{idVendor}=="0403", MODE="0666"
SUBSYSTEM=="tty", ATTRS{idVendor}=="1313", MODE="0666"
SUBSYSTEM=="tty", ATTRS{idVendor}=="16c0", MODE="0666"
SUBSYSTEM=="tty", ATTRS{idVendor}=="2341", MODE="0666"
# FTDI chips hold short answers back for 16 ms unless told otherwise
ACTION=="add", SUBSYSTEM=="usb-serial", DRIVER=="ftdi_sio", ATTR{latency_timer}="1"
# Function generators and the DC2200
SUBSYSTEM=="usbmisc", KERNEL=="usbtmc*", MODE="0666"
"""


@dataclass(frozen=True, slots=True)
class PluggedIn:
    """Something that a driver could talk to."""

    path: str  #: of the port, or bus and address
    what: str  #: as it describes itself, or as its USB identifiers tell
    serial: str  #: as USB tells it; empty if it does not
    refused: str  #: why this user cannot open it; empty if nothing is known to be in the way


def plugged_in(backend: Any = None) -> list[PluggedIn]:
    """Return serial ports, test instruments and USB cameras. Nothing is opened.

    Parameters
    ----------
    backend
        Of pyusb; None for the installed libusb.
    """
    return [*_serial_ports(), *_test_instruments(), *_cameras(backend)]


def _serial_ports() -> list[PluggedIn]:
    from serial.tools.list_ports import comports

    return [
        PluggedIn(
            port.device,
            _name(port.vid, port.pid, port.description),
            port.serial_number or "",
            _in_the_way(port.device),
        )
        for port in sorted(comports())
        if port.vid is not None or port.description not in (None, "", "n/a")
    ]


def _test_instruments() -> list[PluggedIn]:
    found = sorted(Path("/dev").glob("usbtmc*")) if Path("/dev").is_dir() else []
    return [PluggedIn(str(path), "USB test instrument", "", _in_the_way(str(path))) for path in found]


def _cameras(backend: Any) -> list[PluggedIn]:
    import usb.core

    found = []
    for vendor, product in _CAMERAS:
        try:
            devices = list(usb.core.find(find_all=True, idVendor=vendor, idProduct=product, backend=backend))
        except (usb.core.NoBackendError, usb.core.USBError):
            return [
                PluggedIn("USB", "no libusb: cameras cannot be seen", "", "install the extra `hw` (libusb-package)")
            ]
        for device in devices:
            node = f"/dev/bus/usb/{device.bus or 0:03d}/{device.address or 0:03d}"
            refused = _in_the_way(node) if Path(node).exists() else ""
            found.append(
                PluggedIn(f"bus {device.bus}, address {device.address}", _KNOWN[vendor, product], "", refused)
            )
    return found


def _name(vendor: int | None, product: int | None, description: str) -> str:
    if vendor is None:
        return description
    return (
        _KNOWN.get((vendor, product)) or _KNOWN.get((vendor, None)) or f"{description} ({vendor:04x}:{product:04x})"
    )


def _in_the_way(node: str) -> str:
    if os.access(node, os.R_OK | os.W_OK):
        return ""
    return "this user may not open it: install the udev rules (evs-bench devices --udev)"
