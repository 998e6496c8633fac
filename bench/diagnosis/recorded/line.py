"""Which of some lines in spectra is the ripple, and its frequency: by least squares beside mean and trend.

A ripple that comes at nearly the same phase of each pulse is a slow wave from pulse to pulse. What mean and trend
take of it is missing in a spectrum: its highest place is then somewhere else, and pulses of different periods do not
agree on it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.recorded.stimulus_bins import bins_of, counts_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.diagnosis.recorded.stimulus_bins import Bins
    from bench.store.data import PointData

    Floats = npt.NDArray[np.float64]

__all__ = ["sharpened_hz"]

#: Frequencies that are tried: so far beside each line in such steps, then in finer ones beside the best, Hz.
_TRIED_HZ: Final = ((0.5, 0.02), (0.02, 0.002))
#: Bins of a period of the highest of them.
_BINS: Final = 8.0
_DIGITS: Final = 4
#: A wave of which mean and trend take all but this share of the power is none.
_LEFT: Final = 0.02
#: Frequencies of a spectrum beside those that it tells apart.
_FINER: Final = 4
#: So many numbers are worked on at a time.
_AT_ONCE: Final = 1 << 22


def sharpened_hz(points: Sequence[PointData], lines_hz: Sequence[float]) -> float:
    """Return the frequency near one of some lines at which a wave explains most of the events of all points.

    Source: J. D. Scargle, "Studies in astronomical time series analysis. II", Astrophys. J. 263 (1982): the power of
    a wave fitted by least squares.
    """
    width_s = 1.0 / (_BINS * max(lines_hz))
    known = [(bins, counts_of(point, bins)) for point in points if (bins := bins_of(point, width_s)) is not None]
    best = np.array(lines_hz)
    for reach, step in _TRIED_HZ:
        beside = step * np.arange(-round(reach / step), round(reach / step) + 1)
        at = np.unique(np.round(best[:, None] + beside, _DIGITS))
        power = sum((_power(counts, bins, at) for bins, counts in known), np.zeros(len(at)))
        best = at[[int(np.argmax(power))]]
    return float(best[0])


def _power(counts: Floats, bins: Bins, at: Floats) -> Floats:
    """Return what a wave of each frequency takes of the sum of squares of counts, in the unit of their variance.

    A wave is that from period to period of the stimulus, without mean and trend, times that within a period.
    """
    left = bins.beyond_stimulus(counts)
    variance = np.mean(left**2, axis=1)
    if bins.rows == 1:
        return _power_of_one_row(left[variance > 0.0], variance[variance > 0.0], bins, at)
    rows = (left[variance > 0.0] / np.sqrt(variance[variance > 0.0])[:, None]).reshape(-1, bins.rows, bins.columns)
    found = np.zeros(len(at))
    for part in np.array_split(np.arange(len(at)), max(len(at) * bins.count // _AT_ONCE, 1)):
        found[part] = _power_of_rows(rows, bins, 2.0 * math.pi * at[part, None])
    return found


def _power_of_one_row(left: Floats, variance: Floats, bins: Bins, at: Floats) -> Floats:
    """Return the same where the light is constant: a spectrum, looked at more finely than the recording is long."""
    n = _FINER * bins.count
    frequency = np.fft.rfftfreq(n, bins.width_s)
    found = np.zeros(len(at))
    for one, scatter in zip(left, variance, strict=True):
        found += np.interp(at, frequency, np.abs(np.fft.rfft(one, n)) ** 2) * 2.0 / (bins.count * scatter)
    return found


def _power_of_rows(rows: Floats, bins: Bins, turn: Floats) -> Floats:
    """Return the same of counts (polarities, rows, columns); (f, 1) radians of each wave in a second."""
    within = np.exp(1j * turn * (bins.begin_s + (np.arange(bins.columns) + 0.5) * bins.width_s))
    period_s = bins.columns * bins.width_s
    between = bins.beyond_trend(np.exp(1j * turn * (np.arange(bins.rows) * period_s)))
    products = [np.einsum("fr,rc,fc->f", between, one, within, optimize=True) for one in rows]
    along = sum(np.abs(product) ** 2 for product in products)
    crossed = sum(product**2 for product in products)
    # With a wave x + iy: sums of xx + yy, and of (x + iy)^2; of its product with counts alike.
    whole = np.sum(np.abs(between) ** 2, axis=1) * bins.columns
    twisted = np.sum(between**2, axis=1) * np.sum(within**2, axis=1)
    determinant = whole**2 - np.abs(twisted) ** 2
    seen = whole - np.abs(twisted) > _LEFT * bins.count
    power = 2.0 * (whole * along - np.real(np.conj(twisted) * crossed)) / np.where(seen, determinant, 1.0)
    return np.asarray(np.where(seen, power, 0.0))
