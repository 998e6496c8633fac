"""How numbers, light levels and polarities are written in figures and tables."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bench.analysis.results import Estimate
    from protocols.points import Waveform

__all__ = [
    "MISSING",
    "capital",
    "count",
    "decimals_for",
    "duration_label",
    "fixed",
    "interval_text",
    "lux_interval",
    "lux_label",
    "polarity_label",
    "waveform_label",
]

MISSING = "\u2013"
_LUX_UNITS = ((1e3, 1e-3, "klux"), (0.9995, 1.0, "lux"), (0.9995e-3, 1e3, "mlux"), (0.0, 1e6, "\u00b5lux"))
_TIME_UNITS = ((0.9995, 1.0, "s"), (0.9995e-3, 1e3, "ms"), (0.0, 1e6, "\u00b5s"))
_FROM_KLUX = 1e4
_TWO_DIGITS_BELOW = 3.5
_WAVEFORMS: dict[Waveform, str] = {
    "square": "square wave",
    "reset_test": "reset and test pulses",
    "constant": "constant light",
}


def _in_units(value: float, units: tuple[tuple[float, float, str], ...]) -> str:
    factor, unit = next((factor, unit) for least, factor, unit in units if abs(value) >= least)
    return f"{_three_digits(value * factor)} {unit}"


def _three_digits(value: float) -> str:
    """Return `value` with three significant digits and never an exponent."""
    if value == 0.0:
        return "0"
    decimals = max(0, 2 - math.floor(math.log10(abs(value))))
    text = f"{value:.{decimals}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


def lux_label(lux: float) -> str:
    """Return an illuminance as people say it: ``76 mlux``, ``3 lux``, ``dark`` for 0."""
    if not math.isfinite(lux):
        return "unknown level"
    if lux == 0.0:
        return "dark"
    return _in_units(lux, _LUX_UNITS if lux >= _FROM_KLUX else _LUX_UNITS[1:])


def duration_label(seconds: float) -> str:
    """Return a duration as people say it: ``20 ms``, ``100 µs``, ``2.5 s``."""
    return _in_units(seconds, _TIME_UNITS) if math.isfinite(seconds) else "unknown duration"


def polarity_label(polarity: str) -> str:
    """Return ``ON`` or ``OFF``."""
    return polarity.upper()


def waveform_label(waveform: Waveform) -> str:
    """Return what the waveform of a point is called in a sentence."""
    return _WAVEFORMS[waveform]


def decimals_for(low: float, high: float, value: float) -> int:
    """Return how many decimals a number with this interval deserves, at most 5.

    The half-width of the interval is written with two digits where it starts with 1, 2 or 3, else with one.
    """
    half_width = 0.5 * (high - low)
    if not math.isfinite(half_width) or half_width <= 0.0:
        half_width = abs(value) * 0.05 if math.isfinite(value) and value else 1e-3
    power = math.floor(math.log10(half_width))
    digits = 2 if half_width < _TWO_DIGITS_BELOW * 10.0**power else 1
    return min(5, max(0, digits - 1 - power))


def fixed(value: float, decimals: int) -> str:
    """Return `value` with so many decimals; a dash where it is not a number."""
    if math.isnan(value):
        return MISSING
    if math.isinf(value):
        return "\u221e" if value > 0 else "\u2212\u221e"
    return f"{value:.{decimals}f}".replace("-", "\u2212")


def interval_text(estimate: Estimate, scale: float = 1.0) -> tuple[str, str]:
    """Return a number, times `scale`, and its interval with as many decimals as it deserves; a dash for none."""
    value, low, high = (scale * v for v in (estimate.value, estimate.low, estimate.high))
    decimals = decimals_for(low, high, value)
    text = fixed(value, decimals)
    return text, "" if math.isnan(low) and math.isnan(high) else f"{fixed(low, decimals)} to {fixed(high, decimals)}"


def lux_interval(estimate: Estimate) -> str:
    """Return an illuminance with its interval, in the unit that suits it: ``146 mlux (140 to 152)``."""
    scale, unit = (1e3, "mlux") if max(abs(estimate.value), abs(estimate.high)) < 1.0 else (1.0, "lux")
    text, interval = interval_text(estimate, scale)
    if text == MISSING:
        return text
    return f"{text} {unit}" + (f" ({interval})" if interval else "")


def count(number: int, one: str, many: str | None = None) -> str:
    """Return ``1 pulse``, ``30 pulses``; thousands are set apart by thin spaces."""
    noun = one if number == 1 else (many or f"{one}s")
    return f"{number:,}".replace(",", "\u2009") + f" {noun}"


def capital(text: str) -> str:
    """Return `text` as the beginning of a sentence."""
    return text[:1].upper() + text[1:]
