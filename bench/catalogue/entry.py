"""What the catalogue knows of one folder: a line of the table of runs."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from typing import Any, Final

__all__ = ["STATES", "VERDICTS", "RunEntry"]

#: How a run stands: over, under way in some process, or neither.
STATES: Final = ("finished", "aborted", "running", "paused", "suspended", "interrupted")
#: What the look at a point says of it, the best first.
VERDICTS: Final = ("green", "amber", "red")
_YEARS: Final = (1900, 9000)


@dataclass(frozen=True, slots=True)
class RunEntry:
    """One run folder, or a folder that is none and why. What is not known is empty, or None."""

    folder: str  #: name of the folder, within the one that holds the runs
    id: str = ""
    created: str = ""  #: as the run says it, ISO 8601
    title: str = ""
    protocol: str = ""  #: short name: that of the protocol's file
    protocol_hash: str = ""  #: SHA-256 of the resolved protocol without its words; equal for equal measurements
    station: str = ""
    drivers: str = ""  #: of the station by role; two stations of one name may differ in them
    sensor: str = ""
    serial: str = ""  #: of the camera, as it told it
    planned: int = 0
    done: int = 0
    failed: int = 0
    skipped: int = 0
    rejected: int = 0
    state: str = ""  #: one of :data:`STATES`; empty for what is no run
    green: int = 0
    amber: int = 0
    red: int = 0
    duration_s: float | None = None  #: from the start to the last line of the journal, without interruptions
    bytes: int = 0  #: of run.yaml, journal and points
    problem: str = ""  #: what is wrong with the folder, in one line

    @property
    def is_run(self) -> bool:
        """Whether anything of a run could be read."""
        return bool(self.id)

    @property
    def created_at(self) -> datetime | None:
        """When the run was begun; None where it does not say so. A time without a zone is UTC."""
        try:
            moment = datetime.fromisoformat(self.created)
        except ValueError:
            return None
        if not _YEARS[0] < moment.year < _YEARS[1]:  # no local time can be told at the ends of the calendar
            return None
        return moment if moment.tzinfo is not None else moment.replace(tzinfo=UTC)

    @property
    def verdicts(self) -> dict[str, int]:
        """Number of points by verdict."""
        return {"green": self.green, "amber": self.amber, "red": self.red}

    def to_dict(self) -> dict[str, Any]:
        """Return the entry as plain data, for programs."""
        return asdict(self)
