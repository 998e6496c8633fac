"""Background activity against light: what of it is regular (a leak), what is random, and the noise that this takes.

A leak drifts one way, so it makes ON events and no OFF events; noise that crosses one threshold comes back and
crosses the other, so it makes about as many of each. The surplus of ON events is counted as the regular part, ``leak
= theta_on (R_on - R_off)``, the rest as random. The noise behind the low-pass that gives the random rate follows from
the law of :mod:`bench.models.noise_chain` for a pixel of these thresholds, dead time and bandwidth. It is no better
than the bandwidth: noise of half the bandwidth makes half the events.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.analysis.results import Estimate
from bench.analysis.tally import tally_point
from bench.characterize.result import NoiseLevel, Spot

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import numpy.typing as npt

    from bench.analysis.results import BackgroundRow
    from bench.store.data import PointData

__all__ = ["PixelKnown", "hot_pixels_in", "noise_levels"]

_STEP_S: Final = 1e-5  # between two looks of the comparators
_LARGEST: Final = 12.0  # threshold / noise: beyond it there is no event in a lifetime
_SMALLEST: Final = 2.0
_ROUNDS: Final = 40
_MANY_EVENTS: Final = 5.0  # by which factor a hot pixel exceeds the usual rate at the least
_CHANCE: Final = 1e-3  # of one pixel of the window looking hot by chance


@dataclass(frozen=True, slots=True)
class PixelKnown:
    """What is known of a pixel."""

    theta_on: float  #: ln; NaN where no ON curves were taken
    theta_off: float  #: ln; likewise
    corner_hz: float
    refractory_s: float  #: NaN where it is not known


def noise_levels(rows: Sequence[BackgroundRow], pixels: Mapping[str, PixelKnown]) -> list[NoiseLevel]:
    """Return what each constant light tells, the brightest last.

    Parameters
    ----------
    pixels
        What is known of the pixel at each setting; without it leak and noise are left out.
    """
    points: dict[int, dict[str, BackgroundRow]] = {}
    for row in rows:
        points.setdefault(row.point, {})[row.polarity] = row
    found = [
        _level(own["on"], own["off"], pixels.get(own["on"].settings)) for own in points.values() if len(own) == 2
    ]
    return sorted(found, key=lambda level: (level.settings, level.baseline_lux, -level.nd_od))


def _level(on: BackgroundRow, off: BackgroundRow, known: PixelKnown | None) -> NoiseLevel:
    surplus = on.rate.value - off.rate.value
    reach = math.hypot(on.rate.high - on.rate.low, off.rate.high - off.rate.low) / 2.0
    random_hz = on.rate.value + off.rate.value - max(surplus, 0.0)
    leak = None
    if (
        known is not None and math.isfinite(known.theta_on) and surplus > 0.0
    ):  # more OFF events are no leak, but a lower OFF threshold
        leak = Estimate(
            surplus * known.theta_on, (surplus - reach) * known.theta_on, (surplus + reach) * known.theta_on, "ln/s"
        )
    told = (
        known is not None and math.isfinite(known.theta_on + known.theta_off + known.refractory_s) and random_hz > 0.0
    )
    rms = _noise_for(random_hz, known) if known is not None and told else math.nan
    corner = math.nan if known is None else known.corner_hz
    return NoiseLevel(on.baseline_lux, on.nd_od, on.settings, on.rate, off.rate, random_hz, leak, rms, corner)


def _noise_for(rate_hz: float, known: PixelKnown) -> float:
    """Return the rms, ln, that gives a rate of ON and OFF events together; NaN where none does."""
    from scipy.optimize import brentq

    from bench.models.noise_chain import lasting_rate

    rho = math.exp(-2.0 * math.pi * known.corner_hz * _STEP_S)
    dead = round(known.refractory_s / _STEP_S)
    least = min(known.theta_on, known.theta_off)

    def excess(a: float) -> float:
        on, off = a * known.theta_on / least, a * known.theta_off / least
        return math.log(max(lasting_rate(on, off, rho, dead) / _STEP_S, 1e-300) / rate_hz)

    if excess(_SMALLEST) < 0.0 or excess(_LARGEST) > 0.0:
        return math.nan
    return least / float(brentq(excess, _SMALLEST, _LARGEST, xtol=1e-4, maxiter=_ROUNDS))


def hot_pixels_in(points: Sequence[PointData]) -> list[Spot]:
    """Return the pixels whose rate in all constant light together stands out, the hottest first.

    A pixel is hot when Poisson events at five times the median rate of its window (or one event in the time observed,
    if that is more) would make as many in one of a thousand windows.
    """
    counts: dict[tuple[int, int, int, int], npt.NDArray[np.int64]] = {}
    seconds: dict[tuple[int, int, int, int], float] = {}
    for point in points:
        if point.waveform == "constant":
            tally = tally_point(point)
            roi = (point.roi.x, point.roi.y, point.roi.width, point.roi.height)
            counts[roi] = counts.get(roi, np.zeros(point.roi.pixels, np.int64)) + tally.pixel_events.sum(axis=0)
            seconds[roi] = seconds.get(roi, 0.0) + tally.observed_s
    found = [spot for roi, events in counts.items() for spot in _hot(roi, events, seconds[roi])]
    return sorted(found, key=lambda spot: -spot.rate_hz)


def _hot(roi: tuple[int, int, int, int], events: npt.NDArray[np.int64], seconds: float) -> list[Spot]:
    from scipy.special import pdtrc

    usual = float(np.median(events))
    expected = max(_MANY_EVENTS * usual, 1.0)
    hot = np.flatnonzero(pdtrc(events - 1, expected) < _CHANCE / events.size)
    return [
        Spot(roi[0] + int(i) % roi[2], roi[1] + int(i) // roi[2], float(events[i]) / seconds, usual / seconds)
        for i in hot
    ]
