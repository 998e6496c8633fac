"""The counts of a point in as little memory as they need: a run has many points, and a sensor many pixels."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from bench.analysis.tally import GroupTally

__all__ = ["compact"]


def compact(tally: GroupTally, *, square: bool) -> GroupTally:
    """Return `tally` in the smallest unsigned types that hold its counts.

    Parameters
    ----------
    square
        Whether the point is a square wave: only there it matters what followed upon what, else that is dropped.
    """
    nothing: npt.NDArray[Any] = np.broadcast_to(np.uint8(0), tally.answers.shape)
    return replace(
        tally,
        answers=_smallest(tally.answers),
        given=_smallest(tally.given) if square else nothing,
        followed=_smallest(tally.followed) if square else nothing,
        # Most latencies are short: the empty bins after the last one are not kept.
        latencies=_smallest(np.trim_zeros(tally.latencies, "b")),
        rearmed=_smallest(tally.rearmed),
    )


def _smallest(counts: npt.NDArray[Any]) -> npt.NDArray[Any]:
    if not counts.any():
        return np.broadcast_to(np.uint8(0), counts.shape)
    return counts.astype(np.min_scalar_type(counts.max()))
