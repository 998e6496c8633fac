"""What the rules of a verdict look at, and what they find."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from bench.run.plan import PlannedPoint
    from bench.run.verdict_limits import Limits
    from bench.run.verdict_seen import Seen
    from bench.store.record import PointRecord
    from protocols.points import Roi

__all__ = ["Case", "Found", "Light", "amber", "red", "share_text"]

Light = Literal["green", "amber", "red"]


@dataclass(frozen=True, slots=True)
class Case:
    """A point that was taken, and all that is known of it."""

    record: PointRecord
    planned: PlannedPoint
    seen: Seen
    limits: Limits

    @property
    def roi(self) -> Roi:
        """The window of pixels."""
        return self.planned.point.roi

    @property
    def edges(self) -> int:
        """Edges of the light; the level at the beginning is none."""
        return len(self.record.stimulus.t_s) - 1

    @property
    def pulses(self) -> int:
        """Response windows."""
        return len(self.record.pulses.start_s)


@dataclass(frozen=True, slots=True)
class Found:
    """One thing that is not as it should be."""

    light: Literal["amber", "red"]
    reason: str


def amber(reason: str) -> Found:
    """Return that the point is to be used with care."""
    return Found("amber", reason)


def red(reason: str) -> Found:
    """Return that the point should be taken again."""
    return Found("red", reason)


def share_text(share: float) -> str:
    """Return a share for people: ``1.3 %``."""
    return f"{100.0 * share:.0f} %" if share >= 0.1 else f"{100.0 * share:.2g} %"
