"""Whether two engines have the same distribution of events: statistics of two recordings, and their tests."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from protocols.points import Roi

    Events = npt.NDArray[np.void]

__all__ = ["Pulses", "p_values", "same_polarity"]

#: Counts below this are not tested, nor latencies if there are fewer than twice as many.
_FEW: Final = 10


@dataclass(frozen=True, slots=True)
class Pulses:
    """Where in a periodic recording the tested pulses are."""

    roi: Roi  #: window
    period_s: float  #: s
    start_s: float  #: the pulse lasts from here to the end of the period, s
    periods: int  #: of which the first is left out


def _answers(events: Events, pulses: Pulses) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]:
    """Return how many pulses each pixel answered, from the second period on, and the sum of its latencies, s."""
    on = events[events["p"] == 1]
    period, since_us = np.divmod(on["t"].astype(np.int64), round(pulses.period_s * 1e6))
    inside = (since_us >= pulses.start_s * 1e6) & (period > 0)
    key = _index(on, pulses.roi) * pulses.periods + period
    answered, first = np.unique(key[inside], return_index=True)
    latency_s = since_us[inside][first] * 1e-6 - pulses.start_s
    pixel = answered // pulses.periods
    count = np.bincount(pixel, minlength=pulses.roi.pixels)
    total_s = np.bincount(pixel, weights=latency_s, minlength=pulses.roi.pixels)
    return count, np.asarray(total_s, np.float64)


def same_polarity(events: Events) -> tuple[int, int]:
    """Return how many pairs of events that follow each other in a pixel have the same polarity, and how many not."""
    pixel = events["y"].astype(np.int64) * 65536 + events["x"]
    order = np.lexsort((events["t"], pixel))
    pair = np.diff(pixel[order]) == 0
    same = (np.diff(events["p"][order].astype(int)) == 0)[pair]
    return int(same.sum()), int((~same).sum())


def p_values(first: Events, second: Events, pulses: Pulses) -> dict[str, float]:
    """Return how likely differences as large as these are between two recordings of one distribution.

    Of the number of events, the fraction of answered pulses, the latency of the first event, the share of ON events,
    and the share of pairs of one polarity. What is too rare to be tested has 1.

    Pixels are independent of each other, pulses of one pixel are not (a noisy memorised level lasts for many), so
    counts and latencies are compared pixel by pixel; the latter by the means of each pixel.
    """
    from scipy.stats import ks_2samp

    answers = [_answers(e, pulses) for e in (first, second)]
    latency = [total[n > 0] / n[n > 0] for n, total in answers]
    on = [int(e["p"].sum()) for e in (first, second)]
    return {
        "events": _two_means(_per_pixel(first, pulses.roi), _per_pixel(second, pulses.roi)),
        "response": _two_means(answers[0][0], answers[1][0]),
        "latency": float(ks_2samp(*latency).pvalue) if min(map(len, latency)) >= 2 * _FEW else 1.0,
        "polarity": _two_shares((on[0], len(first) - on[0]), (on[1], len(second) - on[1])),
        "pairs": _two_shares(same_polarity(first), same_polarity(second)),
    }


def _two_means(first: npt.NDArray[np.int64], second: npt.NDArray[np.int64]) -> float:
    """Return the p-value of the difference of counts, pixel by pixel."""
    from scipy.stats import norm

    difference = first - second
    error = max(float(difference.std()) * math.sqrt(len(difference)), 1.0)
    return float(2.0 * norm.sf(abs(int(difference.sum())) / error))


def _index(events: Events, roi: Roi) -> npt.NDArray[np.int64]:
    return np.asarray((events["y"].astype(np.int64) - roi.y) * roi.width + events["x"] - roi.x)


def _per_pixel(events: Events, roi: Roi) -> npt.NDArray[np.int64]:
    return np.bincount(_index(events, roi), minlength=roi.pixels)


def _two_shares(first: tuple[int, int], second: tuple[int, int]) -> float:
    from scipy.stats import chi2_contingency

    table = np.array([first, second])
    if np.any(table.sum(axis=0) < _FEW):
        return 1.0
    return float(chi2_contingency(table).pvalue)
