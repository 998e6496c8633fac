"""Biases of the IMX636: offsets from the codes that the unit came with.

Addresses, ranges and the upper half of the word as in OpenEB 5.1.1 (hal_psee_plugins, devices/imx636). The code is
the low byte; it is what a sensor holds there after it was initialised, before anything else is written.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from drivers.errors import OutOfRange, UnexpectedAnswer
from drivers.interfaces import Limits

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivers.camera.evk4.registers import Registers

__all__ = ["BIASES", "Bias", "Biases", "table_limits"]

_HIGHEST_CODE: Final = 0xFF
_UPPER_HALF: Final = 0x11A10000  # drive and switches of the bias, and "apply now"
_UNIT: Final = "offset"


@dataclass(frozen=True, slots=True)
class Bias:
    """Where a bias lies, and its recommended offsets."""

    address: int
    lowest: int
    highest: int


#: The biases that may be changed, by name. In each a higher code does more of what stands behind it.
BIASES: Final[Mapping[str, Bias]] = {
    "bias_fo": Bias(0x1004, -35, 55),  # bandwidth of the photoreceptor
    "bias_hpf": Bias(0x100C, 0, 120),  # corner of the high-pass
    "bias_diff_on": Bias(0x1010, -85, 140),  # ON threshold
    "bias_diff": Bias(0x1014, -25, 23),  # reference of both thresholds, best left alone
    "bias_diff_off": Bias(0x1018, -35, 190),  # OFF threshold
    "bias_refr": Bias(0x1020, -20, 235),  # shortness of the dead time
}


def table_limits() -> dict[str, Limits]:
    """Return the recommended offset of each bias."""
    return {name: Limits(bias.lowest, bias.highest, _UNIT) for name, bias in BIASES.items()}


class Biases:
    """The biases of one unit.

    Parameters
    ----------
    registers
        Of an initialised sensor whose biases nobody has changed: its codes are taken as the factory's.
    device
        Name of the camera, for messages.
    """

    def __init__(self, registers: Registers, device: str) -> None:
        self._registers = registers
        self._device = device
        self.factory_codes = {name: self._code(name) for name in BIASES}

    def limits(self) -> dict[str, Limits]:
        """Return the recommended offsets, as far as this unit has codes for them."""
        return {
            name: Limits(max(bias.lowest, -code), min(bias.highest, _HIGHEST_CODE - code), _UNIT)
            for (name, bias), code in zip(BIASES.items(), self.factory_codes.values(), strict=True)
        }

    def offsets(self) -> dict[str, int]:
        """Return all offsets, read back."""
        return {name: self._code(name) - self.factory_codes[name] for name in BIASES}

    def set(self, offsets: Mapping[str, int]) -> None:
        """Set the biases, and read them back; those that are right already are not written.

        Raises
        ------
        OutOfRange
            An offset needs a code that a byte cannot hold; nothing was changed.
        UnexpectedAnswer
            A bias is not what was written.
        """
        codes = {name: self.factory_codes[name] + offset for name, offset in offsets.items()}
        for name, code in codes.items():
            if not 0 <= code <= _HIGHEST_CODE:
                factory = self.factory_codes[name]
                raise OutOfRange(self._device, name, offsets[name], -factory, _HIGHEST_CODE - factory, _UNIT)
        for name, code in codes.items():
            if self._code(name) == code:
                continue
            self._registers.write(BIASES[name].address, _UPPER_HALF | code)
            found = self._code(name)
            if found != code:
                raise UnexpectedAnswer(self._device, f"set {name} to code {code}", f"it reads back as {found}")

    def _code(self, name: str) -> int:
        return self._registers.read(BIASES[name].address) & _HIGHEST_CODE
