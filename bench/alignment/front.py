"""The answers to many edges laid over each other: how they move along the recording, and when the first of them come.

Edges of one kind (from the same level to the same level) are answered in the same way. What one kind's answers look
like is taken from the recording itself; blocks of edges are compared with it, which tells how the clocks drift. The
front, where the rate of events begins to rise, tells when the light changed: no answer comes before.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.alignment.counts import BIN_S

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]

__all__ = ["Blocks", "Fold", "Front", "block_shifts", "find_front", "fold", "sharpest_drift"]

_FARTHEST_S: Final = 0.025  #: from an edge that is looked at
_OF_GAP: Final = 0.8  #: part of the time to the next edge that is looked at
_MOST_BLOCKS: Final = 60  #: of one kind
_DRIFT_BLOCKS: Final = 32  #: of one kind, where a drift is tried
_BLOCK_EVENTS: Final = 60  #: that a block has at least
_SMOOTH_S: Final = 1e-4  #: of what the answers of a kind look like
_FRONT_RISE: Final = 0.5  #: of the highest rate; the front is looked for below it
_FRONT_EVENTS: Final = 20  #: fewer answers than this have no front
_FRONT_GRID_S: Final = 1e-5
_BEFORE_FRONT_S: Final = 3e-3
_SLOW_RISE: Final = 0.2  #: of the time to the half of the rise: so far off may be a front that is not sharp
_SHAPES: Final = (0.5, 1.0, 2.0)  #: exponents of the rise of the rate


@dataclass(frozen=True, slots=True)
class Fold:
    """The answers to the edges of one kind, by time since where the edge is believed to be."""

    t_s: Floats  #: (b,) middle of each bin
    counts: npt.NDArray[np.int64]  #: (n, b) events of the edges' polarity
    at_s: Floats  #: (n,) where the edges are believed to be


@dataclass(frozen=True, slots=True)
class Blocks:
    """How much later than believed blocks of edges are answered, compared with all edges of their kind."""

    at_s: Floats  #: (k,) mean time of the edges
    late_s: Floats  #: (k,)
    sd_s: Floats  #: (k,) by the number of events alone


@dataclass(frozen=True, slots=True)
class Front:
    """Where the answers of a kind begin."""

    t_s: float  #: since where the edges are believed to be
    sd_s: float


def fold(
    binned: npt.NDArray[np.uint32], at_s: Floats, gap_before_s: float, gap_after_s: float, margin_s: float
) -> Fold:
    """Return the events of one polarity around edges.

    Parameters
    ----------
    binned
        Events of that polarity in bins of 50 us.
    at_s
        Where the edges are believed to be.
    gap_before_s, gap_after_s
        Shortest times to the neighbouring edges.
    margin_s
        How far from there they may be: at least so much is looked at on both sides.
    """
    before = round(max(min(_FARTHEST_S, _OF_GAP * gap_before_s), margin_s) / BIN_S)
    after = round(max(min(_FARTHEST_S, _OF_GAP * gap_after_s), margin_s) / BIN_S)
    place = np.rint(at_s / BIN_S).astype(np.int64)
    whole = (place >= before) & (place + after <= len(binned))
    place = place[whole]
    span = np.arange(-before, after)
    counts = binned[place[:, None] + span].astype(np.int64) if len(place) else np.zeros((0, len(span)), np.int64)
    return Fold(np.asarray((span + 0.5) * BIN_S, np.float64), counts, at_s[whole])


def block_shifts(folded: Fold, reach_s: float) -> Blocks:
    """Return how blocks of successive edges are shifted against all of them, up to `reach_s` to either side."""
    total = int(folded.counts.sum())
    edges = len(folded.counts)
    blocks = min(edges, _MOST_BLOCKS, max(total // _BLOCK_EVENTS, 1))
    if blocks < 2:
        none = np.empty(0)
        return Blocks(none, none, none)
    counts, at_s = _in_blocks(folded, blocks)
    reach = round(reach_s / BIN_S)
    likeness = counts @ _shifted(_log_rate(folded), reach).T
    best = likeness.argmax(axis=1).clip(1, likeness.shape[1] - 2)
    rows = np.arange(len(at_s))
    left, middle, right = (likeness[rows, best + d] for d in (-1, 0, 1))
    bent = np.maximum(2.0 * middle - left - right, 1e-9)
    late_s = (best - reach + 0.5 * (right - left) / bent) * BIN_S
    answered = counts.sum(axis=1) > 0
    return Blocks(at_s[answered], late_s[answered], (BIN_S / np.sqrt(bent))[answered])


def sharpest_drift(folds: Sequence[Fold], begin_s: float, end_s: float, reach_s: float, steps: int) -> float:
    """Return by how much later than believed the answers come at `end_s` than in the middle of `begin_s` and it, s.

    Laid over each other without a drift the answers of each kind lie closest together: the logarithm of the
    likelihood is highest, each kind having the mean rate that fits best.

    Parameters
    ----------
    reach_s
        Greatest drift that is tried, to either side.
    steps
        Number of drifts tried to either side.
    """
    tried = np.linspace(-reach_s, reach_s, 2 * steps + 1)
    likeness = np.zeros(len(tried))
    for folded in folds:
        counts, at_s = _in_blocks(folded, _DRIFT_BLOCKS)
        part = (2.0 * at_s - begin_s - end_s) / max(end_s - begin_s, BIN_S)
        move = np.rint(tried[:, None] * part / BIN_S).astype(np.int64)
        likeness += [_closeness(counts, one) for one in move]
    best = int(likeness.argmax())
    if not 0 < best < len(tried) - 1:
        return float(tried[best])
    left, middle, right = likeness[best - 1 : best + 2]
    bent = 2.0 * middle - left - right
    return float(tried[best] + (0.5 * (right - left) / bent if bent > 0.0 else 0.0) * (tried[1] - tried[0]))


def _in_blocks(folded: Fold, most: int) -> tuple[Floats, Floats]:
    """Return the counts of at most so many blocks of successive edges, and their mean times."""
    edges = len(folded.counts)
    start = np.linspace(0, edges, min(edges, most) + 1).astype(np.int64)[:-1]
    number = np.diff(np.append(start, edges))
    counts = np.add.reduceat(folded.counts, start, axis=0).astype(np.float64)
    return counts, np.add.reduceat(folded.at_s, start) / number


def _closeness(counts: Floats, move: npt.NDArray[np.int64]) -> float:
    """Return the log-likelihood of counts that are laid over each other after moving each row so many bins back."""
    from scipy.ndimage import gaussian_filter1d

    at = (np.arange(counts.shape[1]) + move[:, None]).clip(0, counts.shape[1] - 1)
    total = gaussian_filter1d(np.take_along_axis(counts, at, axis=1).sum(axis=0), 1.0, mode="nearest")
    return float((total * np.log(np.maximum(total, 1e-12))).sum())


def _log_rate(folded: Fold) -> Floats:
    """Return the logarithm of the smoothed mean rate; no rate is 0."""
    from scipy.ndimage import gaussian_filter1d

    mean = folded.counts.sum(axis=0) / max(len(folded.counts), 1)
    smooth = gaussian_filter1d(mean.astype(np.float64), _SMOOTH_S / BIN_S, mode="nearest")
    return np.asarray(np.log(smooth + 0.02 * mean.mean() + 1e-12), np.float64)


def _shifted(log_rate: Floats, reach: int) -> Floats:
    """Return the row at shifts from ``-reach`` to ``reach`` bins; beyond its ends it goes on as it ends."""
    at = np.arange(len(log_rate)) - np.arange(-reach, reach + 1)[:, None]
    return np.asarray(log_rate[at.clip(0, len(log_rate) - 1)], np.float64)


def find_front(folded: Fold) -> Front | None:
    """Return where the rate begins to rise; None where there are too few answers.

    The rate is a constant before the front, and a power of the time since then after it, up to half of the highest
    rate. The exponent is averaged over by likelihood.
    """
    counts = folded.counts.sum(axis=0).astype(np.float64)
    half = _half_risen(counts)
    if half is None:
        return None
    first = max(0, half - round(_BEFORE_FRONT_S / BIN_S))
    quiet = counts[: max(first, half - round(0.5 * _BEFORE_FRONT_S / BIN_S), 1)]
    background = (float(quiet.sum()) + 0.5) / len(quiet)
    n, t = counts[first : half + 1], folded.t_s[first : half + 1]
    if n.sum() - background * len(n) < 0.25 * _FRONT_EVENTS:
        return None
    onsets = np.arange(t[0], t[-1] + 0.5 * BIN_S, _FRONT_GRID_S)
    likeness = np.stack([_rise_likeness(n, t, onsets, shape, background) for shape in _SHAPES])
    weight = np.exp(likeness - likeness.max())
    weight /= weight.sum()
    mean = float((weight * onsets).sum())
    variance = float((weight * np.square(onsets - mean)).sum())
    return Front(mean, float(np.sqrt(variance + _FRONT_GRID_S**2 + (_SLOW_RISE * (t[-1] - mean)) ** 2)))


def _half_risen(counts: Floats) -> int | None:
    """Return the bin in which the smoothed rate first comes to half of its highest value."""
    from scipy.ndimage import gaussian_filter1d

    if counts.sum() < _FRONT_EVENTS:
        return None
    # As many events as make the highest rate stand out are smoothed over, from 0.1 to 0.8 ms.
    for width in (2, 4, 8, 16):
        smooth = gaussian_filter1d(counts, width, mode="nearest")
        background = float(np.median(smooth))
        if (smooth.max() - background) * 2.5 * width >= 3.0 * _FRONT_EVENTS:
            break
    peak = float(smooth.max())
    if (peak - background) * 2.5 * width < 0.5 * _FRONT_EVENTS:
        return None
    risen = int((smooth >= background + _FRONT_RISE * (peak - background)).argmax())
    # Smoothing brings the rise forward: of a sharp one nothing would be left.
    return min(risen + width, int(smooth.argmax()))


def _rise_likeness(n: Floats, t: Floats, onsets: Floats, shape: float, background: float) -> Floats:
    """Return the log-likelihood of the counts for each onset, the rate of the rise being what fits best."""
    edges = np.concatenate([t - 0.5 * BIN_S, [t[-1] + 0.5 * BIN_S]])
    risen = np.maximum(edges - onsets[:, None], 0.0) ** (shape + 1.0)
    rise = np.diff(risen, axis=1)
    rise /= np.maximum(rise.sum(axis=1, keepdims=True), 1e-300)
    answers = max(float(n.sum()) - background * len(n), 1.0)
    rate = background + answers * rise
    return np.asarray((n * np.log(rate) - rate).sum(axis=1), np.float64)
