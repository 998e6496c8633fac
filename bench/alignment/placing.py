"""The stimulus of a recording on the camera's time axis: by triggers, else by the events, else as the source says."""

from __future__ import annotations

import logging
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final

from bench.alignment.events import align_to_events
from bench.alignment.triggers import align_to_marks, align_to_triggers

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy as np
    import numpy.typing as npt

    from bench.alignment.counts import EventCounts
    from bench.alignment.events import EdgeAlignment
    from bench.alignment.latency import Answering

__all__ = ["PlacedEdges", "Taken", "place_edges"]

_FAR_S: Final = 0.5  #: by which the host may be wrong about when a stimulus began on the camera's clock...
_NEAR_S: Final = 0.05  #: ...and by which it hardly is
_log = logging.getLogger("evs_bench.run")


@dataclass(frozen=True, slots=True)
class Taken:
    """What is known of a recording that was just taken."""

    name: str  #: of the point, for messages
    edges_s: npt.NDArray[np.float64]  #: (m,) s on the source's clock; the first is the level at the beginning
    lux: npt.NDArray[np.float64]  #: (m,)
    trigger_t_us: npt.NDArray[np.int64]  #: (n,)
    trigger_p: npt.NDArray[np.uint8]  #: (n,)
    marks_s: npt.NDArray[np.float64] | None  #: when the source put out triggers, where they are not those of edges
    duration_s: float
    latest_s: float  #: the host's clock says that the stimulus began between 0 and this
    answering: Answering  #: what is known of light and pixels
    counted: Callable[[], EventCounts]  #: counts the events; called where there are no triggers


@dataclass(frozen=True, slots=True)
class PlacedEdges:
    """Edges on the camera's time axis, and what the point file says of how they got there."""

    t_s: npt.NDArray[np.float64]  #: (m,) s; the first entry is 0
    trigger: npt.NDArray[np.int64] | None = None  #: (m,) trigger of each edge, -1 for none
    offset_s: float = 0.0  #: camera time of the source's own time 0
    attributes: dict[str, Any] = field(default_factory=dict)
    quality: dict[str, Any] = field(default_factory=dict)


def place_edges(taken: Taken) -> PlacedEdges:
    """Return where the edges lie: where triggers say, else where the events do, else where the source does.

    The last is right on a bench whose devices share a clock; on others it is a guess. What is not sure says so in
    the quality of the point, and in the log.
    """
    if taken.marks_s is None:
        found = align_to_triggers(taken.edges_s, taken.trigger_t_us, taken.trigger_p)
    else:
        found = align_to_marks(taken.edges_s, taken.marks_s, taken.trigger_t_us)
    if found is None:
        return _without_triggers(taken)
    quality = {"edges_without_trigger": found.lost, "triggers_without_edge": found.extra}
    attributes = {"time_axis": "trigger", **found.attributes()}
    trigger = found.trigger if taken.marks_s is None else None
    return PlacedEdges(found.t_s, trigger, found.offset_s, attributes, quality)


def _without_triggers(taken: Taken) -> PlacedEdges:
    edges, triggers = len(taken.edges_s) - 1, len(taken.trigger_t_us)
    quality = {"edges_without_trigger": edges, "triggers_without_edge": triggers} if triggers else {}
    if not edges:  # constant light has nothing to be placed
        return _as_the_source_says(taken, quality)
    why = f"triggers ({triggers}) do not fit the edges ({edges})" if triggers else "no triggers"
    found = _by_events(taken)
    if found is None or not found.followed or found.t_s[1] < 0.0:
        _log.warning("%s: %s, and no clear answers: the edges are taken to be where the source says", taken.name, why)
        doubt = "no triggers and no clear answers: the edges are where the source says"
        return _as_the_source_says(taken, {**quality, "time_doubtful": 1, "time_note": doubt})
    doubts = f"; doubtful: {'; '.join(found.doubts)}" if found.doubtful else ""
    _log.log(
        logging.WARNING if found.doubtful or triggers else logging.INFO,
        "%s: %s; edges placed by the events, to %.2g ms%s", taken.name, why, 1e3 * found.bound_s, doubts,
    )  # fmt: skip
    return PlacedEdges(found.t_s, None, found.offset_s, found.attributes(), {**quality, **found.quality()})


def _by_events(taken: Taken) -> EdgeAlignment | None:
    """Return where the events have the edges; of places that are equally good the one nearest to the source's."""
    counts = taken.counted()

    def within(away_s: float) -> EdgeAlignment | None:
        return align_to_events(
            taken.edges_s,
            taken.lux,
            counts,
            duration_s=taken.duration_s,
            offset_limits_s=(-away_s, taken.latest_s + away_s),
            answering=taken.answering,
        )

    found = within(_FAR_S)
    if found is None or not (found.followed and found.doubtful):
        return found
    near = within(_NEAR_S)
    return found if near is None or not near.followed else replace(near, doubts=found.doubts)


def _as_the_source_says(taken: Taken, quality: dict[str, Any]) -> PlacedEdges:
    t_s = taken.edges_s.copy()
    t_s[0] = 0.0  # the level at the beginning is no edge
    return PlacedEdges(t_s, None, 0.0, {"time_axis": "edges_known"}, quality)
