"""One notice: what happened, and where, in the forms in which it leaves the bench."""

from __future__ import annotations

import platform
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from typing import Any, Final, Literal

__all__ = ["FORMAT", "KINDS", "Kind", "Notice", "one_line"]

FORMAT: Final = "evs-bench-notice/1"

Kind = Literal["end", "failure", "no_progress", "suspended", "paused"]

#: What a notice can be about.
KINDS: Final[tuple[Kind, ...]] = ("end", "failure", "no_progress", "suspended", "paused")

_HEADLINES: Final[dict[Kind, str]] = {
    "end": "ended",
    "failure": "failed",
    "no_progress": "makes no progress",
    "suspended": "is suspended",
    "paused": "is paused",
}
_MOST_CHARACTERS: Final = 1000


def one_line(text: str) -> str:
    """Return `text` on one line of bounded length, with nothing in it that an environment or a mail cannot carry."""
    line = " ".join(text.replace("\0", " ").split()).encode("utf-8", "replace").decode()
    return line if len(line) <= _MOST_CHARACTERS else line[: _MOST_CHARACTERS - 3] + "..."


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z")


@dataclass(frozen=True, slots=True)
class Notice:
    """Something that happened to a run, or to a queue of runs."""

    kind: Kind
    title: str  #: of the protocol, or of the queue
    text: str = ""  #: what happened, for people: one line
    station: str | None = None
    run: str | None = None  #: folder of the run or of the queue; None if it is not known
    points_done: int | None = None
    points: int | None = None
    label: str | None = None  #: the point that was being taken, for people
    test: bool = False  #: whether nothing happened, and only the way is tried
    t: str = field(default_factory=_now)  #: UTC, ISO 8601
    host: str = field(default_factory=platform.node)  #: the computer that measures

    @property
    def subject(self) -> str:
        """The notice as a headline."""
        head = "[test] " if self.test else ""
        return one_line(f"{head}EVS bench: {self.title} {_HEADLINES[self.kind]}")

    @property
    def message(self) -> str:
        """The notice as one line, headline and text."""
        return one_line(f"{self.subject}: {self.text}" if self.text else self.subject)

    def to_dict(self) -> dict[str, Any]:
        """Return the notice as plain data; `text` is the whole message, as chat programs expect it."""
        return {"format": FORMAT, **asdict(self), "text": self.message}

    def environment(self) -> dict[str, str]:
        """Return the notice as environment variables; what is not known is left out."""
        facts = {key: value for key, value in self.to_dict().items() if value is not None and key != "format"}
        return {f"EVS_BENCH_{key.upper()}": one_line(_plain(value)) for key, value in facts.items()}

    def lines(self) -> list[str]:
        """Return the notice as a short letter."""
        facts = {
            "what": self.kind.replace("_", " "),
            "when": self.t,
            "computer": self.host,
            "station": self.station,
            "folder": self.run,
            "points": None if self.points_done is None else f"{self.points_done} of {self.points}",
            "at point": self.label or None,
        }
        return [
            self.message,
            "",
            *(f"{key + ':':10s}{one_line(str(v))}" for key, v in facts.items() if v is not None),
        ]


def _plain(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
