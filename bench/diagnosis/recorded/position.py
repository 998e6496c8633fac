"""Whether the place of a pixel matters: pixels of one row, of one column, from edge to edge.

No summary knows where a pixel is, and no effect of a pixel does: here the pixels of a run are compared with each
other, without a model. What a pixel has of its own (mismatch, hot pixels) makes no rows: it is the chance against
which rows are held.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from bench.diagnosis.recorded.recording import Frame, Recording

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.store.data import PointData

    Floats = npt.NDArray[np.float64]

__all__ = ["Pattern", "patterns", "pixel_map"]


@dataclass(frozen=True, slots=True)
class Pattern:
    """What pixels of a row, or a column, have in common."""

    along: Literal["rows", "columns", "from top to bottom", "from left to right"]
    z: float  #: beyond chance, as a normal deviate; below 0 for less than chance
    size: float  #: standard deviation of the row means (change from edge to edge), in shares of answers, or in Hz


def pixel_map(points: Sequence[PointData]) -> Floats:
    """Return (height, width): by how much more often a pixel answers than all do, mean over the points.

    Without any test pulse it is the pixel's background rate less that of all, Hz. Points with another window than
    most are left out; pixels that were off are NaN.
    """
    roi = Counter(p.roi for p in points).most_common(1)[0][0]
    mine = [p for p in points if p.roi == roi]
    pulsed = [p for p in mine if p.pulse_start_s.size]
    total, counted = np.zeros(roi.pixels), np.zeros(roi.pixels)
    for point in pulsed or mine:
        frame = Frame(point)
        on = frame.rank >= 0
        for share in _shares(Recording(frame, point.events())):
            total[on] += share - share.mean()
            counted[on] += 1.0
    with np.errstate(invalid="ignore"):
        return np.asarray(np.where(counted > 0.0, total / counted, np.nan).reshape(roi.height, roi.width))


def _shares(recording: Recording) -> list[Floats]:
    if recording.groups:
        return [answers.answered.mean(axis=1) for answers in recording.groups]
    seconds = max(recording.frame.observed_s, 1e-9)
    return [(recording.counts(0) + recording.counts(1)) / seconds] if recording.frame.pixels else []


def patterns(share: Floats) -> tuple[Pattern, ...]:
    """Return the patterns in a map of pixels; none where it is too small, or has pixels that were off.

    Ranks are compared, so that one hot pixel makes no row.
    """
    if min(share.shape) < 2 or not np.isfinite(share).all():  # a line has no rows and columns
        return ()
    from scipy.stats import rankdata

    ranks = rankdata(share).reshape(share.shape)
    return (
        Pattern("rows", _groups_differ(ranks), float(share.mean(axis=1).std())),
        Pattern("columns", _groups_differ(ranks.T), float(share.mean(axis=0).std())),
        Pattern("from top to bottom", *_slope(ranks, share)),
        Pattern("from left to right", *_slope(ranks.T, share.T)),
    )


def _groups_differ(ranks: Floats) -> float:
    """Return how much more the means of the rows differ than those of random pixels (analysis of variance)."""
    from scipy.stats import f as fisher
    from scipy.stats import norm

    rows, each = ranks.shape
    within = float(ranks.var(axis=1, ddof=1).mean())
    if within <= 0.0:
        return 0.0
    ratio = each * float(ranks.mean(axis=1).var(ddof=1)) / within
    return float(norm.isf(max(fisher.sf(ratio, rows - 1, rows * (each - 1)), 1e-300)))


def _slope(ranks: Floats, share: Floats) -> tuple[float, float]:
    """Return the deviate of a slope from row to row, and the change from the first row to the last."""
    y = np.arange(len(ranks), dtype=np.float64) - 0.5 * (len(ranks) - 1)
    span = float(np.sum(y**2))
    sd = float(ranks.std(ddof=1)) / np.sqrt(span * ranks.shape[1])
    z = float(y @ ranks.mean(axis=1)) / span / sd if sd > 0.0 else 0.0
    return z, float(y @ share.mean(axis=1)) / span * (len(ranks) - 1)
