"""The verdict on a point while the run goes on: its data are good, to be used with care, or to be taken again.

It looks at how a point was taken, never at what it shows: a sensor may behave in any way it likes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from bench.run import verdict_drift, verdict_loss, verdict_rates, verdict_silence, verdict_time
from bench.run.verdict_case import Case, Found, Light
from bench.run.verdict_limits import Limits
from bench.run.verdict_seen import Seen

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from bench.run.plan import PlannedPoint
    from bench.store.record import PointRecord

__all__ = ["Light", "Limits", "Seen", "Verdict", "judge"]

#: What is judged, what matters most first.
_RULES: Final[tuple[Callable[[Case], Iterator[Found]], ...]] = (
    verdict_silence.silence,
    verdict_loss.gaps,
    verdict_loss.lost_on_the_way,
    verdict_loss.undecoded,
    verdict_time.triggers,
    verdict_time.doubtful_time,
    verdict_time.swapped_triggers,
    verdict_loss.invalid_pulses,
    verdict_drift.drift,
    verdict_drift.flash,
    verdict_drift.changed_level,
    verdict_drift.changed_temperature,
    verdict_rates.rate_plateau,
    verdict_rates.rate_at_limit,
    verdict_rates.dead_time,
    verdict_rates.stuck_pixels,
    verdict_rates.outside,
)


@dataclass(frozen=True, slots=True)
class Verdict:
    """What is to be thought of the data of a point."""

    light: Light  #: green: good; amber: to be used with care; red: should be taken again
    reasons: tuple[str, ...] = ()  #: for people, the worst first; none where it is green


def judge(record: PointRecord, planned: PlannedPoint, seen: Seen, limits: Limits = Limits()) -> Verdict:  # noqa: B008
    """Return the verdict on a point.

    Parameters
    ----------
    record
        What is written of it.
    planned
        What was to be done.
    seen
        Its events, all of which were passed to :meth:`Seen.add`.
    limits
        From where on something counts.
    """
    case = Case(record, planned, seen, limits)
    found = [one for rule in _RULES for one in rule(case)]
    found.sort(key=lambda one: one.light == "amber")  # those of the same light stay in order
    light: Light = found[0].light if found else "green"
    return Verdict(light, tuple(one.reason for one in found))
