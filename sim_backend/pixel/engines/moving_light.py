"""What low-pass and high-pass make of the light, for a few dark currents, stretch by stretch."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sim_backend.pixel.chain import LOWEST_CURRENT_FA
from sim_backend.pixel.engines.stretches import UNIT

if TYPE_CHECKING:
    import numpy.typing as npt

    from sim_backend.pixel.chain import Chain
    from sim_backend.pixel.engines.segments import Segments
    from sim_backend.pixel.light_path import ChipLight

    Floats = npt.NDArray[np.float64]
    Whole = npt.NDArray[np.int64]

__all__ = ["MovingLight"]

#: Two pixels of the table are this far apart in the logarithm of the lowest photocurrent.
_NODE_STEP: Final = 0.02
#: Numbers in the table at the most, or those of the shortest stretch.
_TABLE: Final = 1 << 22


class MovingLight:
    """The table of :func:`sim_backend.pixel.engines.moving_kernels.follow` for one stretch after the other.

    Parameters
    ----------
    chain, on_chip, segments
        Pixels and light of the recording.
    fade
        Factor of the low-pass for a sample.
    high_share
        What the high-pass learns in a sample; 0 without one.
    """

    def __init__(
        self, chain: Chain, on_chip: ChipLight, segments: Segments, fade: float, high_share: float = 0.0
    ) -> None:
        self._on_chip = on_chip
        self._segments = segments
        self._fade = fade
        self._high_share = high_share
        self._rms = chain.noise_rms
        dark_lux = chain.dark_fa / chain.gain_fa_per_lux
        self.lowest_lux = LOWEST_CURRENT_FA / float(np.max(chain.gain_fa_per_lux))
        self.dark_lux, self.place = _nodes(dark_lux, float(np.min(segments.lux)))
        self._state: Floats | None = None
        self._start_lux = float(on_chip.lux(0, 1)[0])
        self._shift = np.zeros(len(segments.lux), np.int64)
        nothing = np.zeros((1, 1))
        #: Table, lows and highs; shift of each segment; no block goes beyond a multiple of so many samples.
        self.table: tuple[Any, ...] = (nothing, nothing, nothing, self._shift, UNIT)

    @property
    def stretch_samples(self) -> int:
        """Longest stretch for which the table has a moderate size."""
        return _TABLE // len(self.dark_lux) if self._segments.moving else _TABLE

    def prepare(self, begin: int, stop: int) -> None:
        """Fill the table for the samples `begin` to `stop` - 1; the first is the last one of the stretch before."""
        from sim_backend.pixel.engines import moving_kernels

        if not self._segments.moving:
            return
        cell = moving_kernels.CELL
        # Whole blocks and cells, so that nothing depends on where a stretch ends
        beyond = -(-(stop - 1) // UNIT) * UNIT + cell
        segment, first, last = self._runs(begin, beyond)
        columns = (last // cell - first // cell + 1) * cell
        shift = first // cell * cell - np.cumsum(columns) + columns
        self._shift[segment] = shift
        shape = (len(self.dark_lux), max(int(columns.sum()), cell))
        table = np.empty(shape)
        lows, highs = np.empty((shape[0], shape[1] // cell)), np.empty((shape[0], shape[1] // cell))
        samples = np.repeat(first - np.cumsum(last - first + 1) + (last - first + 1), last - first + 1)
        samples += np.arange(len(samples))
        goes_on = len(first) > 0 and first[0] > self._segments.first[segment[0]]
        if self._state is None:
            self._state = np.zeros((shape[0], moving_kernels.KEPT))
        moving_kernels.follow(
            np.stack([first, last, shift], axis=1), goes_on, stop - 2, self._on_chip.lux_at(samples),
            self._segments.lux[segment], self._start_lux, self.dark_lux, self.lowest_lux, self._fade,
            self._high_share, self._rms, self._state, table, lows, highs,
        )  # fmt: skip
        self.table = (table, lows, highs, self._shift, UNIT)

    def _runs(self, begin: int, beyond: int) -> tuple[Whole, Whole, Whole]:
        """Return the segments with moving light from `begin` to `beyond` - 1; its first and last sample in each."""
        starts, until = self._segments.first, self._segments.until
        segment = np.arange(
            np.searchsorted(starts, begin, side="right") - 1, np.searchsorted(starts, beyond - 1, side="right")
        )
        first = np.maximum(starts[segment], max(begin, 1))  # at t = 0 it is settled
        last = np.minimum(np.minimum(until[segment], starts[segment + 1] - 1), beyond - 1)
        moves = last >= first
        return segment[moves], first[moves], last[moves]


def _nodes(dark_lux: Floats, lowest_lux: float) -> tuple[Floats, Floats]:
    """Return some dark currents, as light, and where between them each pixel lies.

    They are powers of one number, whatever the pixels: the window changes nothing.
    """
    if not np.any(dark_lux > 0.0):
        return np.zeros(1), np.zeros(len(dark_lux))
    floor = max(lowest_lux, np.finfo(float).tiny)
    place = np.log(dark_lux + floor) / _NODE_STEP
    lowest = math.floor(np.min(place))
    nodes = np.exp(_NODE_STEP * np.arange(lowest, math.floor(np.max(place)) + 2)) - floor
    return np.maximum(nodes, 0.0), place - lowest
