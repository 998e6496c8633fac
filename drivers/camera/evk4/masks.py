"""The window of an IMX636: rows and columns that are off.

A bit for each column and row, 32 in a register, 1 for off (OpenEB 5.1.1, td_roi_x and td_roi_y). Rows and columns are
counted as the events count them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from drivers.camera.evk4 import registers as reg

if TYPE_CHECKING:
    from drivers.camera.evk4.registers import Registers
    from protocols.points import Roi

__all__ = ["HEIGHT", "WIDTH", "mask_words", "set_window"]

WIDTH: Final = 1280
HEIGHT: Final = 720

_BITS: Final = 32
_CTRL_BITS: Final = reg.ROI_ENABLE | reg.ROI_APPLY | reg.ROI_INSIDE | reg.PIXELS_RELEASED


def mask_words(first: int, count: int, size: int) -> list[int]:
    """Return the mask words of `size` lines of which `count` from `first` on are enabled."""
    enabled = (1 << count) - 1 << first
    off = ((1 << size) - 1) & ~enabled
    return [off >> start & 0xFFFFFFFF for start in range(0, size, _BITS)]


def set_window(registers: Registers, roi: Roi) -> None:
    """Enable the pixels of the window and no others; the sensor must be stopped, and its pixels stay held.

    Raises
    ------
    DeviceError
        The camera does not do it.
    """
    for i, word in enumerate(mask_words(roi.x, roi.width, WIDTH)):
        registers.write(reg.COLUMN_MASKS + 4 * i, word)
    *whole, last = mask_words(roi.y, roi.height, HEIGHT)
    for i, word in enumerate(whole):
        registers.write(reg.ROW_MASKS + 4 * i, word)
    # The upper half of the last word belongs to no row and is left as it is.
    registers.change(reg.ROW_MASKS + 4 * len(whole), last, (1 << HEIGHT % _BITS) - 1)
    registers.change(reg.ROI_CTRL, reg.ROI_ENABLE | reg.ROI_APPLY | reg.ROI_INSIDE, _CTRL_BITS)
