"""A frequency to which events are locked that is not the stimulus: the ripple of a lamp, if there is one."""

from __future__ import annotations

import math
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
#: Of answers: standard deviations by which a line is above the others.
_STANDS_OUT: Final = 6.0
#: With fewer pulses nothing repeats.
_PULSES: Final = 4
#: and they repeat to this, s.
_REPEATS_S: Final = 1e-5


def ripple_hz(points: Sequence[PointData]) -> float | None:
    """Return the frequency to which events are locked most, beside that of the stimulus, Hz; None: to none.

    Background events tell it best. Answers to pulses, seen once in each period, do not tell a ripple from others that
    differ by a multiple of the frequency of the pulses: only where pulses of several periods agree.

    Source: A. Schuster, "On the investigation of hidden periodicities", Terr. Magn. 3 (1898).
    """
    at = np.arange(_LOWEST_HZ, _HIGHEST_HZ, _APART_HZ)
    steady, pulsed = ([p for p in points if bool(len(p.pulse_start_s)) == pulses] for pulses in (False, True))
    found = _of_background(steady, at)
    return found if found is not None else _of_answers(pulsed, at)


def _of_background(points: Sequence[PointData], at: Floats) -> float | None:
    """Return the strongest line of all points together.

    Of each point the spectrum, beside that of chance in its neighbourhood: powers of chance are exponential, so their
    sum over n points is a gamma variable of shape n.
    """
    from scipy.stats import gamma

    spectra = [s for s in (_spectrum(point, at) for point in points) if s is not None]
    if not spectra:
        return None
    total = np.sum(spectra, axis=0)
    best = int(np.argmax(total))
    tried = (_HIGHEST_HZ - _LOWEST_HZ) * max(point.duration_s for point in points)
    p = float(gamma.sf(total[best], len(spectra))) * tried
    return float(round(at[best], 3)) if p < _CHANCE else None


def _of_answers(points: Sequence[PointData], at: Floats) -> float | None:
    """Return the line that stands out in most points: the sum of logarithms asks for all of them, not for a few.

    With pulses of one period alone it would be that of the stimulus, or any other.
    """
    from scipy.stats import median_abs_deviation

    repeated = [point for point in points if _period_s(point) is not None]
    spectra = [s for s in (_spectrum(point, at) for point in repeated) if s is not None]
    if not spectra or len({round(_period_s(point) or 0.0, 4) for point in repeated}) == 1:
        return None
    total = np.sum(np.log1p(spectra), axis=0)
    best = int(np.argmax(total))
    above = float(total[best] - np.median(total))
    return float(round(at[best], 3)) if above > _STANDS_OUT * median_abs_deviation(total, scale="normal") else None


def _period_s(point: PointData) -> float | None:
    """Return the period of the stimulus, two pulses; None if it does not repeat."""
    apart = point.pulse_start_s[2:] - point.pulse_start_s[:-2]
    if len(point.pulse_start_s) < _PULSES or float(np.ptp(apart)) > _REPEATS_S:
        return None
    return float(apart[0])


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
    power = np.abs(np.fft.rfft(_beyond_stimulus(counts, point, width))) ** 2
    chance = median_filter(power, _BESIDE, mode="nearest") / np.log(2.0)
    relative = np.divide(power, chance, out=np.zeros_like(power), where=chance > 0.0)
    return np.asarray(relative[np.clip(np.round(at * (bins * width)).astype(np.int64), 0, len(power) - 1)])


def _beyond_stimulus(counts: Floats, point: PointData, width: float) -> Floats:
    """Return counts less their mean at the same phase of the stimulus; 0 outside of whole periods of it."""
    period = _period_s(point)
    if period is None:
        return np.asarray(counts - counts.mean())
    begin = float(point.pulse_start_s[0])
    t = (np.arange(counts.size) + 0.5) * width - begin
    phase = np.floor(np.mod(t, period) / width).astype(np.int64)
    whole = (t >= 0.0) & (t < period * math.floor((point.duration_s - begin) / period))
    number = np.bincount(phase[whole], minlength=int(phase.max(initial=0)) + 1)
    mean = np.bincount(phase[whole], weights=counts[whole], minlength=number.size) / np.maximum(number, 1)
    return np.asarray(np.where(whole, counts - mean[phase], 0.0))
