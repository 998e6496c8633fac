"""Which runs of a catalogue somebody wants to see."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, date, datetime, time, timedelta
from typing import TYPE_CHECKING

from protocols.errors import InputError

if TYPE_CHECKING:
    from bench.catalogue.entry import RunEntry

__all__ = ["Selection", "parse_day"]


@dataclass(frozen=True, slots=True)
class Selection:
    """What is wanted of a run; what is left empty does not matter. Texts are parts of names, in any case."""

    since: datetime | None = None
    until: datetime | None = None  #: not included itself
    sensor: str = ""  #: its name or its serial number
    protocol: str = ""  #: the name, the title, or the beginning of the hash
    station: str = ""
    state: str = ""
    verdict: str = ""  #: runs with at least one point of this verdict

    @property
    def is_everything(self) -> bool:
        """Whether nothing is asked for."""
        return self == Selection()

    def takes(self, entry: RunEntry) -> bool:
        """Return whether `entry` is wanted; a folder that is no run is wanted only with all others."""
        return self.is_everything or (
            entry.is_run
            and self._in_time(entry)
            and _has(self.sensor, entry.sensor, entry.serial)
            and (_has(self.protocol, entry.protocol, entry.title) or self._by_hash(entry))
            and _has(self.station, entry.station)
            and self.state in ("", entry.state)
            and (not self.verdict or entry.verdicts[self.verdict] > 0)
        )

    def _in_time(self, entry: RunEntry) -> bool:
        if self.since is None and self.until is None:
            return True
        created = entry.created_at
        if created is None:
            return False
        return (self.since is None or created >= self.since) and (self.until is None or created < self.until)

    def _by_hash(self, entry: RunEntry) -> bool:
        return len(self.protocol) >= 6 and entry.protocol_hash.startswith(self.protocol.lower())


def _has(part: str, *texts: str) -> bool:
    return any(part.casefold() in text.casefold() for text in texts)


def parse_day(text: str, *, end: bool = False) -> datetime:
    """Return the moment that `text` names, in local time where it has no zone.

    Parameters
    ----------
    text
        A day such as ``2026-11-20``, or a day and a time such as ``2026-11-20T21:00``.
    end
        Return the end of a day, not its beginning.

    Raises
    ------
    InputError
        It is neither.
    """
    try:
        return _moment(text, end)
    except (ValueError, OverflowError, OSError):  # also for a year that no clock of this computer knows
        raise InputError(_no_date(text)) from None


def _moment(text: str, end: bool) -> datetime:
    try:
        day = date.fromisoformat(text)
    except ValueError:
        moment = datetime.fromisoformat(text)
    else:
        moment = datetime.combine(day + timedelta(days=int(end)), time())
    return moment.astimezone(UTC)  # without a zone it is local time


def _no_date(text: str) -> str:
    return f"{text!r} is no date; expected a day such as 2026-11-20, or a time such as 2026-11-20T21:00"
