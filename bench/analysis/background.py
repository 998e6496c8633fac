"""Background activity: the events of constant points, by polarity."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bench.analysis.intervals import rate_interval
from bench.analysis.results import BackgroundRow, Estimate
from bench.analysis.windows import POLARITIES

if TYPE_CHECKING:
    from bench.analysis.tally import PointTally
    from bench.store.data import PointData

__all__ = ["background_rows"]


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
