"""The answers at each light level, as the fit of a family takes them: shares of each pixel, and latencies."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.analysis.noisy_pixel import time_grid_s

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    import numpy.typing as npt

    from bench.analysis.results import CurveKey, ResponseRow
    from bench.store.data import PointData

    Floats = npt.NDArray[np.float64]

__all__ = ["Level", "Reset", "levels_of"]

_LEAST_ANSWERS: Final = 50  # that a contrast needs for its latencies to be used
_LEAST_SHARE: Final = 0.5  # of the pulses, likewise
_SILENT: Final = 0.003  # of the plateau: contrasts that far from the floor, or the plateau, lie on the rise
_ON_PLATEAU: Final = 3  # contrasts
_LATENCIES: Final = 4  # contrasts of a level whose latencies are used, at the most
_SAME_TIME_S: Final = 1e-9
_LEAST_ARMED: Final = 0.1  # of the gap
_HIGHEST: Final = (
    1.55  # of the lowest of them: far above the threshold a latency tells of the light more than of the pixel
)


@dataclass(frozen=True, slots=True)
class Reset:
    """What comes before a test pulse: a pulse whose end fires an opposite event, upon which the pixel memorises."""

    contrast: float  #: of the reset pulse over the baseline, ln; as large as it is, whatever its sign
    gap_s: float  #: from its end to the test pulse
    dead_s: float  #: dead time of the pixels; NaN: not known

    @property
    def armed_s(self) -> float:
        """For how long a pixel is armed before the step: the gap, less the dead time where it is known."""
        return self.gap_s if math.isnan(self.dead_s) else max(self.gap_s - self.dead_s, _LEAST_ARMED * self.gap_s)


@dataclass(frozen=True, slots=True)
class Level:
    """One reset/test curve. Pixels that never answered at any level are left out: dead, or switched off."""

    key: CurveKey
    contrast: Floats  #: (m,) ln, ascending
    pulses: Floats  #: (m,)
    share: Floats  #: (pixels, m) of the pulses that each pixel answered
    timed: npt.NDArray[np.intp]  #: (k,) places of the contrasts whose latencies are used
    latency_s: Floats  #: (k,) mean of the answers in the window
    latency_sd_s: Floats  #: (k,) its standard error
    window_s: float  #: length of the response window
    grid_s: float  #: time between two looks of the comparators; 0 for those that never look away
    reset: Reset

    @property
    def mean(self) -> Floats:
        """(m,) share of the pulses answered."""
        return np.asarray(self.share.mean(axis=0))


def levels_of(rows: Iterable[ResponseRow], points: Iterable[PointData]) -> list[Level]:
    """Return the reset/test curves of one polarity, from the dimmest level on; with less light behind a filter first.

    Parameters
    ----------
    rows
        The answers of one run to test pulses of one polarity, at one setting and pulse width.
    points
        The points of that run; they tell what comes before a pulse.
    """
    by_key: dict[CurveKey, list[ResponseRow]] = {}
    for row in rows:
        by_key.setdefault(row.key, []).append(row)
    curves = [sorted(own, key=lambda r: r.log_contrast) for own in by_key.values()]
    curves.sort(key=lambda own: (own[0].key.baseline_lux, -own[0].key.nd_od))
    grid_s = time_grid_s([row for own in curves for row in own])
    alive = np.any([row.per_pixel > 0 for own in curves for row in own], axis=0) if curves else np.zeros(0, np.bool_)
    point = {p.index: p for p in points}
    return [_level(own, alive, grid_s, _reset_of([point[row.point] for row in own])) for own in curves]


def _reset_of(points: Sequence[PointData]) -> Reset:
    """Return what comes before the test pulses of a level: the median of its points."""
    found = []
    for point in points:
        before = np.flatnonzero(point.stimulus_t_s < point.pulse_start_s[0] - _SAME_TIME_S)[-2:]
        end_s = point.stimulus_t_s[before[-1]] if before.size else 0.0
        lux = point.stimulus_lux[before]
        contrast = abs(math.log(lux[0] / lux[1])) if before.size == 2 and min(lux) > 0.0 else 0.0
        found.append((contrast, point.pulse_start_s[0] - end_s, point.refractory_s))
    return Reset(*(float(value) for value in np.median(found, axis=0)))


def _level(rows: Sequence[ResponseRow], alive: npt.NDArray[np.bool_], grid_s: float, reset: Reset) -> Level:
    rows = _telling(rows)
    pulses = np.array([float(row.pulses) for row in rows])
    share = np.stack([row.per_pixel[alive] for row in rows], axis=1) / pulses
    good = [
        i
        for i, row in enumerate(rows)
        if row.latency_counts.sum() >= _LEAST_ANSWERS and row.probability > _LEAST_SHARE
    ]
    good = [i for i in good if rows[i].log_contrast <= _HIGHEST * rows[good[0]].log_contrast]
    if len(good) > _LATENCIES:
        good = [good[i] for i in np.linspace(0, len(good) - 1, _LATENCIES).round().astype(int)]
    timing = [_mean_latency(rows[i]) for i in good]
    return Level(
        key=rows[0].key,
        contrast=np.array([row.log_contrast for row in rows]),
        pulses=pulses,
        share=share,
        timed=np.array(good, np.intp),
        latency_s=np.array([mean for mean, _ in timing]),
        latency_sd_s=np.array([sd for _, sd in timing]),
        window_s=float(rows[0].latency_edges_s[-1]),
        grid_s=grid_s,
        reset=reset,
    )


def _telling(rows: Sequence[ResponseRow]) -> list[ResponseRow]:
    """Return the rows on the rise of the curve, with the nearest below it and some on its plateau."""
    share = np.array([row.probability for row in rows])
    first = int(np.searchsorted(np.maximum.accumulate(share), _SILENT * share.max(), side="right"))
    full = int(np.argmax(share > (1.0 - _SILENT) * share.max()))
    return list(rows[max(first - 1, 0) : full + _ON_PLATEAU])


def _mean_latency(row: ResponseRow) -> tuple[float, float]:
    """Return the mean latency of the answers, s, and its standard error."""
    middle = 0.5 * (row.latency_edges_s[1:] + row.latency_edges_s[:-1])
    counts = row.latency_counts
    n = float(counts.sum())
    mean = float(counts @ middle) / n
    return mean, float(np.sqrt(max(float(counts @ (middle - mean) ** 2), 0.0)) / n)
