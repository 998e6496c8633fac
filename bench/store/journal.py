"""``journal.jsonl``: one JSON object for each change of state, each line on disk before the next step is taken."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

from bench.store.errors import RunError

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

__all__ = [
    "PLAN_CHANGED",
    "POINT_STATES",
    "RUN_STATES",
    "JournalEntry",
    "attempts",
    "entry_of",
    "last_done",
    "read_journal",
    "skipped",
    "whole_length",
]

POINT_STATES: Final = ("planned", "started", "done", "failed", "skipped", "rejected")
RUN_STATES: Final = ("run_started", "paused", "resumed", "suspended", "run_finished", "run_aborted")
#: A line about the run as a whole that adds points to its plan; what the run is doing it does not say.
PLAN_CHANGED: Final = "plan_changed"


@dataclass(frozen=True, slots=True)
class JournalEntry:
    """One line of the journal."""

    state: str
    point: int | None = None  #: position in the plan; None for the run as a whole
    t: str = ""  #: UTC, ISO 8601
    attempt: int = 1
    file: str | None = None  #: relative to the run folder
    sha256: str | None = None
    reason: str | None = None
    everything: dict[str, Any] = field(default_factory=dict)  #: the whole line, unknown keys too


def read_journal(path: Path) -> list[JournalEntry]:
    """Return the entries of the journal at `path`, oldest first; a torn last line is ignored.

    Raises
    ------
    RunError
        If the file cannot be read, or a line before the last one is damaged.
    """
    try:
        lines = path.read_bytes().split(b"\n")
    except OSError as error:
        raise RunError(f"{path}: {error.strerror or error}") from error
    entries = []
    last = max((n for n, line in enumerate(lines) if line.strip()), default=-1)
    for number, line in enumerate(lines):
        if not line.strip():
            continue
        entry = entry_of(line)
        if entry is not None:
            entries.append(entry)
        elif number != last:
            raise RunError(f"{path}:{number + 1}:1: damaged line, expected a JSON object with a state")
    return entries


def whole_length(content: bytes) -> int:
    """Return the length of a journal, in bytes, to the end of its last line that is whole: from there it goes on."""
    length = content.rfind(b"\n") + 1
    last = content[:length].rstrip(b"\n").rfind(b"\n") + 1
    return length if entry_of(content[last:length]) is not None else last


def entry_of(line: bytes) -> JournalEntry | None:
    """Return the entry that `line` holds, None if it is damaged."""
    try:
        content = json.loads(line)
    except (ValueError, RecursionError):
        return None
    if not isinstance(content, dict) or not isinstance(content.get("state"), str):
        return None
    point, attempt = content.get("point"), content.get("attempt", 1)
    if not isinstance(point, int | None) or not isinstance(attempt, int):
        return None
    return JournalEntry(
        state=content["state"],
        point=point,
        t=str(content.get("t", "")),
        attempt=attempt,
        file=_text_or_none(content, "file"),
        sha256=_text_or_none(content, "sha256"),
        reason=_text_or_none(content, "reason"),
        everything=content,
    )


def _text_or_none(content: dict[str, Any], key: str) -> str | None:
    value = content.get(key)
    return None if value is None else str(value)


def last_done(entries: Iterable[JournalEntry]) -> dict[int, JournalEntry]:
    """Return, for each point that was finished, its last ``done`` line, in the order of the plan."""
    done = {e.point: e for e in entries if e.state == "done" and e.point is not None}
    return dict(sorted(done.items()))


def skipped(entries: Iterable[JournalEntry]) -> dict[int, JournalEntry]:
    """Return the ``skipped`` line of each point that was left out and has not been taken since."""
    last = {e.point: e for e in entries if e.state in ("done", "skipped") and e.point is not None}
    return {point: entry for point, entry in sorted(last.items()) if entry.state == "skipped"}


def attempts(entries: Iterable[JournalEntry]) -> dict[int, int]:
    """Return how often each point was begun."""
    return dict(Counter(e.point for e in entries if e.state == "started" and e.point is not None))
