"""What a run will ask of the bench, the disk and the operator: when it ends, what is to be done by hand, and when."""

from __future__ import annotations

import math
import shutil
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import TYPE_CHECKING, Final

from bench.catalogue.pace import changes_of, learned_pace, waits_s
from drivers.clock import RealClock
from drivers.filters.manual import ManualFilter
from protocols.errors import InputError
from protocols.estimation import recording_s

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from bench.catalogue.pace import Pace
    from bench.run.plan import PlannedPoint
    from bench.station import Station
    from protocols.points import Point

__all__ = ["ByHand", "ContrastError", "Foresight", "foresee", "worst_contrast"]

#: Steps this close to what was asked for, relatively, are what was asked for.
_ROUNDING: Final = 1e-9


@dataclass(frozen=True, slots=True)
class ByHand:
    """Something that a person has to do during a run."""

    at_s: float  #: since the start; what a person took before it is not in it
    what: str


@dataclass(frozen=True, slots=True)
class ContrastError:
    """A contrast that the light source cannot set exactly, because its levels have steps."""

    point: int
    measurement: str
    asked_ln: float
    set_ln: float  #: NaN where one of the levels would be darkness

    @classmethod
    def of(cls, planned: PlannedPoint) -> ContrastError | None:
        """Return the error of one point; None for one that has no contrast, or exactly what was asked for."""
        asked, as_set = planned.point.log_contrast, planned.log_contrast
        if not asked or math.isclose(asked, as_set, rel_tol=_ROUNDING):
            return None
        return cls(
            planned.point.index, planned.point.measurement, asked, as_set if math.isfinite(as_set) else math.nan
        )

    @property
    def relative(self) -> float:
        """The error in parts of what was asked for; infinite where one of the levels would be darkness."""
        return abs(self.set_ln / self.asked_ln - 1.0) if math.isfinite(self.set_ln) else math.inf

    def __str__(self) -> str:
        """Return the error for people."""
        if not math.isfinite(self.set_ln):
            return f"a log contrast of {self.asked_ln:.4g} needs a level below the lowest, which becomes darkness"
        percent = 100.0 * (self.set_ln / self.asked_ln - 1.0)
        return f"a log contrast of {self.asked_ln:.4g} becomes {self.set_ln:.4g} ({percent:+.2g} %)"


@dataclass(frozen=True, slots=True)
class Foresight:
    """What is to be expected of a run that starts now."""

    duration_s: float  #: on the clock of the station: recordings, waits, and what earlier runs took beside them
    real_clock: bool  #: whether the clock of the station is that of the wall
    real_duration_s: float | None  #: on the clock of the wall; None where nothing tells
    real_end: datetime | None  #: by the clock of the wall, local time; None where nothing tells
    pace: Pace | None  #: from earlier runs; None where there are none
    changes_by_hand: tuple[ByHand, ...]  #: of the filter
    operator_steps: tuple[ByHand, ...]
    contrast: ContrastError | None  #: the worst; None for a source that can be set to any level
    folder: str = ""  #: where the run would go; empty where nobody asked
    free_bytes: int | None = None  #: on the disk of that folder; None where it cannot be told


def foresee(
    points: Sequence[Point], planned: Sequence[PlannedPoint], station: Station, runs: Path | None
) -> Foresight:
    """Return what is to be expected of a run of `points` on `station`, which is not connected to.

    Parameters
    ----------
    points
        All points, in the order in which they are taken, and those that may be added to curves: the worst case.
    planned
        Those of the protocol that can be taken, in the terms of the station's devices.
    runs
        The folder in which the run would lie beside earlier ones; None to look at neither disk nor earlier runs.
    """
    pace = learned_pace(runs, station) if runs is not None else None
    real = isinstance(station.clock, RealClock)
    starts_s = list(_starts_s(points, pace if real else None))
    duration_s = starts_s.pop()
    real_s = duration_s if real else None if pace is None else pace.computing_s(points)
    return Foresight(
        duration_s=duration_s,
        real_clock=real,
        real_duration_s=real_s,
        real_end=None if real_s is None else datetime.now().astimezone() + timedelta(seconds=real_s),
        pace=pace,
        changes_by_hand=tuple(_changes_by_hand(points, starts_s, station)),
        operator_steps=tuple(
            ByHand(at_s, point.operator_before)
            for point, at_s in zip(points, starts_s, strict=True)
            if point.operator_before is not None
        ),
        contrast=worst_contrast(planned) if station.light.level_step else None,
        folder="" if runs is None else str(runs),
        free_bytes=None if runs is None else _free_bytes(runs),
    )


def _starts_s(points: Sequence[Point], pace: Pace | None) -> Iterator[float]:
    """Yield when each point begins on the clock of the station, s since the start; at last when the run is over.

    Without a pace nothing is beside recordings and waits. One that was learned where the clock is simulated tells how
    long this computer needs, and nothing of that clock.
    """
    at_s, before = 0.0, None
    for point in points:
        yield at_s
        changed = changes_of(point, before)
        at_s += waits_s(point, changed) + recording_s(point)
        at_s += pace.beside_s(changed) if pace is not None else 0.0
        before = point
    yield at_s


def _changes_by_hand(points: Sequence[Point], starts_s: Sequence[float], station: Station) -> Iterator[ByHand]:
    """Yield the filters that a person has to put in: the first of the holder, then whenever another is wanted."""
    if not isinstance(station.wheel, ManualFilter):
        return
    now = station.wheel.filters[0].name  # asked for when the devices are connected
    yield ByHand(0.0, now)
    for point, at_s in zip(points, starts_s, strict=True):
        try:
            wanted = station.calibration.filter_for(point.nd_od)
        except InputError:
            continue  # the point cannot be taken: that is an error of its own
        if wanted != now:
            yield ByHand(at_s, wanted)
            now = wanted


def worst_contrast(planned: Sequence[PlannedPoint]) -> ContrastError | None:
    """Return the contrast that is farthest, relatively, from what was asked for; None if all are as asked for."""
    errors = [error for one in planned if (error := ContrastError.of(one)) is not None]
    return max(errors, key=lambda error: error.relative, default=None)


def _free_bytes(folder: Path) -> int | None:
    """Return what is free on the disk of `folder`, or of where it would be made."""
    there = folder.absolute()
    while not there.exists() and there != there.parent:
        there = there.parent
    try:
        return shutil.disk_usage(there).free
    except OSError:
        return None
