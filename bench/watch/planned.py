"""What the points of a run will be, from the protocol in its ``run.yaml``: names for points that are not taken yet.

Nothing that was measured is read with it; where the protocol is missing, or of another version, points have no names.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from bench.store.journal import PLAN_CHANGED

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from bench.store.data import RunHeader
    from bench.store.journal import JournalEntry
    from protocols.points import Point, Polarity, Waveform
    from protocols.schema import Protocol

__all__ = ["PlannedLook", "SpareLooks", "planned_looks"]


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
    protocol = _protocol(header)
    return {} if protocol is None else {point.index: _look(point) for point in protocol.expand()}


@dataclass(frozen=True, slots=True)
class SpareLooks:
    """The points that may be added to curves while a run is taken."""

    curves: Mapping[int, Mapping[int, PlannedLook]] = field(default_factory=dict)

    @classmethod
    def of(cls, header: RunHeader) -> SpareLooks:
        """Return what the protocol of a run allows."""
        protocol = _protocol(header)
        curves = () if protocol is None else protocol.refined_curves()
        return cls({curve.number: {point.index: _look(point) for point in curve.spare} for curve in curves})

    def added(self, journal: Sequence[JournalEntry]) -> dict[int, PlannedLook]:
        """Return the points that were added, as far as the lines of a journal tell them."""
        spare = {index: look for looks in self.curves.values() for index, look in looks.items()}
        return {
            index: replace(spare[index], log_contrast=log_contrast)
            for entry in journal
            for index, log_contrast in _added(entry)
            if index in spare
        }

    def may_add(self, journal: Sequence[JournalEntry]) -> int:
        """Return how many points may still be added."""
        added = self.added(journal)
        ended = [e.everything.get("curve") for e in journal if e.state == PLAN_CHANGED and not list(_added(e))]
        left = [looks for number, looks in self.curves.items() if number not in ended]
        return sum(index not in added for looks in left for index in looks)


def _added(entry: JournalEntry) -> Iterable[tuple[int, float]]:
    """Yield number and contrast of the points that a line adds to the plan."""
    points = entry.everything.get("points") if entry.state == PLAN_CHANGED else None
    for one in points if isinstance(points, list) else ():
        index, log_contrast = (one.get("index"), one.get("log_contrast")) if isinstance(one, dict) else (None, None)
        if isinstance(index, int) and isinstance(log_contrast, float) and math.isfinite(log_contrast):
            yield index, log_contrast


def _protocol(header: RunHeader) -> Protocol | None:
    from pydantic import ValidationError

    from protocols.errors import InputError
    from protocols.schema import Protocol

    written = header.everything.get("protocol")
    if not isinstance(written, dict) or not written:
        return None
    try:
        return Protocol.model_validate(written)
    except (ValidationError, InputError):
        return None


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
