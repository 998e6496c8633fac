"""From readings of a lux meter to lux per level of the source, and to the measured transmission of each filter.

The line goes through the origin: ``lux = slope * level``. A meter errs by a part of what it reads, so the weights are
1/level^2, and the least squares are the mean of the ratios lux/level. Its standard error is the scatter of the ratios
over sqrt(n), with that of the ambient light where it was subtracted. The meter's own error is the same in every
reading: it goes into the slope in quadrature, and out of the transmission, which is the ratio of two slopes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.photometry.csv_tables import half_last_digit, read_table
from bench.photometry.propagation import Known, propagate
from protocols.errors import InputError, Problem

if TYPE_CHECKING:
    import os
    from collections.abc import Collection, Sequence

__all__ = ["CLEAR", "Line", "MeterCalibration", "Odd", "Reading", "behind", "calibrate", "read_readings"]

CLEAR: Final = "clear"  #: name of the readings without a filter
_FEWEST: Final = 2  #: readings that tell a scatter
_FALSE_ALARM: Final = 0.01  #: chance that sound readings of one filter have one that is called odd


@dataclass(frozen=True, slots=True)
class Reading:
    """One reading of the meter where the chip will be."""

    line: int  #: of the file
    level: float  #: in the unit of the source
    lux: float
    half_digit_lux: float  #: half a unit of the last digit that the meter showed
    filter_name: str  #: `CLEAR` for none


@dataclass(frozen=True, slots=True)
class Odd:
    """A reading that is further from the line than the scatter of the others explains."""

    reading: Reading
    off: float  #: from the line through the others, part of it; negative if too low, as of a saturated meter


@dataclass(frozen=True, slots=True)
class Line:
    """Lux against level behind one filter."""

    filter_name: str
    slope: Known  #: lux per level; the meter's own error is not in it
    readings: int  #: that the slope is made of
    ambient: Known | None  #: lux at level 0, which was subtracted; None if it was not read
    odd: tuple[Odd, ...]


@dataclass(frozen=True, slots=True)
class MeterCalibration:
    """What the readings say of the light."""

    clear: Line
    filters: tuple[Line, ...]
    meter_uncertainty: float | None  #: relative, one standard deviation; None if not known
    left_out: tuple[int, ...]  #: lines of the file

    @property
    def lux_per_level(self) -> Known:
        """Lux for each unit of the level, without a filter; the meter's own error is in it, where it is known."""
        slope = self.clear.slope
        return Known(slope.value, math.hypot(slope.sd, slope.value * (self.meter_uncertainty or 0.0)))

    def transmission(self, line: Line) -> Known:
        """Return the measured transmission of a filter; the meter's own error cancels."""
        ratio = propagate(lambda behind, clear: behind / clear, {"behind": line.slope, "clear": self.clear.slope})
        return ratio.known


def read_readings(path: str | os.PathLike[str]) -> list[Reading]:
    """Return the readings of a CSV file with the header ``level,lux`` or ``level,lux,filter``.

    Raises
    ------
    InputError
        With file, line and column of what is wrong.
    """
    found = []
    for row in read_table(path, ("level", "lux"), ("filter",)):
        level, lux = row.cells["level"].number(), row.cells["lux"]
        name = row.cells["filter"].text or CLEAR
        found.append(Reading(row.line, level, lux.number(), half_last_digit(lux.text), name))
    return found


def calibrate(
    readings: Sequence[Reading],
    source: str,
    *,
    leave_out: Collection[int] = (),
    meter_uncertainty: float | None = None,
) -> MeterCalibration:
    """Return what readings say of the light.

    Parameters
    ----------
    readings
        Two or more that are lit, for no filter and for each filter.
    source
        Name of their file, for messages.
    leave_out
        Lines of the file that do not count.
    meter_uncertainty
        Relative, one standard deviation, the same for all readings.

    Raises
    ------
    InputError
        There are too few, a line to be left out is none, or no light is left above the ambient.
    """
    lines = {reading.line for reading in readings}
    for line in leave_out:
        if line not in lines:
            raise InputError(f"{source}: line {line} holds no reading, so it cannot be left out")
    by_filter: dict[str, list[Reading]] = {CLEAR: []}
    for reading in readings:
        if reading.line not in leave_out:
            by_filter.setdefault(reading.filter_name, []).append(reading)
    fitted = [_fit(name, some, source) for name, some in by_filter.items()]
    return MeterCalibration(fitted[0], tuple(fitted[1:]), meter_uncertainty, tuple(sorted(leave_out)))


def _fit(name: str, readings: list[Reading], source: str) -> Line:
    lit = [reading for reading in readings if reading.level > 0.0]
    ambient = _mean([reading.lux for reading in readings if reading.level == 0.0])
    if len(lit) < _FEWEST:
        raise InputError(
            f"{source}: expected {_FEWEST} lit readings or more {behind(name)} (they tell the scatter), "
            f"found {len(lit)}"
        )
    offset = ambient.value if ambient is not None else 0.0
    dark = next((reading for reading in lit if reading.lux <= offset), None)
    if dark is not None:
        message = f"lux: {dark.lux:g} at level {dark.level:g} is not above what is read at level 0, {offset:g}"
        raise InputError(Problem(message, source, dark.line, 1))
    ratios = np.array([(reading.lux - offset) / reading.level for reading in lit])
    slope = _mean(list(ratios))
    if slope is None:
        raise ValueError("a line needs readings")
    from_ambient = (ambient.sd if ambient is not None else 0.0) * float(np.mean([1.0 / r.level for r in lit]))
    known = Known(slope.value, math.hypot(slope.sd, from_ambient))
    return Line(name, known, len(lit), ambient, _odd(lit, ratios))


def behind(name: str) -> str:
    """Return words for where readings were taken."""
    return "without a filter" if name == CLEAR else f"behind {name}"


def _mean(values: list[float]) -> Known | None:
    """Return the mean with its standard error, that of one value 0; None of none."""
    if not values:
        return None
    sd = float(np.std(values, ddof=1)) if len(values) > 1 else 0.0
    return Known(float(np.mean(values)), sd / math.sqrt(len(values)))


def _odd(lit: list[Reading], ratios: np.ndarray[tuple[int], np.dtype[np.float64]]) -> tuple[Odd, ...]:
    """Return the readings that do not fit the others (generalised ESD test: Rosner, Technometrics 25, 165, 1983).

    One after the other, the reading furthest from the mean is taken away, up to half of them; all that were taken
    when the test was last beyond its limit are odd. So several saturated readings do not hide each other. What the
    rounding of the meter's display explains is never odd.
    """
    from scipy.stats import t as student

    kept = list(range(len(lit)))
    taken: list[int] = []
    beyond = 0
    while len(kept) > max(2, (len(lit) + 1) // 2):
        n = len(kept)
        mean, sd = float(np.mean(ratios[kept])), float(np.std(ratios[kept], ddof=1))
        worst = max(kept, key=lambda i: abs(ratios[i] - mean))
        quantile = float(student.ppf(1.0 - _FALSE_ALARM / (2 * n), n - 2))
        limit = (n - 1) * quantile / math.sqrt((n - 2 + quantile**2) * n)
        kept.remove(worst)
        taken.append(worst)
        if abs(ratios[worst] - mean) > limit * sd:
            beyond = len(taken)
    odd = taken[:beyond]
    sound = float(np.mean([ratios[i] for i in range(len(lit)) if i not in odd]))
    found = [Odd(lit[i], float(ratios[i] / sound - 1.0)) for i in sorted(odd)]
    return tuple(one for one in found if abs(one.off) * sound * one.reading.level > one.reading.half_digit_lux)
