"""Judging a point as soon as it is taken: what it is judged by passes on its way into the file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

from bench.run import verdict as verdicts

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy as np
    import numpy.typing as npt

    from bench.run.plan import PlannedPoint
    from bench.run.recorder import Recorder
    from bench.store.point_writer import PointWriter
    from bench.store.record import PointRecord
    from drivers.events.types import EventChunk

__all__ = ["Judge", "Judged"]


@dataclass(frozen=True, slots=True)
class Judged:
    """What was found of a point."""

    light: str  #: green, amber or red
    reasons: tuple[str, ...]

    @property
    def is_bad(self) -> bool:
        """Whether the point is to be taken again, where the policy allows it."""
        return self.light == "red"

    def keys(self) -> dict[str, Any]:
        """Return what the journal's line of the point says of it."""
        return {"verdict": self.light, "reasons": list(self.reasons)}


class _Tap:
    """A point file that shows what goes into it to those who judge."""

    def __init__(self, file: PointWriter, seen: Any) -> None:
        self._file = file
        self._seen = seen

    def append(self, chunk: EventChunk) -> None:
        self._file.append(chunk)
        self._seen.add(chunk)

    def times_and_polarities(self) -> Iterator[tuple[npt.NDArray[np.int64], npt.NDArray[np.uint8]]]:
        return self._file.times_and_polarities()


class Judge:
    """Judges the points of a run one after the other; where triggers came once they are missed from then on.

    Parameters
    ----------
    dark_light_lux
        Equivalent dark light that the sensor is believed to have, lux; None if that is not known.
    """

    def __init__(self, dark_light_lux: float | None = None) -> None:
        self._limits = verdicts.Limits(dark_light_lux=dark_light_lux)

    def record(self, recorder: Recorder, planned: PlannedPoint, file: PointWriter) -> tuple[PointRecord, Judged]:
        """Record a point into `file`, and return the rest of what is written, and what it is worth."""
        seen = verdicts.Seen(planned.point.roi)
        record = recorder.take(planned, cast("PointWriter", _Tap(file, seen)))
        found = verdicts.judge(record, planned, seen, self._limits)
        self._limits = self._limits.learned(seen, len(record.stimulus.t_s) - 1)
        return record, Judged(str(found.light), tuple(found.reasons))
