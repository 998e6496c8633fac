"""What an IMX636 measures of itself: temperature, light on the array, dead time.

Registers and formulas as in OpenEB 5.1.1 (hal_psee_plugins, devices/imx636).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from drivers.camera.evk4 import registers as reg

if TYPE_CHECKING:
    from drivers.camera.evk4.registers import Registers
    from drivers.interfaces import Clock

__all__ = ["dead_time_s", "illumination_counter", "lux_from_counter", "temperature_c"]

_POLL_S: Final = 1e-3

_ADC_CLOCK: Final = 1 << 1
_ADC_START: Final = 1 << 2
_ADC_TEMPERATURE: Final = 1 << 12
_ADC_DONE: Final = 1 << 11
_ADC_VALUE: Final = 0x3FF
_DEGREES_PER_CODE: Final = 0.190
_LOWEST_DEGREES: Final = -56.0
_ADC_TRIES: Final = 5

_LIGHT_VALID: Final = 1 << 29
_LIGHT_COUNTER: Final = (1 << 29) - 1
_LIGHT_COUNTS_PER_US: Final = 100.0
_LIGHT_TRIES: Final = 10

_DEAD_TIME_MEASURE: Final = 0b11 << 30
_DEAD_TIME_VALID: Final = 1 << 28
_DEAD_TIME_COUNTER: Final = (1 << 28) - 1
_DEAD_TIME_COUNTS_PER_S: Final = 200e6
_DEAD_TIME_TRIES: Final = 10


def temperature_c(registers: Registers, clock: Clock) -> float:
    """Return the temperature of the sensor, degrees Celsius; NaN if it does not get done."""
    registers.change(reg.ADC_CONTROL, _ADC_CLOCK, _ADC_CLOCK)
    registers.change(reg.ADC_MISC_CTRL, _ADC_TEMPERATURE, _ADC_TEMPERATURE)
    registers.change(reg.ADC_CONTROL, _ADC_START, _ADC_START)
    status = _polled(registers, clock, reg.ADC_STATUS, _ADC_DONE, _ADC_TRIES)
    registers.change(reg.ADC_CONTROL, 0, _ADC_CLOCK)
    return math.nan if status is None else _DEGREES_PER_CODE * (status & _ADC_VALUE) + _LOWEST_DEGREES


def illumination_counter(registers: Registers, clock: Clock) -> int | None:
    """Return the raw counter of the light on the whole array, the smaller the brighter; None if it is too dark."""
    status = _polled(registers, clock, reg.LIFO_STATUS, _LIGHT_VALID, _LIGHT_TRIES)
    return None if status is None else status & _LIGHT_COUNTER


def lux_from_counter(counter: int | None) -> float:
    """Return the illuminance that a raw counter stands for by the maker's formula, lux; NaN for none.

    Nobody has calibrated it: published comparisons find 0.7 of the computed illuminance. Keep the counter as well.
    """
    if not counter:
        return math.nan
    return math.pow(10.0, 3.5) / (0.37 * counter / _LIGHT_COUNTS_PER_US)


def dead_time_s(registers: Registers, clock: Clock) -> float:
    """Return the dead time of the pixels as the sensor measures it, s; NaN if it does not get done."""
    registers.change(reg.REFRACTORY_CTRL, _DEAD_TIME_MEASURE, _DEAD_TIME_MEASURE)
    status = _polled(registers, clock, reg.REFRACTORY_CTRL, _DEAD_TIME_VALID, _DEAD_TIME_TRIES)
    return math.nan if status is None else (status & _DEAD_TIME_COUNTER) / _DEAD_TIME_COUNTS_PER_S


def _polled(registers: Registers, clock: Clock, address: int, ready: int, tries: int) -> int | None:
    """Return a register once its bit `ready` is set, None if it is not after so many tries."""
    for attempt in range(tries):
        if attempt:
            clock.sleep(_POLL_S)
        value = registers.read(address)
        if value & ready:
            return value
    return None
