"""Adding contrasts to curves while they are taken.

When all points of a curve are dealt with, those that are done and not bad decide which contrasts are taken next, a
few at a time. The journal has each decision as one line, before anything of it is taken: a run that is killed goes on
with what was decided, and decides what was not from the same points, so that it ends as one that was left alone.
"""

from __future__ import annotations

import logging
from dataclasses import replace
from typing import TYPE_CHECKING, Final

from bench.run.plan import plan
from bench.run.refining_curve import CurveInRun, GrowingPlan, replay
from bench.run.refining_rule import halved, known_of, standing_of, steps_of
from bench.run.refining_seen import Answers
from bench.run.taking import cost
from bench.store.journal import PLAN_CHANGED

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from bench.run.plan import PlannedPoint
    from bench.run.progress import Stopwatch
    from bench.run.refining_rule import Step
    from bench.station import Station
    from bench.store.journal import JournalEntry
    from bench.store.writer import RunWriter
    from protocols.points import Point, Roi
    from protocols.refining import RefinedCurve

__all__ = ["Refining"]

_log = logging.getLogger("evs_bench.run")
#: So many contrasts are decided upon at once: three cut the widest step into four.
_AT_ONCE: Final = 3


class Refining:
    """What is added to the curves of a run.

    Parameters
    ----------
    curves
        What the protocol says of them.
    planned
        All points of the protocol that are taken in any case.
    station
        On what they are taken; it need not be connected.
    """

    def __init__(self, curves: Sequence[RefinedCurve], planned: Sequence[PlannedPoint], station: Station) -> None:
        points = {item.point.index: item for item in planned} if curves else {}
        self._station = station
        self._planned = planned
        self._curves = [CurveInRun(curve, [points[point.index] for point in curve.planned]) for curve in curves]
        self._of_point: dict[int, CurveInRun] = {}
        self._answers: dict[int, Answers] = {}
        self._plan = GrowingPlan(())

    def replay(self, journal: Iterable[JournalEntry], where: str) -> None:
        """Take in what was decided before the run was interrupted; see :func:`bench.run.refining_curve.replay`."""
        replay(self._curves, journal, self._station, where)

    def in_order(self) -> list[PlannedPoint]:
        """Return all points so far; those that were added stand right after the planned ones of their curve."""
        after = {curve.asked.planned[-1].index: curve.added for curve in self._curves}
        return [one for item in self._planned for one in (item, *after.get(item.point.index, ()))]

    def open(self, writer: RunWriter, roi: Roi, tell: Callable[[str], None]) -> None:
        """Be ready to decide.

        Parameters
        ----------
        writer
            Of the run folder.
        roi
            The run's window of pixels.
        tell
            Called with what the operator should know.
        """
        self._writer, self._roi, self._tell = writer, roi, tell

    def catch_up(self, left: Iterable[PlannedPoint]) -> None:
        """Decide on the curves of which nothing is left: the run was interrupted before anybody did."""
        numbers = {item.point.index for item in left}
        for curve in self._curves:
            if not curve.ended and numbers.isdisjoint(item.point.index for item in curve.taken):
                self._decide(curve)

    def plan(self, left: Iterable[PlannedPoint]) -> GrowingPlan:
        """Return the plan of a run of the points that are left; it grows with each decision."""
        self._plan = GrowingPlan(left)
        numbers = {item.point.index for item in self._plan}
        for curve in self._curves:
            curve.left = numbers & {item.point.index for item in curve.taken}
            self._of_point |= dict.fromkeys(curve.left, curve)
        return self._plan

    def may_add(self) -> int:
        """Return how many points may still be added."""
        return sum(len(curve.spare) for curve in self._curves)

    def after(self, item: PlannedPoint, watch: Stopwatch) -> list[PlannedPoint]:
        """Take note that a point is dealt with, and return those that are to be taken now because of it."""
        curve = self._of_point.pop(item.point.index, None)
        if curve is None:
            return []
        curve.left.discard(item.point.index)
        if curve.left or curve.ended:
            return []
        more = self._decide(curve)
        curve.left = {one.point.index for one in more}
        self._of_point |= dict.fromkeys(curve.left, curve)
        self._plan.add(more)
        watch.grow([cost(one) for one in more], self.may_add())
        return more

    def _decide(self, curve: CurveInRun) -> list[PlannedPoint]:
        """Return what is added to a curve now; nothing where it is to be left as it is."""
        until = curve.asked.refine.until
        numbers = [item.point.index for item in curve.taken]
        answers = self._answers.setdefault(curve.asked.number, Answers(self._writer.folder, self._roi))
        known = [known_of(entries, until) for entries in answers.responses(numbers)]
        steps = steps_of([item.log_contrast for item in curve.taken], known, until)
        if not steps:
            return self._end(curve, "its answers do not rise with contrast")
        standing = standing_of(until, known, steps)
        if standing.enough:
            return self._end(curve, standing.text)
        if not curve.spare:
            return self._end(curve, f"{standing.text}, and no more may be added")
        more = self._placed(curve, steps, until.gap or 0.0)
        if not more:
            return self._end(curve, f"{standing.text}, and the light has no finer steps")
        return self._add(curve, more, standing.text)

    def _placed(self, curve: CurveInRun, steps: Sequence[Step], enough: float) -> list[tuple[PlannedPoint, Step]]:
        """Return the points that are taken next, as the station can take them, and what they lie between."""
        spare = list(curve.spare)[:_AT_ONCE]

        def as_set(log_contrast: float) -> float | None:
            planned, _ = plan([replace(spare[0], log_contrast=log_contrast)], self._station)
            return planned[0].log_contrast if planned else None

        chosen = halved(steps, len(spare), enough, as_set)
        points = [replace(point, log_contrast=step.middle) for point, step in zip(spare, chosen, strict=False)]
        planned, _ = plan(points, self._station)
        return list(zip(planned, chosen, strict=True))

    def _add(self, curve: CurveInRun, more: list[tuple[PlannedPoint, Step]], why: str) -> list[PlannedPoint]:
        if curve.asked.shuffled:
            more = sorted(more, key=lambda one: one[0].point.seed)
        added = [(item.point, f"refined: between {step.low:.4g} and {step.high:.4g}") for item, step in more]
        self._note(curve, f"refined, {why}", added)
        self._writer.note_plan([point.index for point, _ in added])
        curve.taken += [item for item, _ in more]
        return [item for item, _ in more]

    def _end(self, curve: CurveInRun, why: str) -> list[PlannedPoint]:
        number = len(curve.added)
        text = f"{number} contrast{'' if number == 1 else 's'} added, {why}"
        self._note(curve, text, ())
        self._tell(f"{curve.name}: {text}")
        curve.ended = True
        self._answers.pop(curve.asked.number, None)
        return []

    def _note(self, curve: CurveInRun, reason: str, added: Sequence[tuple[Point, str]]) -> None:
        line = curve.line(reason, added)
        _log.info("%s", line["reason"])
        self._writer.note(PLAN_CHANGED, **line)
