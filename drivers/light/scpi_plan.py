"""As what a function generator times a waveform: one level, a square wave, or samples."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from drivers.light.scpi_samples import Samples, codes_of, samples_of
from drivers.light.waveform_shapes import Constant, NoShape, SquareWave, shape_of

if TYPE_CHECKING:
    from drivers.interfaces import Waveform
    from drivers.light.scpi_dialects import Dialect
    from drivers.light.scpi_samples import Memory

__all__ = ["LEAD", "Planner", "lead_s_of", "phase_deg_of"]

_SMALLEST_SWING_V: Final = 4e-3  #: 2 mV peak to peak into 50 ohm, the smallest amplitude of the coarsest of them
LEAD: Final = 1.0 / 360.0  #: part of a period before the first rise at which a burst starts that has to start low


class Planner:
    """What a generator can time.

    Parameters
    ----------
    dialect
        How it says things, and what it can do.
    memory
        Its memory for samples.
    volts_per_unit
        One unit of the level, V.
    """

    def __init__(self, dialect: Dialect, memory: Memory, volts_per_unit: float) -> None:
        self._dialect = dialect
        self._memory = memory
        self._volts_per_unit = volts_per_unit

    def plan(self, waveform: Waveform) -> Constant | SquareWave | Samples | NoShape:
        """Return as what the generator times `waveform`, or why it cannot."""
        shape = shape_of(waveform)
        if isinstance(shape, Constant):
            return shape
        not_square = shape.reason if isinstance(shape, NoShape) else self._not_square(shape)
        if not not_square and isinstance(shape, SquareWave):
            return shape
        samples = samples_of(waveform, self._memory)
        not_sampled = samples.reason if isinstance(samples, NoShape) else self._not_sampled(samples)
        return NoShape(f"as a square wave: {not_square}; as samples: {not_sampled}") if not_sampled else samples

    def _not_square(self, square: SquareWave) -> str:
        dialect, (lowest, highest) = self._dialect, self._dialect.duty
        if not lowest - 1e-9 <= square.duty <= highest + 1e-9:
            return f"its duty is {square.duty:.4g}; it can time {lowest:g} to {highest:g}"
        if square.period_s * dialect.highest_hz < 1.0:
            return f"its period is {square.period_s:.4g} s; it can time {1.0 / dialect.highest_hz:g} s and more"
        return self._not_burst(square.cycles, square.high - square.low)

    def _not_sampled(self, samples: Samples) -> str:
        codes = codes_of(samples, self._memory)
        reason = self._not_burst(samples.cycles, samples.highest - samples.lowest)
        return reason or (codes.reason if isinstance(codes, NoShape) else "")

    def _not_burst(self, cycles: int, swing: float) -> str:
        swing_v = swing * self._volts_per_unit
        if cycles > self._dialect.most_cycles:
            return f"it has {cycles} cycles; it can time {self._dialect.most_cycles}"
        if swing_v < _SMALLEST_SWING_V - 1e-9:
            return f"its levels are {swing_v:.4g} V apart; it can time {_SMALLEST_SWING_V:g} V and more"
        return ""


def lead_s_of(square: SquareWave, dialect: Dialect) -> float:
    """Return for how long the burst is at its lower level before the first rise, s."""
    if not dialect.starts_low:
        return 0.0
    low_s = (1.0 - square.duty) * square.period_s
    lead_s = min(LEAD * square.period_s, 0.5 * low_s, 0.5 * square.first_edge_s)
    grid_s = 1e-6 if lead_s > 10e-6 else 1e-9
    return math.floor(lead_s / grid_s) * grid_s


def phase_deg_of(period_s: float, lead_s: float, dialect: Dialect) -> float:
    """Return the phase at which a burst starts, `lead_s` before its first rise, degrees."""
    return 360.0 * (1.0 - lead_s / period_s) if lead_s > 0.0 and dialect.starts_low else 0.0
