"""A frequency to which events are locked that is not the stimulus: the ripple of a lamp, if there is one.

What comes back with every pulse, and what drifts in a straight line from pulse to pulse, is taken out of the events
first. A ripple is a line in the spectrum of what is left.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.recorded.line import no_more_than_most, sharpened_hz
from bench.diagnosis.recorded.stimulus_bins import POLARITIES, bins_of, counts_of, period_s

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    import numpy.typing as npt

    from bench.diagnosis.recorded.stimulus_bins import Bins
    from bench.store.data import PointData

    Floats = npt.NDArray[np.float64]
    Ints = npt.NDArray[np.int64]

__all__ = ["Lock", "locked", "ripple_hz", "with_ripple"]

#: Frequencies that are looked at, Hz, and how finely: at the least so, and to a share of what the longest recording
#: tells apart.
_LOWEST_HZ: Final = 15.0
_HIGHEST_HZ: Final = 1000.0
_APART_HZ: Final = 0.05
_FINER: Final = 0.25
#: Part of a ripple's power that does not come back with the stimulus, where something is to be seen of it.
_APART_FROM_STIMULUS: Final = 0.05
#: Events are counted in so many bins for each period of the highest frequency, and of a ripple that was found.
_BINS: Final = 4.0
_BINS_OF_FOUND: Final = 8.0
#: Fewer events of a polarity say nothing.
_FEWEST: Final = 100
#: The spectrum beside a line, within so many Hz, tells how strong chance is there.
_BESIDE_HZ: Final = 100.0
#: Chance of finding a ripple where there is none. A spectrum that is looked at between the frequencies which a
#: recording tells apart has about so many times as many chances.
_CHANCE: Final = 1e-3
_BETWEEN: Final = 3.0
#: Lines of which one is the ripple, others what pulses make of it, at the most.
_LINES: Final = 40
#: Of answers: standard deviations by which a line is above the others, and how much of it, beside what most of the
#: recordings have of it, each may give. What some settle to at first stands 19 above the others else, and a ripple of
#: 0.8 % ten; so these are 6 and 22.
_STANDS_OUT: Final = 8.0
_MORE_THAN_MOST: Final = 5.0


@dataclass(frozen=True)
class Lock:
    """How events of a recording go with a ripple, beyond what comes with the stimulus."""

    bins: Bins
    ripple: npt.NDArray[np.complex128]  #: (bins,) of amplitude 1, beyond the stimulus

    @property
    def seconds(self) -> float:
        """Length of the part that is looked at."""
        return self.bins.count * self.bins.width_s

    def of(self, t_us: Ints) -> npt.NDArray[np.complex128]:
        """Return what an event at each time adds to the amplitude; nothing outside of whole periods."""
        index = self.bins.of(t_us)
        return np.where(index >= 0, self.ripple[index], 0.0)

    def amplitude(self, chunks: Iterable[npt.NDArray[np.void]]) -> npt.NDArray[np.complex128]:
        """Return (2,) the amplitude with which events of each polarity go with the ripple, OFF before ON."""
        found = np.zeros(POLARITIES, np.complex128)
        for events in chunks:
            for polarity in range(POLARITIES):
                found[polarity] += self.of(events["t"][events["p"] == polarity]).sum()
        return found


def with_ripple(points: Sequence[PointData]) -> list[PointData]:
    """Return the points, those with a ripple with its frequency and the phases with which events go with it.

    They stand among the attributes: `ripple_hz`, and `ripple_off_rad` and `ripple_on_rad`.
    """
    found = ripple_hz(points)
    return list(points) if found is None else [_with_phases(point, found) for point in points]


def locked(point: PointData, frequency_hz: float) -> Lock | None:
    """Return how events go with a ripple of a frequency.

    None where the stimulus is neither steady nor repeats, and where the ripple comes back with it.
    """
    bins = bins_of(point, 1.0 / (_BINS_OF_FOUND * frequency_hz))
    if bins is None:
        return None
    t = bins.begin_s + (np.arange(bins.count) + 0.5) * bins.width_s
    waves = np.stack([np.cos(2.0 * math.pi * frequency_hz * t), np.sin(2.0 * math.pi * frequency_hz * t)])
    cosine, sine = bins.beyond_stimulus(waves)
    ripple = cosine - 1j * sine
    return Lock(bins, ripple) if float(np.mean(np.abs(ripple) ** 2)) > _APART_FROM_STIMULUS else None


def _with_phases(point: PointData, frequency_hz: float) -> PointData:
    lock = locked(point, frequency_hz)
    if lock is None:
        return point
    off, on = (float(phase) for phase in np.angle(lock.amplitude(point.events())))
    more = {"ripple_hz": frequency_hz, "ripple_off_rad": off, "ripple_on_rad": on}
    return replace(point, attributes={**point.attributes, **more})


def ripple_hz(points: Sequence[PointData]) -> float | None:
    """Return the frequency to which events are locked most, beside that of the stimulus, Hz; None: to none.

    Background events tell it best. Answers to pulses, seen once in each period, do not tell a ripple from others that
    differ by a multiple of the frequency of the pulses: only pulses of several periods do.

    Source: A. Schuster, "On the investigation of hidden periodicities", Terr. Magn. 3 (1898).
    """
    longest = max((p.duration_s for p in points), default=1.0)
    at = np.arange(_LOWEST_HZ, _HIGHEST_HZ, min(_APART_HZ, _FINER / longest))
    steady, pulsed = ([p for p in points if bool(len(p.pulse_start_s)) == pulses] for pulses in (False, True))
    lines = _of_background(steady, at) or _of_answers(pulsed, at)
    return sharpened_hz(points, lines) if lines else None


def _of_background(points: Sequence[PointData], at: Floats) -> list[float]:
    """Return the strongest lines of all points together, each beside chance in its neighbourhood."""
    spectra = [s / _nearby(s, at) for point in points for s in _spectra(point, at)]
    return _lines(spectra, points, at) if spectra else []


def _lines(spectra: Sequence[Floats] | Floats, points: Sequence[PointData], at: Floats) -> list[float]:
    """Return the strongest lines of spectra whose median is 1, Hz; none if chance makes one as strong as the first.

    Powers of chance are exponential, so their sum over n spectra is a gamma variable of shape n.
    """
    from scipy.stats import gamma

    total = math.log(2.0) * np.sum(spectra, axis=0)
    best = int(np.argmax(total))
    tried = _BETWEEN * (_HIGHEST_HZ - _LOWEST_HZ) * max(point.duration_s for point in points)
    p = float(gamma.sf(total[best], len(spectra))) * tried
    if p >= _CHANCE:
        return []
    higher = (total[1:-1] > total[:-2]) & (total[1:-1] >= total[2:])
    tops = 1 + np.flatnonzero(higher)
    strongest = tops[np.argsort(-total[tops], kind="stable")[:_LINES]]
    return [float(at[i]) for i in dict.fromkeys([best, *strongest])]


def _nearby(spectrum: Floats, at: Floats) -> Floats:
    """Return the median of a spectrum in the neighbourhood of each frequency."""
    blocks = max(round((at[-1] - at[0]) / _BESIDE_HZ), 1)
    middles = [float(part.mean()) for part in np.array_split(at, blocks)]
    medians = [float(np.median(part)) for part in np.array_split(spectrum, blocks)]
    return np.asarray(np.interp(at, middles, medians))


def _of_answers(points: Sequence[PointData], at: Floats) -> list[float]:
    """Return the lines of the sum of all spectra, if the strongest stands out.

    With pulses of one period alone it would be that of the stimulus, or any other.
    """
    from scipy.stats import median_abs_deviation

    spectra, periods = [], set()
    for point in points:
        mine = _spectra(point, at)
        spectra += [s / _nearby(s, at) for s in mine]
        periods |= {round(period_s(point) or 0.0, 4)} if mine else set()
    if len(periods) <= 1:
        return []
    # A ripple is in all recordings; what pixels settle to at first is slow beside the pulses, and in few of them.
    agreed = no_more_than_most(np.stack(spectra), _MORE_THAN_MOST)
    total = np.sum(agreed, axis=0)
    above = float(np.max(total) - np.median(total))
    # What lasts from pulse to pulse makes spectra of answers rougher than chance.
    stands_out = above > _STANDS_OUT * median_abs_deviation(total, scale="normal")
    return _lines(agreed, points, at) if stands_out else []


def _spectra(point: PointData, at: Floats) -> list[Floats]:
    """Return the power at some frequencies of each polarity that has enough events."""
    bins = bins_of(point, 1.0 / (_BINS * _HIGHEST_HZ))
    if bins is None:
        return []
    counts = counts_of(point, bins)
    # Zeros behind the end: the spectrum is looked at more finely than the recording is long.
    n = max(round(1.0 / ((at[1] - at[0]) * bins.width_s)), bins.count)
    frequency = np.fft.rfftfreq(n, bins.width_s)
    seen = bins.beyond_stimulus(counts[counts.sum(axis=1) >= _FEWEST])
    seen = seen[np.any(seen != 0.0, axis=1)]  # all pixels may answer each pulse in the same bin
    return [np.asarray(np.interp(at, frequency, np.abs(np.fft.rfft(one, n)) ** 2)) for one in seen]
