"""Whether the readout ruled the rate of events, and not the pixels; it shows as in the verdict on a point.

Events that come by themselves scatter, those that wait for a readout do not. Effects of the catalogue do as much
(`readout_saturation`, `event_rate_limit`), so it is no reason against the data.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.recorded.excerpt import ENOUGH_EVENTS

if TYPE_CHECKING:
    import numpy.typing as npt

    from bench.store.data import PointData

    Floats = npt.NDArray[np.float64]

__all__ = ["readout_limit_eps"]

# The numbers are those of `bench.run.verdict_rates`: what was told while a run was taken is told of it later, too.
_MS_US: Final = 1000
_PER_S: Final = 1000.0  #: ms in a second
#: Time that is looked at, ms: 17 minutes.
_MOST_MS: Final = 1 << 20
#: A rate stands at a ceiling for so long, ms: for less, all pixels may have answered at once.
_CEILING_MS: Final = 16
#: Events in each ms of it: with fewer, chance makes ceilings.
_FEWEST: Final = 100
#: Variance of their numbers, beside that of independent events.
_DISPERSION: Final = 0.05
#: Of the highest rate of the recording.
_TOP: Final = 0.9
#: Pixels that fire whenever they can have this share of what their dead time allows, or more: no readout.
_OF_DEAD_TIME: Final = 0.7
#: 90 % of the 16-bit words that a camera is known to transfer, 1/s.
_LINK_EPS: Final = 0.9e8


def readout_limit_eps(point: PointData) -> float | None:
    """Return at which rate the readout was the limit, 1/s; None if it was not.

    The readout is that of the whole window, where the middle of it is looked at; as many events are read of it as are
    enough of a run.
    """
    whole = point if point.stored_roi is None else replace(point, roi=point.stored_roi, stored_roi=None)
    counts = _per_ms(whole)
    found = _ceiling_eps(counts, whole)
    highest = _PER_S * float(counts.max())
    return highest if found is None and highest >= _LINK_EPS else found


def _per_ms(point: PointData) -> Floats:
    """Return (n,) the number of events in each ms of a recording, or of its first ones."""
    counts = np.zeros(min(max(round(_PER_S * point.duration_s), 1), _MOST_MS))
    read = 0
    for events in point.events():
        ms = np.maximum(events["t"], 0) // _MS_US
        seen = ms[ms < counts.size]
        counts += np.bincount(seen, minlength=counts.size)
        read += events.size
        if seen.size < events.size or read >= ENOUGH_EVENTS:
            break
    return counts


def _ceiling_eps(counts: Floats, point: PointData) -> float | None:
    """Return the rate of the first time in which events came without scatter, at the highest rate of all."""
    n = _CEILING_MS
    if counts.size < n:
        return None
    sums, squares = (np.cumsum(np.append(0.0, values)) for values in (counts, np.square(counts)))
    mean = (sums[n:] - sums[:-n]) / n
    variance = np.maximum((squares[n:] - squares[:-n]) / n - np.square(mean), 0.0) * n / (n - 1)
    steady = (mean >= max(_FEWEST, _TOP * counts.max())) & (variance <= _DISPERSION * mean)
    steady &= _PER_S * mean < _dead_time_eps(point)
    return _PER_S * float(mean[steady.argmax()]) if steady.any() else None


def _dead_time_eps(point: PointData) -> float:
    """Return from which rate on pixels fire whenever they can; infinite where that is not known."""
    dead_s = point.refractory_s
    known = math.isfinite(dead_s) and dead_s > 0.0
    return _OF_DEAD_TIME * point.roi.pixels / dead_s if known else math.inf
