"""Whether the data are fit to judge: if not, the run is to be taken again, and no physics is suggested."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from bench.diagnosis.expected.problem import Problem

__all__ = ["findings_of"]

#: Share of a recording that may be missing, and of the points in which it may be.
_GAPS: Final = 0.02
_POINTS: Final = 0.1
#: Events, all in all, below which there is nothing to look at.
_FEWEST: Final = 100


def findings_of(problem: Problem) -> tuple[str, ...]:
    """Return why the data are not fit to be judged; nothing: they are."""
    found = []
    points = problem.points
    events = sum(p.n_events for p in points)
    if events < _FEWEST:
        found.append(f"{events} events in all points; expected {_FEWEST} or more")
    gaps = [p for p in points if float(np.sum(np.diff(p.gaps_s, axis=1))) > _GAPS * p.duration_s]
    if len(gaps) > _POINTS * len(points):
        found.append(f"data are missing for more than {_GAPS:.0%} of the time in {len(gaps)} of {len(points)} points")
    lost = [p for p in points if any(p.quality.get(key, 0) for key in ("dropped_buffers", "device_overflow"))]
    if len(lost) > _POINTS * len(points):
        found.append(f"events were lost on the way in {len(lost)} of {len(points)} points")
    pulses = sum(p.pulse_start_s.size for p in points)
    invalid = sum(int((~p.pulse_valid).sum()) for p in points)
    if pulses and invalid > _POINTS * pulses:
        found.append(f"{invalid} of {pulses} test pulses are marked as not valid, as by lost triggers")
    doubtful = [p for p in points if p.quality.get("time_doubtful")]
    if len(doubtful) > _POINTS * len(points):
        found.append(f"when the light changed is doubtful in {len(doubtful)} of {len(points)} points")
    if not pulses and not any(p.waveform == "constant" for p in points):
        found.append("there are neither test pulses nor constant light")
    return tuple(found)
