"""Registers of the IMX636 that the driver uses, and their reading, writing and changing.

Addresses and fields as in the register map of OpenEB 5.1.1 (hal_psee_plugins, devices/imx636).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from drivers.camera.evk4.treuzell import Treuzell

__all__ = ["Registers"]

ROI_CTRL: Final = 0x0004
ROI_ENABLE: Final = 1 << 1
ROI_APPLY: Final = 1 << 5  #: takes the masks over
ROI_INSIDE: Final = 1 << 6  #: 1: a pixel is off if its row or its column is masked
PIXELS_RELEASED: Final = 1 << 10

LIFO_STATUS: Final = 0x0010
CHIP_ID: Final = 0x0014
REFRACTORY_CTRL: Final = 0x0020
ADC_CONTROL: Final = 0x004C
ADC_STATUS: Final = 0x0050
ADC_MISC_CTRL: Final = 0x0054
COLUMN_MASKS: Final = 0x2000
ROW_MASKS: Final = 0x4000
T_DROPPING_CONTROL: Final = 0x6050
TRIGGER_CTRL: Final = 0x7004
TRIGGER_ENABLE: Final = 1 << 10
AFK_PIPELINE: Final = 0xC000
STC_PIPELINE: Final = 0xD000
VARIANT: Final = 0xF128


class Registers:
    """The registers of a sensor, one at a time.

    Parameters
    ----------
    treuzell
        The controller that reaches them.
    """

    def __init__(self, treuzell: Treuzell) -> None:
        self._treuzell = treuzell

    def read(self, address: int) -> int:
        """Return the value of a register."""
        return self._treuzell.read_register(address)

    def write(self, address: int, value: int) -> None:
        """Set all bits of a register."""
        self._treuzell.write_register(address, value)

    def change(self, address: int, value: int, mask: int) -> None:
        """Set the bits of a register that are in `mask`, and keep the others."""
        self.write(address, self.read(address) & ~mask | value & mask)
