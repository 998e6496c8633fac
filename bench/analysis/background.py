"""Background activity: the events of constant points, by polarity."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from bench.analysis.intervals import rate_interval
from bench.analysis.results import BackgroundRow, Estimate
from bench.analysis.windows import POLARITIES

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bench.analysis.tally import PointTally
    from bench.store.data import PointData

__all__ = ["background_rows", "drift_warnings"]

_CLEAR_SIGMA: Final = 5.0
_CLEAR_SHARE: Final = 0.05  #: of the events, by which the halves of a recording must differ to be worth a word


def background_rows(point: PointData, tally: PointTally, settings: str) -> tuple[BackgroundRow, ...]:
    """Return the background rates of a constant point: ON, then OFF.

    Parameters
    ----------
    settings
        Label of the bias settings, empty where a run has only one.
    """
    rows = []
    for value in (1, 0):
        events = tally.pixel_events[value][tally.active]
        rate, low, high = rate_interval(events, tally.observed_s)
        rows.append(
            BackgroundRow(
                point=point.index,
                polarity=POLARITIES[value],
                baseline_lux=point.baseline_lux,
                nd_od=point.nd_od,
                events=int(events.sum()),
                pixel_seconds=float(np.count_nonzero(tally.active)) * tally.observed_s,
                rate=Estimate(rate, low, high, "Hz", _note(int(events.sum()), events.size)),
                settings=settings,
            )
        )
    return tuple(rows)


def _note(events: int, pixels: int) -> str:
    if not pixels:
        return "all pixels are masked"
    return "" if events else "no events: the upper end is an upper limit"


def drift_warnings(point: PointData, tally: PointTally) -> Iterator[str]:
    """Yield a warning if the rate of a constant point is clearly not the same in both halves of the recording.

    The difference is summed over the pixels, and compared with its spread between pixels. A recording with gaps is
    not judged, nor one of a single pixel.
    """
    first = tally.first_half[tally.active]
    difference = 2 * first - tally.pixel_events.sum(axis=0)[tally.active]
    events, surplus = int(tally.pixel_events.sum()), int(difference.sum())
    if point.gaps_s.size or difference.size < 2 or abs(surplus) <= _CLEAR_SHARE * events:
        return
    if abs(surplus) <= _CLEAR_SIGMA * float(np.sqrt(difference.size) * difference.std(ddof=1)):
        return
    half_pixel_seconds = 0.5 * point.duration_s * difference.size
    before_hz, after_hz = (0.5 * (events + s) / half_pixel_seconds for s in (surplus, -surplus))
    yield (
        f"the rate {'falls' if surplus > 0 else 'rises'} during the recording: {before_hz:.3g} Hz in the first half, "
        f"{after_hz:.3g} Hz in the second; references settle after the start, take longer recordings"
    )
