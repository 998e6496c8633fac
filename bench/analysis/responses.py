"""The response table: one row for each point, polarity and contrast."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from bench.analysis.intervals import share_interval
from bench.analysis.results import ResponseRow

if TYPE_CHECKING:
    import numpy.typing as npt

    from bench.analysis.grouping import Entry
    from bench.analysis.results import CurveKey
    from bench.analysis.tally import GroupTally

__all__ = ["latency_edges", "response_row"]

_FIRST_EDGE_S: Final = 50e-6
_BINS_PER_DECADE: Final = 20


def latency_edges(window_s: float) -> npt.NDArray[np.float64]:
    """Return the edges in s of the histogram of latencies for a response window.

    The first bin is 0 to 50 us, then there are 20 bins a decade, the same in every point, up to the end of the
    window; edges are whole microseconds, as time stamps are.
    """
    decades = max(np.log10(max(window_s, _FIRST_EDGE_S) / _FIRST_EDGE_S), 0.0)
    powers = np.arange(int(np.ceil(decades * _BINS_PER_DECADE)) + 1) / _BINS_PER_DECADE
    inner = np.round(_FIRST_EDGE_S * 10.0**powers, 6)
    return np.concatenate(([0.0], inner[inner < window_s - 0.5e-6], [window_s]))


def response_row(entry: Entry, key: CurveKey) -> ResponseRow:
    """Return the row of the response table for one group of test pulses of one point."""
    tally = entry.tally
    # No copy where all pixels count: on a full sensor the copies of all points would fill the memory.
    answers = tally.answers if entry.active.all() else tally.answers[entry.active]
    pulses, pixels = tally.test.pulses, int(answers.size)
    probability, low, high = share_interval(answers, np.full(pixels, pulses, np.int64))
    edges = latency_edges(tally.test.window_s)
    quartile1, median, quartile3 = _latency_quantiles(tally)
    return ResponseRow(
        point=entry.point,
        key=key,
        log_contrast=tally.test.log_contrast,
        pulses=pulses,
        pixels=pixels,
        responses=int(answers.sum()),
        probability=probability,
        low=low,
        high=high,
        events_per_pulse=tally.events / (pulses * pixels) if pixels else float("nan"),
        answered_resets=_answered_resets(entry),
        per_pixel=answers,
        latency_edges_s=edges,
        latency_counts=_rebinned(tally, edges),
        latency_median_s=median,
        latency_iqr_s=quartile3 - quartile1,
    )


def _answered_resets(entry: Entry) -> float:
    resets = entry.tally.resets * int(entry.active.sum())
    return float(entry.tally.rearmed[entry.active].sum()) / resets if resets else float("nan")


def _rebinned(tally: GroupTally, edges_s: npt.NDArray[np.float64]) -> npt.NDArray[np.int64]:
    starts_s = np.arange(tally.latencies.size) * tally.latency_bin_us * 1e-6
    target = np.searchsorted(edges_s, starts_s + 1e-9, side="right") - 1
    inside = (target >= 0) & (target < edges_s.size - 1)
    counts = np.bincount(target[inside], weights=tally.latencies[inside], minlength=edges_s.size - 1)
    return counts.astype(np.int64)


def _latency_quantiles(tally: GroupTally) -> tuple[float, float, float]:
    """Return the quartiles of the latency in s, to the width of the fine bins (1 us in windows up to 262 ms)."""
    total = int(tally.latencies.sum())
    if not total:
        return float("nan"), float("nan"), float("nan")
    cumulative = np.cumsum(tally.latencies)
    bins = [int(np.searchsorted(cumulative, q * total)) for q in (0.25, 0.5, 0.75)]
    # A bin of one microsecond holds one time stamp: its start. A wider one is represented by its middle.
    shift = 0.5 * (tally.latency_bin_us - 1)
    q1, q2, q3 = ((b * tally.latency_bin_us + shift) * 1e-6 for b in bins)
    return q1, q2, q3
