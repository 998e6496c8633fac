"""A frequency to which background events are locked: the ripple of a lamp, if there is one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.store.data import PointData

    Floats = npt.NDArray[np.float64]

__all__ = ["ripple_hz"]

#: Frequencies that are looked at, Hz, and how finely.
_LOWEST_HZ: Final = 15.0
_HIGHEST_HZ: Final = 1000.0
_APART_HZ: Final = 0.05
#: Events are counted in so many bins for each period of the highest frequency.
_BINS: Final = 4.0
#: A point with fewer events says nothing.
_FEWEST: Final = 100
#: The spectrum beside a line, within so many bins, tells how strong chance is there.
_BESIDE: Final = 101
#: Chance of finding a ripple where there is none.
_CHANCE: Final = 1e-3


def ripple_hz(points: Sequence[PointData]) -> float | None:
    """Return the frequency to which events at constant light are locked most, Hz; None: to none.

    Of each point the spectrum, beside that of chance in its neighbourhood: powers of chance are exponential, so their
    sum over n points is a gamma variable of shape n. Answers to pulses would not do: seen once in each period, a
    ripple cannot be told from others that differ by a multiple of the frequency of the pulses.

    Source: A. Schuster, "On the investigation of hidden periodicities", Terr. Magn. 3 (1898).
    """
    from scipy.stats import gamma

    at = np.arange(_LOWEST_HZ, _HIGHEST_HZ, _APART_HZ)
    steady = [point for point in points if not len(point.pulse_start_s)]
    spectra = [s for s in (_spectrum(point, at) for point in steady) if s is not None]
    if not spectra:
        return None
    total = np.sum(spectra, axis=0)
    best = int(np.argmax(total))
    tried = (_HIGHEST_HZ - _LOWEST_HZ) * max(point.duration_s for point in steady)
    p = float(gamma.sf(total[best], len(spectra))) * tried
    return float(round(at[best], 3)) if p < _CHANCE else None


def _spectrum(point: PointData, at: Floats) -> Floats | None:
    """Return the power at some frequencies, beside that of chance; None if there are too few events."""
    from scipy.ndimage import median_filter

    width = 1.0 / (_BINS * _HIGHEST_HZ)
    bins = max(int(point.duration_s / width), 1)
    counts = np.zeros(bins)
    for events in point.events():
        index = (events["t"] * (1e-6 / width)).astype(np.int64)
        counts += np.bincount(index[(index >= 0) & (index < bins)], minlength=bins)
    if counts.sum() < _FEWEST:
        return None
    power = np.abs(np.fft.rfft(counts - counts.mean())) ** 2
    chance = median_filter(power, _BESIDE, mode="nearest") / np.log(2.0)
    relative = np.divide(power, chance, out=np.zeros_like(power), where=chance > 0.0)
    return np.asarray(relative[np.clip(np.round(at * (bins * width)).astype(np.int64), 0, len(power) - 1)])
