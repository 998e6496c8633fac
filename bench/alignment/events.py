"""Putting the edges of a stimulus onto the camera's time axis by the events that answer them, without triggers.

Coarsely the answers tell where the stimulus lies, and whether it could lie elsewhere; finely they tell offset and
rate of the clocks. What they cannot tell is how long after the light they come: the edges are placed before the first
answers by what is known of light and pixels, and how wrong that may be is said as a bound. A latency must never be
read from such an axis: it would be measured from itself.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.alignment.front import block_shifts, find_front, fold, sharpest_drift
from bench.alignment.latency import Answered, Answering, light_began
from bench.alignment.places import Edges, light_edges
from bench.alignment.search import search
from bench.store.layout import FROM_EVENTS

if TYPE_CHECKING:
    import numpy.typing as npt

    from bench.alignment.counts import EventCounts
    from bench.alignment.front import Fold
    from bench.alignment.latency import Began
    from bench.alignment.telling import Searched

    Floats = npt.NDArray[np.float64]

__all__ = ["EdgeAlignment", "align_to_events"]

#: Drifts from the middle of the recording to its end that are tried, s, and how many to either side.
_DRIFTS: Final = ((4e-3, 30), (4e-4, 12), (1e-4, 8))
_ROUNDS: Final = 3
_FIRST_REACH_S: Final = 8e-3
_REACH_S: Final = 2e-3
_FEWEST_EDGES: Final = 4
_SEEN: Final = 0.5  #: of the edges in the recording must be answered
_REPEATED: Final = 0.5  #: of the edges must be of kinds that come again; else one direction is one kind
_SCATTER_S: Final = 1e-3  #: blocks that scatter more are no alignment
_OUTLIER: Final = 4.0  #: standard deviations


@dataclass(frozen=True, slots=True)
class EdgeAlignment:
    """Edges on the camera's time axis, where the events say they are."""

    t_s: Floats  #: (m,) s; the first entry is 0
    offset_s: float  #: camera time of the stimulus' own time 0
    offset_sd_s: float  #: standard deviation of the edges' common place, by the scatter of the events
    bound_s: float  #: how far the edges may be off beside that: the latency of the first answers is not known better
    rate_ppm: float  #: by how much the camera's clock runs faster than that of the stimulus
    rate_sd_ppm: float
    residual_s: float  #: rms of blocks of edges around offset and rate
    seen: int  #: edges that were answered
    unseen: int  #: edges that were not: too small, lost, or outside the recording
    doubts: tuple[str, ...]  #: why it may be wrong altogether; empty if it is sure
    followed: bool  #: events follow the edges clearly; if not, this is chance
    second_s: float  #: the other offset that is hardest to tell from this one; NaN without one
    told_edges: float  #: edges that speak for this offset and against that one; infinite without one

    @property
    def doubtful(self) -> bool:
        """Whether it may be wrong altogether, by a period for instance."""
        return bool(self.doubts)

    def attributes(self) -> dict[str, float | str]:
        """Return what a point file says of it; numbers that are not known are left out."""
        known = {
            "time_offset_s": self.offset_s,
            "time_offset_sd_s": self.offset_sd_s,
            "time_bound_s": self.bound_s,
            "time_rate_ppm": self.rate_ppm,
            "time_residual_s": self.residual_s,
        }
        return {"time_axis": FROM_EVENTS, **{name: value for name, value in known.items() if np.isfinite(value)}}

    def quality(self) -> dict[str, int | str]:
        """Return what the quality of a point says of it."""
        counts = {"edges_seen": self.seen, "edges_unseen": self.unseen, "time_doubtful": int(self.doubtful)}
        return {**counts, "time_note": "; ".join(self.doubts)}


def align_to_events(
    edges_s: Floats,
    lux: Floats,
    counts: EventCounts,
    *,
    duration_s: float,
    offset_limits_s: tuple[float, float] | None = None,
    rate_limit_ppm: float = 200.0,
    answering: Answering | None = None,
) -> EdgeAlignment | None:
    """Return the edges where the events saw them; None if the light never changes or nothing answers.

    Parameters
    ----------
    edges_s, lux
        (m,) commanded times, s, and levels on chip; the first is the level at the beginning and no edge.
    counts
        The events of the window.
    duration_s
        Length of the recording, s.
    offset_limits_s
        Least and greatest offset, from the clocks of the host for instance; None: anywhere in the recording.
    rate_limit_ppm
        Greatest difference of the clocks' rates.
    answering
        What is known of light and pixels; the bound is narrower if more is known.
    """
    edges = light_edges(edges_s, lux)
    if not len(edges.t_s) or counts.duration_s <= 0.0:
        return None
    length_s = max(duration_s, counts.duration_s)
    found = search(edges, counts, length_s, offset_limits_s, 1e-6 * rate_limit_ppm)
    if found is None:
        return None
    binned = counts.binned(1, length_s)
    line = _followed(_Line.of(found), edges, found, binned)
    began = _light_began(line, edges, found, binned, answering or Answering())
    return _alignment(edges_s, edges, found, line, began, 1e-6 * rate_limit_ppm)


@dataclass(frozen=True, slots=True)
class _Line:
    """Where the edges are: at ``t + middle_s + rate (t - pivot_s)``, on the camera's axis."""

    pivot_s: float
    middle_s: float
    rate: float
    middle_sd_s: float = float("nan")
    rate_sd: float = float("nan")
    residual_s: float = float("nan")
    blocks: int = 0

    @classmethod
    def of(cls, found: Searched) -> _Line:
        return cls(0.0, found.place.offset_s, found.place.rate)

    def at(self, t_s: Floats) -> Floats:
        return np.asarray(t_s + self.middle_s + self.rate * (t_s - self.pivot_s), np.float64)

    def turned(self, pivot_s: float, rate: float) -> _Line:
        """Return the line that runs faster by `rate`, and is where it was at the stimulus' time `pivot_s`."""
        middle_s = self.middle_s + self.rate * (pivot_s - self.pivot_s)
        return replace(self, pivot_s=pivot_s, middle_s=middle_s, rate=self.rate + rate)

    @property
    def offset_s(self) -> float:
        return self.middle_s - self.rate * self.pivot_s


def _folds(
    line: _Line, edges: Edges, found: Searched, binned: npt.NDArray[np.uint32]
) -> list[tuple[bool, float, Fold]]:
    """Return direction, size and answers of each kind of edges that were seen."""
    before = np.diff(edges.t_s, prepend=-np.inf)
    after = np.diff(edges.t_s, append=np.inf)
    kind = _kinds(edges)
    folds = []
    for one in np.unique(kind):
        mine = np.flatnonzero((kind == one) & found.seen)
        if not len(mine):
            continue
        up = bool(edges.up[mine[0]])
        around = fold(
            binned[int(up)], line.at(edges.t_s[mine]), float(before[mine].min()), float(after[mine].min()), 2e-3
        )
        if around.counts.sum():
            folds.append((up, float(edges.contrast[mine].mean()), around))
    return folds


def _kinds(edges: Edges) -> npt.NDArray[np.int64]:
    """Return the kind of each edge; its direction alone where most levels come only once or twice."""
    number = np.bincount(edges.kind)[edges.kind]
    if np.mean(number >= 3) >= _REPEATED:
        return edges.kind
    return edges.up.astype(np.int64)


def _followed(line: _Line, edges: Edges, found: Searched, binned: npt.NDArray[np.uint32]) -> _Line:
    """Return offset and rate at which the answers to all edges of a kind lie over each other."""
    seen_s = edges.t_s[found.seen]
    begin_s, end_s = (float(seen_s[0]), float(seen_s[-1])) if len(seen_s) else (0.0, 0.0)
    for reach_s, steps in _DRIFTS if end_s > begin_s else ():
        folds = [folded for _, _, folded in _folds(line, edges, found, binned)]
        ends_s = line.at(np.array([begin_s, end_s]))
        drift_s = sharpest_drift(folds, float(ends_s[0]), float(ends_s[1]), reach_s, steps)
        line = line.turned(0.5 * (begin_s + end_s), 2.0 * drift_s / (end_s - begin_s))
    for turn in range(_ROUNDS):
        reach_s = _FIRST_REACH_S if turn == 0 else _REACH_S
        blocks = [block_shifts(folded, reach_s) for _, _, folded in _folds(line, edges, found, binned)]
        blocks = [b for b in blocks if len(b.at_s) >= 2]
        if not blocks:
            return line
        at_s, late_s, sd_s = (
            np.concatenate([getattr(b, name) for b in blocks]) for name in ("at_s", "late_s", "sd_s")
        )
        line = _corrected(line, at_s, late_s, sd_s)
    return line


def _corrected(line: _Line, at_s: Floats, late_s: Floats, sd_s: Floats) -> _Line:
    """Return the line after blocks at `at_s` turned out to be late; those that lie far off do not count."""
    pivot_s = float(at_s.mean())
    x = at_s - pivot_s
    spread = float(np.sqrt(np.mean(np.square(x))))
    weight = 1.0 / np.square(np.maximum(sd_s, 1e-6))
    kept = np.ones(len(x), np.bool_)
    middle = slope = 0.0
    for _ in range(10):
        w = weight * kept
        middle, slope = _weighted_line(x, late_s, w, spread)
        apart = (late_s - middle - slope * x) * np.sqrt(weight)
        scale = max(1.0, 1.4826 * float(np.median(np.abs(apart[kept]))))
        keep = np.abs(apart) <= _OUTLIER * scale
        if bool(np.all(keep == kept)) or keep.sum() < 3:
            break
        kept = keep
    left = (late_s - middle - slope * x)[kept]
    excess = max(1.0, float(np.sqrt(np.mean(np.square(left) * weight[kept]))))
    total = float(weight[kept].sum())
    spread2 = float((weight * kept * np.square(x)).sum())
    # In the stimulus' own time the pivot lies where the old line puts it.
    own_pivot = (pivot_s - line.middle_s + line.rate * line.pivot_s) / (1.0 + line.rate)
    new_middle = line.middle_s + line.rate * (own_pivot - line.pivot_s) + middle
    return _Line(
        own_pivot,
        new_middle,
        line.rate + slope * (1.0 + line.rate),
        excess / np.sqrt(total),
        excess / np.sqrt(spread2) if spread2 > 0.0 else float("nan"),
        float(np.sqrt(np.mean(np.square(left)))),
        int(kept.sum()),
    )


def _weighted_line(x: Floats, y: Floats, weight: Floats, spread: float) -> tuple[float, float]:
    total = float(weight.sum())
    if len(x) < 3 or spread <= 0.0:
        return float((weight * y).sum()) / total, 0.0
    x0, y0 = float((weight * x).sum()) / total, float((weight * y).sum()) / total
    slope = float((weight * (x - x0) * (y - y0)).sum()) / max(float((weight * np.square(x - x0)).sum()), 1e-300)
    return y0 - slope * x0, slope


def _light_began(
    line: _Line, edges: Edges, found: Searched, binned: npt.NDArray[np.uint32], answering: Answering
) -> Began | None:
    """Return when the light changed, since where the line has the edges, by the fronts of all kinds."""
    answered = []
    for up, contrast, folded in _folds(line, edges, found, binned):
        front = find_front(folded)
        if front is not None:
            answered.append(Answered(up, contrast, front.t_s, front.sd_s))
    return light_began(answered, answering) if answered else None


def _alignment(
    edges_s: Floats,
    edges: Edges,
    found: Searched,
    line: _Line,
    began: Began | None,
    rate_limit: float,
) -> EdgeAlignment:
    nan = float("nan")
    began_s, began_sd_s, bound_s = (0.0, nan, nan) if began is None else (began.t_s, began.sd_s, began.bound_s)
    t_s = line.at(edges_s) + began_s
    t_s[0] = 0.0
    seen, inside = int(found.seen.sum()), int(found.inside.sum())
    doubts = found.doubts()
    if seen < _FEWEST_EDGES or seen < _SEEN * max(inside, 1):
        doubts.append(f"{seen} of {inside} edges in the recording were answered")
    if not line.residual_s <= _SCATTER_S:
        doubts.append("the answers do not lie on a straight line")
    if abs(line.rate) > rate_limit:
        doubts.append("the clocks' rates differ by more than they may")
    if began is None:
        doubts.append("the answers have no clear beginning")
    return EdgeAlignment(
        t_s=t_s,
        offset_s=line.offset_s + began_s,
        offset_sd_s=float(np.hypot(began_sd_s, line.middle_sd_s)),
        bound_s=bound_s,
        rate_ppm=1e6 * line.rate,
        rate_sd_ppm=1e6 * line.rate_sd,
        residual_s=line.residual_s,
        seen=seen,
        unseen=len(edges.t_s) - seen,
        doubts=tuple(doubts),
        followed=found.followed and began is not None,
        second_s=float("nan") if found.second is None else found.second.offset_s,
        told_edges=found.told_edges,
    )
