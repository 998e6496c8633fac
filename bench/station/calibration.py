"""What the operator knows of the bench: lux for each level behind each filter, and what the biases do."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from bench.station.bias_map import QUANTITIES, BiasMap
from drivers.interfaces import Limits
from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from protocols.points import Settings

__all__ = ["CalibratedFilter", "Calibration"]

#: A level this close to a limit of the source, relatively, is at the limit: lux and level are converted to and fro.
_ROUNDING: Final = 1e-9
#: Optical densities this close are the same.
_SAME_OD: Final = 1e-6


@dataclass(frozen=True, slots=True)
class CalibratedFilter:
    """A filter as it was measured."""

    nd_od: float  #: nominal optical density
    transmission: float  #: measured
    uncertainty: float | None = None  #: of the transmission: relative, one standard deviation; None if unknown


@dataclass(frozen=True, slots=True)
class Calibration:
    """From lux on chip to levels of the source, and from physical settings to biases, and back."""

    clear_lux_per_level: float  #: lux on chip per unit of the source's level, without a filter
    levels: Limits  #: of the source
    filters: Mapping[str, CalibratedFilter]
    bias_map: BiasMap
    light_uncertainty: float | None = None  #: of the lux: relative, one standard deviation; None if unknown

    def lux_per_level(self, filter_name: str) -> float:
        """Return the illuminance on the chip per unit of the source's level behind a filter, lux.

        Raises
        ------
        InputError
            The station has no such filter.
        """
        if filter_name not in self.filters:
            raise InputError(f"no filter {filter_name!r} in the calibration; it has {', '.join(self.filters)}")
        return self.clear_lux_per_level * self.filters[filter_name].transmission

    def lux_range(self, filter_name: str) -> Limits:
        """Return the lowest and highest illuminance that is lit behind a filter; 0 (dark) is always possible."""
        per_level = self.lux_per_level(filter_name)
        return Limits(self.levels.lowest * per_level, self.levels.highest * per_level, "lux")

    def reachable(self, lux: float, filter_name: str) -> bool:
        """Return whether the source can give `lux` on the chip behind a filter."""
        try:
            self.level_for(lux, filter_name)
        except InputError:
            return False
        return True

    def level_for(self, lux: float, filter_name: str) -> float:
        """Return the level that gives `lux` on the chip behind a filter; 0 for 0.

        Raises
        ------
        InputError
            The source cannot give it, or there is no such filter.
        """
        level = lux / self.lux_per_level(filter_name)
        for limit in (self.levels.lowest, self.levels.highest):
            if math.isclose(level, limit, rel_tol=_ROUNDING):
                return limit
        if level != 0.0 and not self.levels.lowest <= level <= self.levels.highest:
            reach = self.lux_range(filter_name)
            raise InputError(
                f"{lux:.4g} lux on chip behind filter {filter_name}: the light source reaches "
                f"{reach.lowest:.4g} to {reach.highest:.4g} lux there "
                f"({self.levels.lowest:g} to {self.levels.highest:g} {self.levels.unit})"
            )
        return level

    def filter_for(self, nd_od: float) -> str:
        """Return the name of the filter of nominal optical density `nd_od`.

        Raises
        ------
        InputError
            The station has none.
        """
        for name, known in self.filters.items():
            if abs(known.nd_od - nd_od) <= _SAME_OD:
                return name
        has = ", ".join(f"{known.nd_od:g} ({name})" for name, known in self.filters.items())
        raise InputError(f"no filter of optical density {nd_od:g}; the station has {has}")

    def biases_for(self, settings: Settings) -> dict[str, int]:
        """Return the offset of each bias that `settings` rules, by name: the nearest whole offset, and raw biases.

        Raises
        ------
        InputError
            A value cannot be reached, or one bias is wanted at two offsets.
        """
        asked = {quantity: getattr(settings, quantity) for quantity in QUANTITIES}
        offsets = self.bias_map.offsets_for({q: value for q, value in asked.items() if value is not None})
        for bias, offset in settings.biases:
            if offsets.setdefault(bias, offset) != offset:
                raise InputError(
                    f"{bias} is set to offset {offset}, but the physical settings need it at {offsets[bias]}; "
                    "give one of the two"
                )
        return offsets

    def settings_at(self, offsets: Mapping[str, int]) -> dict[str, float]:
        """Return theta_on, theta_off (ln), refractory_s and bandwidth_hz; NaN where the bias map knows nothing.

        Raises
        ------
        InputError
            An offset is outside its table.
        """
        return dict.fromkeys(QUANTITIES, math.nan) | self.bias_map.settings_at(offsets)

    @property
    def uncalibrated(self) -> tuple[str, ...]:
        """Quantities whose bias curve was not measured on this sensor."""
        measured = {curve.quantity for curve in self.bias_map.curves if curve.calibrated}
        return tuple(quantity for quantity in QUANTITIES if quantity not in measured)
