"""When a stimulus began, told by the events that answered it: for recordings without triggers.

Every step of the light up is followed by ON events, every step down by OFF events. The offset is searched at which
most events of the expected polarity come right after the edges, and fewest right before them; first coarsely over the
whole recording, then finely. The response takes its time, so the offset that is found is late by the latency of the
sensor: good enough for responses in windows, not for latencies.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from protocols.stimulus import Stimulus

__all__ = ["EventClock", "FoundOffset", "find_offset"]

BIN_S: Final = 1e-4
_COARSE_BINS: Final = 10
#: Events within this time of an edge are taken for its answer, s; half the way to the next edge if that is less.
_ANSWER_S: Final = 0.02
#: Two offsets are told apart if their counts differ by so many standard deviations.
_CLEAR_SIGMA: Final = 5.0


class EventClock:
    """Counts ON and OFF events in bins of 0.1 ms while a recording passes by."""

    def __init__(self) -> None:
        self._counts = np.zeros((2, 1 << 16), np.int64)
        self._used = 0

    def add(self, events: npt.NDArray[np.void]) -> None:
        """Count the next events; times in us from 0."""
        if not len(events):
            return
        bins = events["t"] // round(BIN_S * 1e6)
        self._used = max(self._used, int(bins[-1]) + 1)
        while self._used > self._counts.shape[1]:
            self._counts = np.concatenate([self._counts, np.zeros_like(self._counts)], axis=1)
        for polarity in (0, 1):
            mine = bins[events["p"] == polarity]
            if len(mine):
                first = int(mine[0])
                counted = np.bincount(mine - first)
                self._counts[polarity, first : first + len(counted)] += counted

    def cumulative(self) -> npt.NDArray[np.int64]:
        """Return, for OFF and ON, the events before each bin edge: (2, bins + 1)."""
        return np.concatenate([np.zeros((2, 1), np.int64), self._counts[:, : self._used].cumsum(axis=1)], axis=1)


@dataclass(frozen=True, slots=True)
class FoundOffset:
    """Where the stimulus lies in the recording."""

    offset_s: float
    residual_s: float  #: spread (rms) of the single edges' answers around it
    doubtful: bool  #: another offset explains the events about as well, or the answers scatter
    note: str


def find_offset(stimulus: Stimulus, clock: EventClock, duration_s: float) -> FoundOffset | None:
    """Return when `stimulus` began in a recording of `duration_s`; None if it has no edge or does not fit in."""
    edges_s, up = stimulus.t_s[1:], np.diff(stimulus.lux) > 0.0
    if not len(edges_s) or edges_s[-1] - edges_s[0] > duration_s:
        return None
    answer_s = min(_ANSWER_S, 0.5 * float(np.diff(edges_s).min(initial=np.inf)))
    width = max(1, round(answer_s / BIN_S))
    cumulative = clock.cumulative()
    offsets = np.arange(-edges_s[0], duration_s - edges_s[-1] + BIN_S, _COARSE_BINS * BIN_S)
    coarse = _scores(edges_s, up, offsets, cumulative, width)
    best = int(coarse.argmax())
    fine_offsets = offsets[best] + BIN_S * np.arange(-2 * _COARSE_BINS, 2 * _COARSE_BINS + 1)
    fine = _scores(edges_s, up, fine_offsets, cumulative, width)
    offset_s = float(fine_offsets[fine.argmax()])
    others = coarse[np.abs(offsets - offset_s) > 2.0 * answer_s]
    return _judged(edges_s, up, offset_s, int(fine.max()), int(others.max(initial=0)), cumulative, width)


def _scores(
    edges_s: npt.NDArray[np.float64],
    up: npt.NDArray[np.bool_],
    offsets: npt.NDArray[np.float64],
    cumulative: npt.NDArray[np.int64],
    width: int,
) -> npt.NDArray[np.int64]:
    """Return, for each offset, the events of the right polarity after all edges less those before them."""
    scores = np.zeros(len(offsets), np.int64)
    last = cumulative.shape[1] - 1
    for edge_s, rises in zip(edges_s, up, strict=True):
        at = np.rint((edge_s + offsets) / BIN_S).astype(np.int64)
        before, middle, after = ((at + d).clip(0, last) for d in (-width, 0, width))
        mine = cumulative[int(rises)]
        scores += mine[after] - 2 * mine[middle] + mine[before]
    return scores


def _judged(
    edges_s: npt.NDArray[np.float64],
    up: npt.NDArray[np.bool_],
    offset_s: float,
    score: int,
    second: int,
    cumulative: npt.NDArray[np.int64],
    width: int,
) -> FoundOffset:
    """Return the offset with its residual, and whether to believe it."""
    answers = [
        _median_answer_s(cumulative[int(r)], round((e + offset_s) / BIN_S), width)
        for e, r in zip(edges_s, up, strict=True)
    ]
    known = np.array([a for a in answers if not np.isnan(a)])
    residual_s = float(known.std()) if len(known) > 1 else float("nan")
    notes = []
    if score - second < _CLEAR_SIGMA * np.sqrt(max(score, 1)):
        notes.append("another beginning explains the events about as well")
    if not residual_s < 0.25 * width * BIN_S:
        notes.append("the answers to single edges scatter")
    return FoundOffset(offset_s, residual_s, bool(notes), "; ".join(notes))


def _median_answer_s(cumulative: npt.NDArray[np.int64], at: int, width: int) -> float:
    """Return when half of the events in the `width` bins from `at` have come, s after `at`; NaN without events."""
    window = cumulative[max(at, 0) : at + width + 1]
    if len(window) < 2 or window[-1] == window[0]:
        return float("nan")
    half = 0.5 * float(window[0] + window[-1])
    return BIN_S * float(np.searchsorted(window, half))
