"""Pixels that fire on their own: how often, as it shows in all recordings under constant light together."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.recorded.recording import Frame, Recording

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.store.data import PointData

    Floats = npt.NDArray[np.float64]

__all__ = ["outlying_rate_hz"]

#: This share of the pixels, the quietest, tells what is usual.
_FELLOWS: Final = 0.9
#: Chance that any pixel of a sensor without outlying ones counts as one.
_CHANCE: Final = 0.01
#: It sends at least so many times as many: what differs from pixel to pixel otherwise hardly goes so far.
_TIMES: Final = 4.0


def outlying_rate_hz(points: Sequence[PointData]) -> float | None:
    """Return how many ON events a second outlying pixels send more than their fellows; None if there are none.

    A pixel is outlying when its number of events, in all recordings under constant light together, is too large for
    chance (Poisson) at the rate of its fellows. Where each sends few, none may be so for sure, and all of them
    together still are: more pairs of events are of one pixel than chance lets be. The points have to be of one
    window.
    """
    from scipy.stats import poisson

    frames = [Frame(point) for point in points if point.waveform == "constant"]
    if not frames or not frames[0].pixels or len({(f.point.roi, f.rank.tobytes()) for f in frames}) != 1:
        return None
    counts: Floats = np.sum([Recording(f, f.point.events()).counts(1) for f in frames], axis=0)
    usual = float(np.sort(counts)[: max(int(_FELLOWS * counts.size), 1)].mean())
    # Where hardly any pixel sends anything, one event makes no pixel outlying.
    usual = max(usual, 1.0)
    outlying = (poisson.sf(counts - 1.0, usual) < _CHANCE / counts.size) & (counts > _TIMES * usual)
    more = float(counts[outlying].mean() - usual) if outlying.any() else _more_of_few(counts)
    return more / float(sum(f.observed_s for f in frames)) if more > 0.0 else None


def _more_of_few(counts: Floats) -> float:
    """Return how many events more some pixels have on average that cannot be told one by one; 0 if there are none.

    A share f of pixels with a Poisson number of mean m has f m events and f m^2 / 2 pairs of them, by pixel.
    """
    from scipy.stats import poisson

    events, pairs = float(counts.sum()), 0.5 * float(np.sum(counts * (counts - 1.0)))
    by_chance = 0.5 * events**2 / counts.size
    if float(poisson.sf(pairs - 1.0, by_chance)) > _CHANCE:
        return 0.0
    return 2.0 * (pairs - by_chance) / events
