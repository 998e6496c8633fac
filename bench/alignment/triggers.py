"""Putting the edges of a stimulus onto the camera's time axis by the trigger edges that the camera saw."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from protocols.stimulus import Stimulus

__all__ = ["Alignment", "align_to_marks", "align_to_triggers", "moved_windows"]

_US: Final = 1e-6
#: A trigger belongs to an edge if it is nearer than this part of the shortest time between edges...
_TOLERANCE: Final = 0.25
#: ...and never if it is farther than this, s.
_FARTHEST_S: Final = 0.01
#: Fewer edges with a trigger than this, or than half of them, are no alignment: a stray trigger fits any one edge.
_FEWEST: Final = 2
#: One of so many first edges must have its trigger, for the others to be found.
_EDGES_TRIED: Final = 8
#: Triggers that are not those of edges belong to their marks if their distances agree to this, s...
_MARKS_S: Final = 1e-3
#: ...and to this part of themselves, for clocks that drift apart.
_MOST_DRIFT: Final = 5e-4


@dataclass(frozen=True, slots=True)
class Alignment:
    """Edges on the camera's time axis."""

    t_s: npt.NDArray[np.float64]  #: (m,) s; the first entry is 0
    trigger: npt.NDArray[np.int64]  #: (m,) trigger of each edge; -1 for the first entry and where it was lost
    offset_s: float  #: camera time of the stimulus' own time 0
    rate_ppm: float  #: by how much the camera's clock runs faster than that of the stimulus
    residual_s: float  #: rms of the triggers around edges, offset and rate
    lost: int  #: edges without a trigger
    extra: int  #: triggers, of those that were tried, without an edge

    def attributes(self) -> dict[str, float]:
        """Return what a point file says of it."""
        return {
            "time_offset_s": self.offset_s,
            "time_rate_ppm": self.rate_ppm,
            **({"time_residual_s": self.residual_s} if np.isfinite(self.residual_s) else {}),
        }


def align_to_triggers(
    edges_s: npt.NDArray[np.float64],
    trigger_t_us: npt.NDArray[np.int64],
    trigger_p: npt.NDArray[np.uint8],
) -> Alignment | None:
    """Return the edges where the triggers saw them; None unless at least half of them, and two, have a trigger.

    A bench may send one trigger edge for each light edge, or a pulse whose rising or falling edge counts. All edges,
    the rising and the falling ones are tried; the choice that leaves the fewest edges and triggers alone is taken.

    Parameters
    ----------
    edges_s
        (m,) commanded times, s; the first is the level at the beginning and has no trigger.
    trigger_t_us, trigger_p
        (n,) times (us) and polarities of the trigger edges.
    """
    if len(edges_s) < 2 or not len(trigger_t_us):
        return None
    every = np.arange(len(trigger_t_us), dtype=np.int64)
    choices = (every, every[trigger_p == 1], every[trigger_p == 0])
    seconds = np.asarray(trigger_t_us / 1e6, np.float64)  # a quotient, so that 100000 us are 0.1 s
    fits = [_fit(edges_s, seconds, chosen) for chosen in choices if len(chosen)]
    needed = max(_FEWEST, (len(edges_s) - 1) / 2)
    sound = [fit for fit in fits if len(edges_s) - 1 - fit.lost >= needed]
    # The first of equals: a pulse begins with its edge.
    return min(sound, key=lambda fit: fit.lost + fit.extra, default=None)


def align_to_marks(
    edges_s: npt.NDArray[np.float64],
    marks_s: npt.NDArray[np.float64],
    trigger_t_us: npt.NDArray[np.int64],
) -> Alignment | None:
    """Return the edges by triggers that are not theirs, as at begin and end of a burst; None if they do not fit.

    Parameters
    ----------
    edges_s
        (m,) commanded times, s; the first is the level at the beginning.
    marks_s
        (k,) when the source put edges on its trigger output, s. The last ones may come after the recording.
    trigger_t_us
        (n,) times of the trigger edges, us.
    """
    seen = np.asarray(trigger_t_us / 1e6, np.float64)
    if len(edges_s) < 2 or not 1 <= len(seen) <= len(marks_s):
        return None
    marks = marks_s[: len(seen)]
    apart_s = np.diff(seen) - np.diff(marks)
    if np.any(np.abs(apart_s) > _MARKS_S + _MOST_DRIFT * np.diff(marks)):
        return None
    rate = float((seen[-1] - seen[0]) / (marks[-1] - marks[0]) - 1.0) if len(seen) > 1 else 0.0
    offset = float(np.mean(seen - (1.0 + rate) * marks))
    t_s = offset + (1.0 + rate) * edges_s
    t_s[0] = 0.0
    residual = seen - offset - (1.0 + rate) * marks
    return Alignment(
        t_s=t_s,
        trigger=np.full(len(edges_s), -1, np.int64),
        offset_s=offset,
        rate_ppm=1e6 * rate,
        residual_s=float(np.sqrt(np.mean(np.square(residual)))) if len(seen) > 2 else float("nan"),
        lost=0,
        extra=0,
    )


def _fit(
    edges_s: npt.NDArray[np.float64], trigger_s: npt.NDArray[np.float64], chosen: npt.NDArray[np.int64]
) -> Alignment:
    commanded, seen = edges_s[1:], trigger_s[chosen]
    tolerance = _tolerance(commanded)
    # As many triggers as edges, at the same intervals: one belongs to the other, however far the clocks drift apart.
    if len(seen) == len(commanded) and np.abs(np.diff(seen) - np.diff(commanded)).max(initial=0.0) <= tolerance:
        return _alignment(edges_s, trigger_s, chosen, np.arange(len(commanded)))
    offset = _best_offset(commanded, seen)
    return _alignment(edges_s, trigger_s, chosen, _nearest(commanded + offset, seen, tolerance))


def _tolerance(commanded: npt.NDArray[np.float64]) -> float:
    shortest = float(np.diff(commanded).min(initial=np.inf))
    return min(_FARTHEST_S, _TOLERANCE * shortest)


def _best_offset(commanded: npt.NDArray[np.float64], seen: npt.NDArray[np.float64]) -> float:
    """Return the offset that gives most edges a trigger: one edge, the first that was not lost, lies on a trigger."""
    tolerance = _tolerance(commanded)
    best, best_score = float(seen[0] - commanded[0]), (-1, -np.inf)
    for edge in commanded[:_EDGES_TRIED]:
        for trigger in seen[: len(seen) - len(commanded) + 4 if len(seen) > len(commanded) else 4]:
            offset = float(trigger - edge)
            matched = _nearest(commanded + offset, seen, tolerance)
            found = matched >= 0
            error = seen[matched[found]] - commanded[found] - offset
            score = (int(found.sum()), -float(np.square(error - error.mean()).sum()) if found.any() else -np.inf)
            if score > best_score:
                best, best_score = offset + float(np.median(error)), score
    return best


def _nearest(
    expected: npt.NDArray[np.float64], seen: npt.NDArray[np.float64], tolerance: float
) -> npt.NDArray[np.int64]:
    """Return, for each expected time, the index of the nearest time seen, -1 where none is within `tolerance`."""
    right = np.searchsorted(seen, expected).clip(0, len(seen) - 1)
    left = (right - 1).clip(0)
    nearest = np.where(np.abs(seen[left] - expected) < np.abs(seen[right] - expected), left, right)
    return np.where(np.abs(seen[nearest] - expected) <= tolerance, nearest, -1).astype(np.int64)


def _alignment(
    edges_s: npt.NDArray[np.float64],
    trigger_s: npt.NDArray[np.float64],
    chosen: npt.NDArray[np.int64],
    matched: npt.NDArray[np.int64],
) -> Alignment:
    found = matched >= 0
    trigger = np.full(len(edges_s), -1, np.int64)
    trigger[1:][found] = chosen[matched[found]]
    known, seen = edges_s[1:][found], trigger_s[trigger[1:][found]]
    rate, offset = _line(known, seen - known)
    t_s = edges_s + offset + rate * edges_s
    residual = seen - t_s[1:][found]
    t_s[1:][found] = seen
    t_s[0] = 0.0
    return Alignment(
        t_s=t_s,
        trigger=trigger,
        offset_s=offset,
        rate_ppm=1e6 * rate,
        residual_s=float(np.sqrt(np.mean(np.square(residual)))) if len(known) else float("nan"),
        lost=int((~found).sum()),
        extra=len(chosen) - len(known),
    )


def _line(x: npt.NDArray[np.float64], y: npt.NDArray[np.float64]) -> tuple[float, float]:
    """Return slope and value at 0 of the straight line through the points; without slope where they are too few."""
    if len(x) < 3:
        return 0.0, float(y.mean()) if len(y) else 0.0
    dx = x - x.mean()
    slope = float((dx * y).sum() / np.square(dx).sum())
    return slope, float(y.mean() - slope * x.mean())


def moved_windows(
    stimulus: Stimulus, t_s: npt.NDArray[np.float64]
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return the response windows (start, stop; s) of `stimulus` after its edges moved to `t_s`.

    Each window moves with the first edge that it contains, without one with the edge before it, and before the first
    edge with that; it keeps its length. The first entry of `t_s`, the level at the beginning, is no edge.
    """
    if len(t_s) < 2:
        return stimulus.pulse_start_s.copy(), stimulus.pulse_stop_s.copy()
    known, moved = stimulus.t_s[1:], t_s[1:]
    # A window may start on an edge; half a microsecond forgives the last digits of a sum.
    after = np.searchsorted(known, stimulus.pulse_start_s - 0.5 * _US, side="left").clip(max=len(known) - 1)
    contains = known[after] < stimulus.pulse_stop_s - 0.5 * _US
    before = np.searchsorted(known, stimulus.pulse_start_s + 0.5 * _US, side="right") - 1
    edge = np.where(contains, after, before.clip(min=0))
    shift = moved[edge] - known[edge]
    return stimulus.pulse_start_s + shift, stimulus.pulse_stop_s + shift
