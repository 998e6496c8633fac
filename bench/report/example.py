"""Which pixel of which point is shown as the example: one that answers as most of its neighbours do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Protocol

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

    from bench.analysis.results import Analysis
    from bench.store.data import PointData, RunHeader

__all__ = ["Example", "RunLike", "choose_example", "pixel_events"]

_TARGET_PROBABILITY: Final = 0.85  # most pulses are answered, and one now and then is not
_PERIODS: Final = 4
_AFTER: Final = 0.1  # of a period, so that the last answer does not stand at the edge
_LONGEST_S: Final = 20.0  # of a recording without pulses


class RunLike(Protocol):
    """What the report needs of a run."""

    @property
    def header(self) -> RunHeader:
        """What ``run.yaml`` says."""

    def points(self) -> Iterator[PointData]:
        """Yield the finished points."""


@dataclass(frozen=True, slots=True)
class Example:
    """A pixel and a stretch of time of one point."""

    point: PointData
    x: int  #: sensor coordinates
    y: int
    start_s: float
    stop_s: float


def choose_example(run: RunLike, analysis: Analysis) -> Example | None:
    """Return the example that the report shows, or None where no point has an event.

    The point is the one whose response probability is nearest to 0.85, else the constant point with most events; the
    pixel is the one with the median number of events among those that have any.
    """
    point = _point(run, analysis)
    if point is None:
        return None
    counts = _counts(point)
    active = np.flatnonzero(counts)
    if not active.size:
        return None
    middle = active[np.argsort(counts[active], kind="stable")[active.size // 2]]
    row, column = divmod(int(middle), point.roi.width)
    start_s, stop_s = _stretch(point)
    return Example(point, point.roi.x + column, point.roi.y + row, start_s, stop_s)


def _point(run: RunLike, analysis: Analysis) -> PointData | None:
    rows = [row for row in analysis.responses if np.isfinite(row.probability) and row.responses]
    if rows:
        wanted = min(rows, key=lambda row: (abs(row.probability - _TARGET_PROBABILITY), row.point)).point
        return next((point for point in run.points() if point.index == wanted), None)
    return max(run.points(), key=lambda point: point.n_events, default=None)


def _counts(point: PointData) -> npt.NDArray[np.int64]:
    """Return the events of each pixel of the window, row by row; events outside it are not counted."""
    roi = point.roi
    counts = np.zeros(roi.pixels, np.int64)
    for events in point.events():
        x, y = events["x"].astype(np.int64) - roi.x, events["y"].astype(np.int64) - roi.y
        inside = (x >= 0) & (x < roi.width) & (y >= 0) & (y < roi.height)
        counts += np.bincount(y[inside] * roi.width + x[inside], minlength=roi.pixels)
    return counts


def _stretch(point: PointData) -> tuple[float, float]:
    """Return the time that is shown: a few periods, or the beginning of a recording without pulses."""
    if not point.pulse_start_s.size:
        return 0.0, min(point.duration_s, _LONGEST_S)
    of_a_kind = np.sort(point.pulse_start_s[point.pulse_kind == point.pulse_kind[0]])
    if of_a_kind.size == 1:
        return 0.0, point.duration_s
    period_s = float(np.median(np.diff(of_a_kind)))
    window_s = float(point.pulse_stop_s[0] - point.pulse_start_s[0])
    last_s = float(of_a_kind[min(_PERIODS, of_a_kind.size) - 1])
    start_s = max(0.0, float(of_a_kind[0]) - (period_s - window_s))
    return start_s, min(point.duration_s, last_s + window_s + _AFTER * period_s)


def pixel_events(example: Example) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.uint8]]:
    """Return the times in s and the polarities (1 = ON) of the events of the example that fall into its stretch."""
    times, polarities = [np.zeros(0)], [np.zeros(0, np.uint8)]
    for events in example.point.events():
        t_s = events["t"] * 1e-6
        mine = (events["x"] == example.x) & (events["y"] == example.y)
        mine &= (t_s >= example.start_s) & (t_s <= example.stop_s)
        times.append(t_s[mine])
        polarities.append(events["p"][mine])
    return np.concatenate(times), np.concatenate(polarities)
