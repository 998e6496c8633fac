"""One curve of a run to which contrasts are added: what was, what may be, and its lines in the journal."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, overload

from bench.run.plan import plan_or_raise
from bench.store.errors import RunError
from bench.store.journal import PLAN_CHANGED

if TYPE_CHECKING:
    from collections.abc import Iterable

    from bench.run.plan import PlannedPoint
    from bench.station import Station
    from bench.store.journal import JournalEntry
    from protocols.points import Point
    from protocols.refining import RefinedCurve

__all__ = ["CurveInRun", "GrowingPlan", "replay"]


class GrowingPlan(Sequence["PlannedPoint"]):
    """The points of a run, to which some are added while it is taken.

    Parameters
    ----------
    planned
        Those that are known when it begins.
    """

    def __init__(self, planned: Iterable[PlannedPoint]) -> None:
        self._planned = list(planned)

    @overload
    def __getitem__(self, index: int) -> PlannedPoint: ...
    @overload
    def __getitem__(self, index: slice) -> list[PlannedPoint]: ...
    def __getitem__(self, index: int | slice) -> PlannedPoint | list[PlannedPoint]:
        """Return a point, or several."""
        return self._planned[index]

    def __len__(self) -> int:
        """Return how many there are so far."""
        return len(self._planned)

    def add(self, more: Iterable[PlannedPoint]) -> None:
        """Add points at the end."""
        self._planned += more


@dataclass(slots=True)
class CurveInRun:
    """A curve to which points may be added, on its way."""

    asked: RefinedCurve
    taken: list[PlannedPoint]  #: planned, then added so far
    ended: bool = False  #: whether nothing is added any more
    left: set[int] = field(default_factory=set)  #: numbers of the points that are not dealt with

    @property
    def added(self) -> list[PlannedPoint]:
        """The points that were added so far, in the order in which they are taken."""
        return self.taken[len(self.asked.planned) :]

    @property
    def spare(self) -> tuple[Point, ...]:
        """What may still be added."""
        return () if self.ended else self.asked.spare[len(self.added) :]

    @property
    def name(self) -> str:
        """The curve, for people."""
        point = self.asked.planned[0]
        return f"{point.measurement}, {point.baseline_lux:.4g} lux"

    def line(self, reason: str, added: Sequence[tuple[Point, str]]) -> dict[str, Any]:
        """Return the keys of the journal's line that adds points, or that ends the curve where there are none."""
        points = [{"index": point.index, "log_contrast": point.log_contrast, "reason": why} for point, why in added]
        return {"reason": f"{self.name}: {reason}", "curve": self.asked.number, "points": points}


def replay(curves: Iterable[CurveInRun], journal: Iterable[JournalEntry], station: Station, where: str) -> None:
    """Take into `curves` what the journal of their run says was added.

    Parameters
    ----------
    where
        The journal, for messages.

    Raises
    ------
    RunError
        If the protocol does not allow it.
    """
    by_number = {curve.asked.number: curve for curve in curves}
    for entry in journal:
        if entry.state == PLAN_CHANGED and "curve" in entry.everything:
            number, points = entry.everything["curve"], entry.everything.get("points")
            curve = by_number.get(number) if isinstance(number, int) else None
            if curve is None:
                raise RunError(f"{where}: the protocol in run.yaml has no curve {number!r} to add points to")
            if points == []:
                curve.ended = True
            else:
                curve.taken += plan_or_raise(_points(curve, points, where), station)


def _points(curve: CurveInRun, written: object, where: str) -> list[Point]:
    """Return the points that a line of the journal adds."""
    spare = {point.index: point for point in curve.spare}
    found = []
    for one in written if isinstance(written, list) else [written]:
        index, log_contrast = (one.get("index"), one.get("log_contrast")) if isinstance(one, dict) else (None, None)
        if not isinstance(index, int) or index not in spare:
            raise RunError(f"{where}: {curve.name} cannot have a point {index!r} by the protocol in run.yaml")
        if not isinstance(log_contrast, float) or not math.isfinite(log_contrast) or log_contrast <= 0.0:
            raise RunError(f"{where}: point {index}: {log_contrast!r} is no log contrast")
        found.append(replace(spare.pop(index), log_contrast=log_contrast))
    return found
