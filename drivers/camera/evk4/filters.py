"""What stands between the pixels and the stream and would drop events: switched off, and seen to be off.

Anti-flicker filter, noise and trail filter and event-rate controller as in OpenEB 5.1.1 (hal_psee_plugins,
devices/common and devices/imx636). A measurement of pixels wants none of them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from drivers.camera.evk4 import registers as reg
from drivers.errors import UnexpectedAnswer

if TYPE_CHECKING:
    from drivers.camera.evk4.registers import Registers

__all__ = ["require_off", "switch_off"]

_BYPASS: Final = 0b101
_PIPELINE_BITS: Final = 0b111
_DROPPING: Final = 0b1

#: Name, register, the bits that matter, and what they are when the filter is off.
_OFF: Final = (
    ("anti-flicker filter", reg.AFK_PIPELINE, _PIPELINE_BITS, _BYPASS),
    ("noise and trail filter", reg.STC_PIPELINE, _PIPELINE_BITS, _BYPASS),
    ("event-rate controller", reg.T_DROPPING_CONTROL, _DROPPING, 0),
)


def switch_off(registers: Registers, device: str) -> None:
    """Switch all three off, and read back that they are.

    Raises
    ------
    UnexpectedAnswer
        One does not read back as off.
    """
    registers.write(reg.AFK_PIPELINE, _BYPASS)
    registers.write(reg.STC_PIPELINE, _BYPASS)
    registers.change(reg.T_DROPPING_CONTROL, 0, _DROPPING)
    require_off(registers, device)


def require_off(registers: Registers, device: str) -> None:
    """Raise unless all three read back as off.

    Raises
    ------
    UnexpectedAnswer
        One does not.
    """
    for name, address, bits, expected in _OFF:
        value = registers.read(address)
        if value & bits != expected:
            raise UnexpectedAnswer(
                device, f"switch the {name} off", f"register 0x{address:04X} reads 0x{value:08X}", "connect it anew"
            )
