"""Events of a recording in bins of time that lie alike in all periods of its stimulus."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, TypeVar

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from bench.store.data import PointData

    Floats = npt.NDArray[np.float64]
    Ints = npt.NDArray[np.int64]

_Number = TypeVar("_Number", np.float64, np.complex128)

__all__ = ["POLARITIES", "Bins", "bins_of", "counts_of", "period_s"]

POLARITIES: Final = 2
#: With fewer pulses nothing repeats; the first period is not like the others, as nothing came before it.
_PULSES: Final = 8
_FIRST: Final = 1
_LINE: Final = 2
#: What is left of counts that are the same in all periods is rounding.
_NOTHING: Final = 1e-9
#: and they repeat to this, s.
_REPEATS_S: Final = 1e-5


@dataclass(frozen=True)
class Bins:
    """Bins of a recording; those of one column of all rows are at the same place of the stimulus."""

    begin_s: float  #: of the first
    width_s: float
    rows: int  #: periods of the stimulus; of constant light 1
    columns: int

    @property
    def count(self) -> int:
        """Number of bins."""
        return self.rows * self.columns

    def of(self, t_us: Ints) -> Ints:
        """Return the bin of each time, -1 for those outside.

        Times are whole microseconds: from the middle of one, none lies on an edge, where rounding would tell in which
        bin it is, in one period otherwise than in the next.
        """
        index = np.floor(((t_us + 0.5) * 1e-6 - self.begin_s) / self.width_s).astype(np.int64)
        return np.where((index >= 0) & (index < self.count), index, -1)

    def beyond_stimulus(self, values: Floats) -> Floats:
        """Return (..., bins) values less mean and straight line of the same place in all periods."""
        if self.rows == 1:
            return np.asarray(values - values.mean(axis=-1, keepdims=True))
        each = values.reshape(*values.shape[:-1], self.rows, self.columns)
        left = np.moveaxis(self.beyond_trend(np.moveaxis(each, -1, -2)), -1, -2)
        return np.asarray(np.where(np.abs(left) > _NOTHING, left, 0.0).reshape(values.shape))

    def beyond_trend(self, values: npt.NDArray[_Number]) -> npt.NDArray[_Number]:
        """Return (..., periods) values less their mean and straight line; of constant light as they are."""
        if self.rows == 1:
            return values
        place = np.linspace(-1.0, 1.0, self.rows)
        basis, _ = np.linalg.qr(np.stack([np.ones_like(place), place], axis=1))
        return np.asarray(values - (values @ basis) @ basis.T)


def bins_of(point: PointData, width_s: float) -> Bins | None:
    """Return bins of about a width: of a recording under constant light, or of whole periods of the stimulus."""
    if not len(point.pulse_start_s):
        return Bins(0.0, width_s, 1, max(int(point.duration_s / width_s), 1))
    period = period_s(point)
    if period is None:
        return None
    columns = max(math.ceil(period / width_s - 1e-9), 1)
    begin = float(point.pulse_start_s[0]) + _FIRST * period
    rows = int((point.duration_s - begin) / period + 1e-9)
    return Bins(begin, period / columns, rows, columns) if rows > _LINE else None


def period_s(point: PointData) -> float | None:
    """Return the period of the stimulus, two pulses; None if it does not repeat."""
    apart = point.pulse_start_s[2:] - point.pulse_start_s[:-2]
    if len(point.pulse_start_s) < _PULSES or float(np.ptp(apart)) > _REPEATS_S:
        return None
    return float(apart[0])


def counts_of(point: PointData, bins: Bins) -> Floats:
    """(2, bins) how many events of each polarity are in each bin, OFF before ON."""
    counts = np.zeros((POLARITIES, bins.count))
    for events in point.events():
        index = bins.of(events["t"])
        for polarity in range(POLARITIES):
            mine = index[(index >= 0) & (events["p"] == polarity)]
            counts[polarity] += np.bincount(mine, minlength=bins.count)
    return counts
