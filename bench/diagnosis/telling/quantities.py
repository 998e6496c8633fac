"""Numbers of a model with unit and interval, as a person writes them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from bench.diagnosis.expected.catalogue import free_of
from bench.report.wording import decimals_for
from sim_backend.pixel.effects.registry import effects

if TYPE_CHECKING:
    from bench.diagnosis.result import Value

__all__ = ["also", "number_text", "quantity", "size_text"]

#: Units that are scaled: least value, factor, what it is called then.
_SCALED: Final = {
    "s": ((1.0, 1.0, "s"), (1e-3, 1e3, "ms"), (0.0, 1e6, "us")),
    "lux": ((1.0, 1.0, "lux"), (1e-3, 1e3, "mlux"), (0.0, 1e6, "ulux")),
    "lx": ((1.0, 1.0, "lux"), (1e-3, 1e3, "mlux"), (0.0, 1e6, "ulux")),
}
#: What is just below a thousand of the smaller unit is written in the larger one.
_ALMOST: Final = 0.9995
_MANY_DIGITS: Final = 1e5


def number_text(value: Value) -> str:
    """Return a fitted number with its 90 % interval: ``5.52 fA (5.41 to 5.63)``."""
    factor, unit = _in(value.unit, value.value)
    number, low, high = (v * factor for v in (value.value, value.low, value.high))
    places = decimals_for(low, high, number)
    ends = f"({_fixed(low, places)} to {_fixed(high, places)})"
    return f"{_fixed(number, places)}{unit and ' ' + unit} {ends}"


def quantity(value: float, unit: str) -> str:
    """Return a number with three digits and its unit: ``80 mlux``, ``3.2 ms``."""
    factor, name = _in(unit, value)
    return f"{value * factor:.3g}{name and ' ' + name}"


def size_text(effect: str, size: float) -> str:
    """Return a size of an effect, in the unit of its first number; a limit does more the lower it is."""
    known = effects().get(effect)
    free = free_of(known) if known is not None else ()
    if not free:
        return f"{size:.3g}"
    below = " or less" if free[0].scale == "inverse" else ""
    return f"{quantity(size, free[0].unit)}{below} ({free[0].name})"


def also(key: str, value: Value, gain_fa_per_lux: float | None) -> str | None:
    """Return what a number of an effect means in other words, where people ask for that: the dark light."""
    if key != "dark_current.mean_fa" or gain_fa_per_lux is None:
        return None
    return f"dark light {quantity(value.value / gain_fa_per_lux, 'lux')}"


def _in(unit: str, value: float) -> tuple[float, str]:
    """Return the factor and the name of the unit in which a value is written."""
    if unit == "1":
        return 1.0, ""
    if unit not in _SCALED or value == 0.0 or not math.isfinite(value):
        return 1.0, "lux" if unit == "lx" else unit
    return next((f, name) for least, f, name in _SCALED[unit] if abs(value) >= _ALMOST * least)


def _fixed(value: float, places: int) -> str:
    if not math.isfinite(value):
        return "no limit"
    return f"{value:.3g}" if abs(value) >= _MANY_DIGITS else f"{value:.{places}f}"
