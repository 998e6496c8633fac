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
_TRIED_HZ: Final = ((0.5, 0.02), (0.06, 0.002))
#: Bins of a period of the highest of them.
_BINS: Final = 8.0
_DIGITS: Final = 4
#: A wave of which mean and trend take all but this share of the power is none.
_LEFT: Final = 0.02
#: Frequencies of a spectrum beside those that it tells apart.
_FINER: Final = 4
#: What a wave takes of one recording of pulses counts up to so many times what it takes of most.
_MORE_THAN_MOST: Final = 10.0
#: So many numbers are worked on at a time.
_AT_ONCE: Final = 1 << 22


def sharpened_hz(points: Sequence[PointData], lines_hz: Sequence[float]) -> float:
    """Return the frequency near one of some lines at which a wave explains most of the events of all points.

    Source: J. D. Scargle, "Studies in astronomical time series analysis. II", Astrophys. J. 263 (1982): the power of
    a wave fitted by least squares.
    """
    width_s = 1.0 / (_BINS * max(lines_hz))
    known = [(bins, counts_of(point, bins)) for point in points if (bins := bins_of(point, width_s)) is not None]
    pulsed = np.array([bins.rows > 1 for bins, _ in known])
    best = np.array(lines_hz)
    for reach, step in _TRIED_HZ:
        beside = step * np.arange(-round(reach / step), round(reach / step) + 1)
        at = np.unique(np.round(best[:, None] + beside, _DIGITS))
        powers = _powers(known, at)
        # Which line it is, most recordings agree on; where it is, those tell in which it is strong.
        power = _agreed(powers, pulsed) if len(best) > 1 else np.sum(powers, axis=0)
        best = at[[int(np.argmax(power))]]
    return float(best[0])


def _agreed(powers: Floats, pulsed: npt.NDArray[np.bool_]) -> Floats:
    """Return (f,) the sum of what waves take of all points, (points, f).

    A ripple is in all recordings. What a few of them do from pulse to pulse, as they settle, is slow beside the
    pulses, as strong as a ripple, and in few of them.
    """
    if not pulsed.any():
        return np.asarray(np.sum(powers, axis=0))
    steady = np.sum(powers[~pulsed], axis=0)
    return np.asarray(steady + np.sum(no_more_than_most(powers[pulsed], _MORE_THAN_MOST), axis=0))


def no_more_than_most(powers: Floats, times: float) -> Floats:
    """Return powers (recordings, f), each no larger than so many times the median of all recordings."""
    return np.asarray(np.minimum(powers, times * np.median(powers, axis=0)))


def _powers(known: Sequence[tuple[Bins, Floats]], at: Floats) -> Floats:
    """Return (points, f) what each wave takes of the sum of squares of counts, in the unit of their variance.

    A wave is that from period to period of the stimulus, without mean and trend, times that within a period.
    """
    found = np.zeros((len(known), len(at)))
    alike: dict[Bins, dict[int, Floats]] = {}  # points of one stimulus are laid beside the same waves
    for i, (bins, counts) in enumerate(known):
        left = bins.beyond_stimulus(counts)
        variance = np.mean(left**2, axis=1)
        left, variance = left[variance > 0.0], variance[variance > 0.0]
        if bins.rows == 1:
            found[i] = _power_of_one_row(left, variance, bins, at)
        else:
            rows = (left / np.sqrt(variance)[:, None]).reshape(-1, bins.rows, bins.columns)
            alike.setdefault(bins, {})[i] = rows
    for bins, each in alike.items():
        for part in np.array_split(np.arange(len(at)), max(len(at) * bins.count // _AT_ONCE, 1)):
            waves = _Waves(bins, 2.0 * math.pi * at[part, None])
            for i, rows in each.items():
                found[i, part] = waves.power(rows)
    return found


def _power_of_one_row(left: Floats, variance: Floats, bins: Bins, at: Floats) -> Floats:
    """Return the same where the light is constant: a spectrum, looked at more finely than the recording is long."""
    n = _FINER * bins.count
    frequency = np.fft.rfftfreq(n, bins.width_s)
    found = np.zeros(len(at))
    for one, scatter in zip(left, variance, strict=True):
        found += np.interp(at, frequency, np.abs(np.fft.rfft(one, n)) ** 2) * 2.0 / (bins.count * scatter)
    return found


class _Waves:
    """Waves of some frequencies in the bins of a stimulus that repeats.

    Parameters
    ----------
    bins
        Several rows of them.
    turn
        (f, 1) radians of each wave in a second.
    """

    def __init__(self, bins: Bins, turn: Floats) -> None:
        within = np.exp(1j * turn * (bins.begin_s + (np.arange(bins.columns) + 0.5) * bins.width_s))
        period_s = bins.columns * bins.width_s
        between = bins.beyond_trend(np.exp(1j * turn * (np.arange(bins.rows) * period_s)))
        self._within, self._between = within, between
        # With a wave x + iy: sums of xx + yy, and of (x + iy)^2.
        self._whole = np.sum(np.abs(between) ** 2, axis=1) * bins.columns
        self._twisted = np.sum(between**2, axis=1) * np.sum(within**2, axis=1)
        self._seen = self._whole - np.abs(self._twisted) > _LEFT * bins.count
        determinant = self._whole**2 - np.abs(self._twisted) ** 2
        self._determinant = np.where(self._seen, determinant, 1.0)

    def power(self, rows: Floats) -> Floats:
        """Return (f,) what each takes of the sum of squares of counts (polarities, rows, columns)."""
        products = [np.einsum("fr,rc,fc->f", self._between, one, self._within, optimize=True) for one in rows]
        along = sum(np.abs(product) ** 2 for product in products)
        crossed = sum(product**2 for product in products)
        power = 2.0 * (self._whole * along - np.real(np.conj(self._twisted) * crossed)) / self._determinant
        return np.asarray(np.where(self._seen, power, 0.0))
