"""Places at which a stimulus may lie in a recording, and how many events answer its edges there."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.alignment.counts import BIN_S

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.alignment.counts import EventCounts

    Floats = npt.NDArray[np.float64]

__all__ = ["STEP_S", "AnswerCounts", "Edges", "Place", "light_edges", "scored"]

STEP_S: Final = 0.5e-3  #: of the counts in which places are compared
_STEP_BINS: Final = round(STEP_S / BIN_S)
_DARK: Final = 1e-3  #: a light that is off counts as this part of the brightest level
_AT_ONCE: Final = 1 << 20  #: edges at tried places that are counted in one go


@dataclass(frozen=True, slots=True)
class Edges:
    """The edges of a stimulus at which the light changes."""

    t_s: Floats  #: (n,) commanded times, s
    up: npt.NDArray[np.bool_]  #: (n,) the light gets brighter
    contrast: Floats  #: (n,) size of the step, ln; a step from or to darkness counts as a large one
    kind: npt.NDArray[np.int64]  #: (n,) edges of one kind go from the same level to the same level

    def part(self, chosen: npt.NDArray[np.bool_] | npt.NDArray[np.int64]) -> Edges:
        """Return some of the edges."""
        return Edges(self.t_s[chosen], self.up[chosen], self.contrast[chosen], self.kind[chosen])


@dataclass(frozen=True, slots=True)
class Place:
    """Where the stimulus lies: an edge at t is at ``offset_s + (1 + rate) t`` in the recording."""

    offset_s: float
    rate: float
    score: float

    def at(self, t_s: Floats) -> Floats:
        """Return the times in the recording."""
        return np.asarray(self.offset_s + (1.0 + self.rate) * t_s, np.float64)


def light_edges(t_s: Floats, lux: Floats) -> Edges:
    """Return the edges of a stimulus given by times and levels, the first of which is the level at the beginning."""
    floor = _DARK * float(lux.max(initial=0.0))
    level = np.log(np.maximum(lux, floor)) if floor > 0.0 else np.zeros(len(lux))
    step = np.diff(level)
    index = np.flatnonzero(np.abs(step) > 1e-6) + 1
    pairs = np.round(np.column_stack([level[index - 1], level[index]]), 4)
    _, kind = np.unique(pairs, axis=0, return_inverse=True)
    return Edges(t_s[index], step[index - 1] > 0.0, np.abs(step[index - 1]), kind.reshape(-1))


class AnswerCounts:
    """The events before each time, for sums over stretches of them."""

    def __init__(self, counts: EventCounts, duration_s: float) -> None:
        self.binned = counts.binned(_STEP_BINS, duration_s)
        self.before = np.concatenate([np.zeros((2, 1), np.int64), self.binned.cumsum(axis=1, dtype=np.int64)], axis=1)
        self.duration_s = duration_s

    def sum(self, up: npt.NDArray[np.bool_], t_s: Floats) -> Floats:
        """Return the events of the edges' own polarity before the times (..., n)."""
        at = np.rint(t_s * (1.0 / STEP_S)).astype(np.int64)
        np.clip(at, 0, self.before.shape[1] - 1, out=at)
        return self.before[up.astype(np.int64), at].astype(np.float64)

    def answers(self, edges: Edges, at_s: Floats, width_s: float) -> Floats:
        """Return the events after the edges at `at_s` (..., n) less those before them."""
        before, middle, after = (self.sum(edges.up, at_s + d) for d in (-width_s, 0.0, width_s))
        return after - 2.0 * middle + before


def scored(places: Sequence[Place], edges: Edges, known: AnswerCounts, width_s: float) -> list[Place]:
    """Return the places with their scores."""
    scored: list[Place] = []
    at_once = max(1, _AT_ONCE // len(edges.t_s))
    for first in range(0, len(places), at_once):
        some = places[first : first + at_once]
        at_s = np.stack([place.at(edges.t_s) for place in some])
        scores = known.answers(edges, at_s, width_s) @ edges.contrast
        scored += [replace(place, score=float(score)) for place, score in zip(some, scores, strict=True)]
    return scored
