"""Whether the data are fit to judge: if not, the run is to be taken again, and no physics is suggested.

What an effect of the catalogue can explain is no reason against the data: it is told, and they are judged.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from bench.diagnosis.expected.gate_readout import readout_limit_eps
from bench.store.reader import read_point

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from bench.diagnosis.expected.problem import Problem
    from bench.store.data import PointData

__all__ = ["cautions_of", "findings_of"]

#: Share of the points in which something may be wrong: the others tell the same, and a fit is hardly moved.
_POINTS: Final = 0.1
#: Share of a recording that may be missing.
_GAPS: Final = 0.02
#: Share of the words of a stream that may break the rules of its format. Each stands for one event or more that are
#: missing, or are where none was; beyond it the verdict on a point is red.
_UNDECODED: Final = 0.01
#: Share of the edges that may have no trigger. Such an edge is placed by the others, which does no harm; but triggers
#: come in the stream of the events, and where so many were lost, about as many events were. As many as of the pulses.
_UNTRIGGERED: Final = 0.1
#: Share of the test pulses that may be marked as not valid: which they are may have to do with the answers.
_INVALID: Final = 0.1
#: Events, all in all, below which there is nothing to look at.
_FEWEST: Final = 100
#: Counts of what was lost: as a run has them, and as the format's own words name the last of them.
_LOST: Final = ("dropped_buffers", "overflows", "device_overflow")
#: Counts of events that came, and that an import has left out.
_LEFT_OUT: Final = ("before_start", "after_end", "outside_roi", "backward")


def findings_of(problem: Problem) -> tuple[str, ...]:
    """Return why the data are not fit to be judged; nothing: they are.

    What a run does not say, as where it was imported, is no reason.
    """
    return tuple(_reasons(problem.points))


def cautions_of(problem: Problem) -> tuple[str, ...]:
    """Return what is to be known of data that are fit to be judged; events are read for it."""
    points = problem.points
    limits = [eps for eps in map(readout_limit_eps, points) if eps is not None]
    if not limits:
        return ()
    return (
        f"the readout was the limit in {len(limits)} of {len(points)} points, at {min(limits):.3g} events/s and "
        "more: pixels wait for each other, or events are lost",
    )


def _reasons(points: Sequence[PointData]) -> Iterator[str]:
    events = sum(p.n_events for p in points)
    if events < _FEWEST:
        yield f"{events} events in all points; expected {_FEWEST} or more"
    for is_bad, what in _OF_A_POINT:
        bad = sum(map(is_bad, points))
        if bad > _POINTS * len(points):
            yield f"{what} in {bad} of {len(points)} points"
    pulses = sum(p.pulse_start_s.size for p in points)
    invalid = sum(int((~p.pulse_valid).sum()) for p in points)
    if pulses and invalid > _INVALID * pulses:
        yield f"{invalid} of {pulses} test pulses are marked as not valid, as by lost triggers"
    if not pulses and not any(p.waveform == "constant" for p in points):
        yield "there are neither test pulses nor constant light"


def _has_gaps(point: PointData) -> bool:
    return float((point.gaps_s[:, 1] - point.gaps_s[:, 0]).sum()) > _GAPS * point.duration_s


def _lost_somewhere(point: PointData) -> bool:
    """Return whether events were lost, and nobody knows when: known gaps are left out of all that is said."""
    known = point.gaps_s.size or _count(point, "gaps")  # of a recording of which the beginning is looked at
    return not known and any(_count(point, key) for key in _LOST)


def _is_undecoded(point: PointData) -> bool:
    errors = _count(point, "decode_errors")
    whole = 1.0 if point.stored_roi is None else point.stored_roi.pixels / point.roi.pixels
    came = point.n_events * whole + sum(_count(point, key) for key in _LEFT_OUT)
    return errors > _UNDECODED * (came + errors)


def _lacks_triggers(point: PointData) -> bool:
    """Return whether edges have no trigger; where something else has placed them, triggers do not matter."""
    lost = _count(point, "edges_without_trigger")
    if not lost or point.attributes.get("time_axis", "trigger") != "trigger":
        return False
    return lost > _UNTRIGGERED * _edges(point)


def _edges(point: PointData) -> int:
    """Return the edges of the light; all that were recorded, where the beginning is looked at."""
    whole = read_point(point.path, point.roi) if math.isfinite(point.until_s) else point
    return whole.stimulus_t_s.size - 1  # the level at the beginning is none


def _is_doubtful(point: PointData) -> bool:
    return bool(point.quality.get("time_doubtful"))


def _count(point: PointData, key: str) -> float:
    """Return a count of the quality; 0 where the run does not say it, or says something else than a number."""
    value = point.quality.get(key, 0)
    return float(value) if isinstance(value, int | float) and math.isfinite(value) else 0.0


_OF_A_POINT: Final[tuple[tuple[Callable[[PointData], bool], str], ...]] = (
    (_has_gaps, f"data are missing for more than {_GAPS:.0%} of the time"),
    (_lost_somewhere, "events were lost on the way, nobody knows when,"),
    (_is_undecoded, f"more than {_UNDECODED:.0%} of the stream broke the rules of its format"),
    (_lacks_triggers, f"more than {_UNTRIGGERED:.0%} of the edges of the light have no trigger"),
    (_is_doubtful, "when the light changed is doubtful"),
)
