"""What the points of a run will be, from the protocol in its ``run.yaml``: names for points that are not taken yet.

Nothing that was measured is read with it; where the protocol is missing, or of another version, points have no names.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bench.store.data import RunHeader
    from protocols.points import Point, Polarity, Waveform

__all__ = ["PlannedLook", "planned_looks"]


@dataclass(frozen=True, slots=True)
class PlannedLook:
    """A point of the plan as the page shows it."""

    measurement: str  #: name in the protocol
    waveform: Waveform
    polarity: Polarity
    baseline_lux: float
    log_contrast: float  #: 0 for constant light
    expected_s: float  #: recording and settling of the light


def planned_looks(header: RunHeader) -> dict[int, PlannedLook]:
    """Return the points that the protocol of a run asks for, by their position; none where it does not say."""
    from pydantic import ValidationError

    from protocols.errors import InputError
    from protocols.schema import Protocol

    written = header.everything.get("protocol")
    if not isinstance(written, dict) or not written:
        return {}
    try:
        points = Protocol.model_validate(written).expand()
    except (ValidationError, InputError):
        return {}
    return {point.index: _look(point) for point in points}


def _look(point: Point) -> PlannedLook:
    from protocols.estimation import recording_s

    return PlannedLook(
        measurement=point.measurement,
        waveform=point.waveform,
        polarity=point.polarity,
        baseline_lux=point.baseline_lux,
        log_contrast=point.log_contrast,
        expected_s=recording_s(point) + point.settle.light_s,
    )
