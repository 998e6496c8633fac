"""Faults by name, put in at a request that is counted."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

__all__ = ["Fault", "FaultPlan", "Faults"]


class Fault(StrEnum):
    """What can go wrong on a wire."""

    REPLY_LOST = "reply_lost"  #: the request was obeyed, its answer never comes
    REPLY_LATE = "reply_late"  #: the answer comes after the driver's time-out
    REPLY_CUT = "reply_cut"  #: the second half of the answer is missing
    GARBAGE = "garbage"  #: random bytes in place of the answer
    ALARM = "alarm"  #: a line that nobody asked for, in the middle of the answer
    REBOOT = "reboot"  #: the power fails for a moment; the request is lost
    UNPLUGGED = "unplugged"  #: the cable is out, and in again after a while
    OVERFLOW = "overflow"  #: the camera loses a stretch of its stream
    TRIGGERS_MISSED = "triggers_missed"  #: some trigger edges do not arrive
    TRIGGERS_SWAPPED = "triggers_swapped"  #: rising edges arrive as falling ones


@dataclass(frozen=True, slots=True)
class FaultPlan:
    """A fault at some requests of one device."""

    fault: Fault
    at: int  #: number of the request, from 0
    times: int = 1  #: at so many requests from there on
    seconds: float = 0.5  #: how long what lasts does: lateness, or the time without a cable


class Faults:
    """The faults of one device; each request asks whether one is due. Threads may share it."""

    def __init__(self, plans: Iterable[FaultPlan] = ()) -> None:
        self._plans = list(plans)
        self._lock = threading.Lock()
        self.requests = 0  #: so many were counted

    def plan(self, plan: FaultPlan) -> None:
        """Put in one more; its requests are counted from now."""
        with self._lock:
            self._plans.append(FaultPlan(plan.fault, self.requests + plan.at, plan.times, plan.seconds))

    def due(self) -> FaultPlan | None:
        """Count a request, and return the fault that befalls it."""
        with self._lock:
            number, self.requests = self.requests, self.requests + 1
            return next((p for p in self._plans if p.at <= number < p.at + p.times), None)
