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

__all__ = ["Pulses", "first_latencies_s", "p_values", "same_polarity"]

#: Counts below this are not tested, nor latencies if there are fewer than twice as many.
_FEW: Final = 10


@dataclass(frozen=True, slots=True)
class Pulses:
    """Where in a periodic recording the tested pulses are."""

    roi: Roi  #: window
    period_s: float  #: s
    start_s: float  #: the pulse lasts from here to the end of the period, s
    periods: int  #: of which the first is left out


def first_latencies_s(events: Events, pulses: Pulses) -> npt.NDArray[np.float64]:
    """Return when the first ON event of each answered pulse comes, s after its edge; from the second period on."""
    on = events[events["p"] == 1]
    period, since_us = np.divmod(on["t"].astype(np.int64), round(pulses.period_s * 1e6))
    inside = (since_us >= pulses.start_s * 1e6) & (period > 0)
    key = _pixel(on) * pulses.periods + period
    _, first = np.unique(key[inside], return_index=True)
    return np.asarray(since_us[inside][first] * 1e-6 - pulses.start_s)


def same_polarity(events: Events) -> tuple[int, int]:
    """Return how many pairs of events that follow each other in a pixel have the same polarity, and how many not."""
    pixel = _pixel(events)
    order = np.lexsort((events["t"], pixel))
    pair = np.diff(pixel[order]) == 0
    same = (np.diff(events["p"][order].astype(int)) == 0)[pair]
    return int(same.sum()), int((~same).sum())


def p_values(first: Events, second: Events, pulses: Pulses) -> dict[str, float]:
    """Return how likely differences as large as these are between two recordings of one distribution.

    Of the number of events, the fraction of answered pulses, the latency of the first event, the share of ON events,
    and the share of pairs of one polarity. What is too rare to be tested has 1.
    """
    from scipy.stats import ks_2samp, norm

    shown = pulses.roi.pixels * (pulses.periods - 1)
    # Pixel by pixel, since they may differ, and events come in bursts.
    difference = _per_pixel(first, pulses.roi) - _per_pixel(second, pulses.roi)
    error = max(float(difference.std()) * math.sqrt(pulses.roi.pixels), 1.0)
    latency = [first_latencies_s(e, pulses) for e in (first, second)]
    on = [int(e["p"].sum()) for e in (first, second)]
    return {
        "events": float(2.0 * norm.sf(abs(int(difference.sum())) / error)),
        "response": _two_shares(*((len(a), shown - len(a)) for a in latency)),
        "latency": float(ks_2samp(*latency).pvalue) if min(map(len, latency)) >= 2 * _FEW else 1.0,
        "polarity": _two_shares((on[0], len(first) - on[0]), (on[1], len(second) - on[1])),
        "pairs": _two_shares(same_polarity(first), same_polarity(second)),
    }


def _pixel(events: Events) -> npt.NDArray[np.int64]:
    return np.asarray(events["y"].astype(np.int64) * 65536 + events["x"])


def _per_pixel(events: Events, roi: Roi) -> npt.NDArray[np.int64]:
    index = (events["y"].astype(np.int64) - roi.y) * roi.width + events["x"] - roi.x
    return np.bincount(index, minlength=roi.pixels)


def _two_shares(first: tuple[int, int], second: tuple[int, int]) -> float:
    from scipy.stats import chi2_contingency

    table = np.array([first, second])
    if np.any(table.sum(axis=0) < _FEW):
        return 1.0
    return float(chi2_contingency(table).pvalue)
