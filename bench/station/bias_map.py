"""What the biases of a sensor do: tables of offset against a physical value, read both ways."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = ["QUANTITIES", "BiasCurve", "BiasMap"]

#: What can be set through a bias, and its unit.
QUANTITIES: Final[dict[str, str]] = {"theta_on": "ln", "theta_off": "ln", "refractory_s": "s", "bandwidth_hz": "Hz"}


@dataclass(frozen=True, slots=True)
class BiasCurve:
    """One quantity against the offset of one bias: straight lines between the rows of a table.

    Between two rows the value (scale "linear") or its logarithm (scale "log") is linear in the offset. The values
    must rise or fall all along, so that each belongs to one offset.
    """

    quantity: str
    bias: str
    scale: Literal["linear", "log"]
    offsets: tuple[int, ...]  #: ascending
    values: tuple[float, ...]  #: rising or falling, in the unit of the quantity
    calibrated: bool = False  #: whether it was measured on this sensor

    @property
    def unit(self) -> str:
        """Unit of the values."""
        return QUANTITIES[self.quantity]

    def value_at(self, offset: float) -> float:
        """Return the value at `offset`.

        Raises
        ------
        InputError
            The offset is outside the table.
        """
        lowest, highest = self.offsets[0], self.offsets[-1]
        if not lowest <= offset <= highest:
            raise InputError(
                f"{self.bias} at offset {offset:g}: {self.quantity} is known from offset {lowest} to {highest}"
            )
        row = self.offsets.index(offset) if offset in self.offsets else None
        if row is not None:
            return self.values[row]  # not through a logarithm and back
        return self._from_scale(float(np.interp(offset, self.offsets, self._scaled())))

    def offset_for(self, value: float) -> int:
        """Return the whole offset whose value is nearest to `value`, on the scale of the table.

        Raises
        ------
        InputError
            The value is outside the table.
        """
        lowest, highest = min(self.values), max(self.values)
        if not lowest <= value <= highest:
            raise InputError(
                f"{self.quantity} {value:g} {self.unit}: {self.bias} reaches {lowest:g} to {highest:g} {self.unit}"
            )
        scaled = self._scaled()
        order = np.argsort(scaled)
        wanted = self._to_scale(value)
        exact = float(np.interp(wanted, scaled[order], np.array(self.offsets)[order]))
        return min(
            (math.floor(exact), math.ceil(exact)),
            key=lambda offset: abs(self._to_scale(self.value_at(offset)) - wanted),
        )

    def _scaled(self) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        return np.array([self._to_scale(value) for value in self.values])

    def _to_scale(self, value: float) -> float:
        return math.log(value) if self.scale == "log" else value

    def _from_scale(self, scaled: float) -> float:
        return math.exp(scaled) if self.scale == "log" else scaled


@dataclass(frozen=True, slots=True)
class BiasMap:
    """The curves of a sensor, at most one for each quantity."""

    curves: tuple[BiasCurve, ...] = ()

    @property
    def ranges(self) -> dict[str, tuple[int, int]]:
        """Lowest and highest offset at which all that a bias does is known, by bias."""
        found: dict[str, tuple[int, int]] = {}
        for curve in self.curves:
            lowest, highest = found.get(curve.bias, (curve.offsets[0], curve.offsets[-1]))
            found[curve.bias] = (max(lowest, curve.offsets[0]), min(highest, curve.offsets[-1]))
        return found

    def curve(self, quantity: str) -> BiasCurve:
        """Return the curve of `quantity`.

        Raises
        ------
        InputError
            The map has none.
        """
        for curve in self.curves:
            if curve.quantity == quantity:
                return curve
        known = ", ".join(curve.quantity for curve in self.curves) or "nothing"
        raise InputError(f"{quantity}: the station's bias map does not say which bias sets it; it knows {known}")

    def settings_at(self, offsets: Mapping[str, int]) -> dict[str, float]:
        """Return the value of each quantity that is in the map; a bias that is not named is at offset 0.

        Raises
        ------
        InputError
            An offset is outside its table.
        """
        return {curve.quantity: curve.value_at(offsets.get(curve.bias, 0)) for curve in self.curves}

    def offsets_for(self, values: Mapping[str, float]) -> dict[str, int]:
        """Return the offset of each bias for `values` by quantity.

        Raises
        ------
        InputError
            A quantity is not in the map, a value is outside its table, or two quantities want one bias at different
            offsets.
        """
        found: dict[str, int] = {}
        setter: dict[str, str] = {}
        for quantity, value in values.items():
            curve = self.curve(quantity)
            offset = _offset_for(curve, value)
            if found.setdefault(curve.bias, offset) != offset:
                raise InputError(
                    f"{quantity} {value:g} {curve.unit} needs {curve.bias} at offset {offset}, "
                    f"but {setter[curve.bias]} needs it at {found[curve.bias]}"
                )
            setter.setdefault(curve.bias, quantity)
        return found


@lru_cache(maxsize=256)  # a protocol asks for a few values, at hundreds of points
def _offset_for(curve: BiasCurve, value: float) -> int:
    return curve.offset_for(value)
