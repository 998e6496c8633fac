"""Telling the operator how far a run is: a bar on a terminal, a line now and then elsewhere, or nothing."""

from __future__ import annotations

import contextlib
import time
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import TYPE_CHECKING, Any, Final, Protocol, TextIO, runtime_checkable

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

__all__ = [
    "BarProgress",
    "HoldListener",
    "LineProgress",
    "NoProgress",
    "Progress",
    "Status",
    "Stopwatch",
    "duration_text",
    "progress_for",
]

_LINE_EVERY_S: Final = 10.0


@dataclass(frozen=True, slots=True)
class Status:
    """How far a run is."""

    done: int  #: points that are dealt with: taken, or left out
    total: int
    label: str  #: the point that is being taken, for people
    left_s: float | None  #: seconds that are left; None if not known yet
    end: datetime | None  #: when it will be over, local time
    skipped: int = 0  #: of the points that are dealt with, those that were left out
    at_most: int | None = None  #: points if all are added that may be; None where none may be added any more


class Progress(Protocol):
    """Where a run tells how far it is."""

    def update(self, status: Status) -> None:
        """Take note of the status; called before each point and once after the last."""

    def message(self, text: str) -> None:
        """Take note of something that the operator should know."""

    def close(self) -> None:
        """Take note that the run is over, in whatever way."""


@runtime_checkable
class HoldListener(Protocol):
    """A progress that is also told when a run is held, and when it goes on."""

    def held(self, state: str, reason: str) -> None:
        """Take note that the run is ``paused`` or ``suspended``."""

    def going_on(self) -> None:
        """Take note that it goes on."""


class NoProgress:
    """Tells nobody."""

    def update(self, status: Status) -> None:
        """Do nothing."""

    def message(self, text: str) -> None:
        """Do nothing."""

    def close(self) -> None:
        """Do nothing."""


class LineProgress:
    """Writes a line every ten seconds, for logs and pipes.

    Parameters
    ----------
    stream
        Where the lines go; stderr as a rule.
    every_s
        Least time between two lines, s.
    """

    def __init__(
        self, stream: TextIO, every_s: float = _LINE_EVERY_S, now: Callable[[], float] = time.monotonic
    ) -> None:
        self._stream = stream
        self._every_s = every_s
        self._now = now
        self._last: float | None = None

    def update(self, status: Status) -> None:
        """Write a line if the last one is old enough, or the run is over."""
        now = self._now()
        if self._last is None or now - self._last >= self._every_s or status.done == status.total:
            self._last = now
            self.message(f"{_count(status)}{_left(status)}")

    def message(self, text: str) -> None:
        """Write a line."""
        self._stream.write(text + "\n")
        self._stream.flush()

    def close(self) -> None:
        """Do nothing."""


class BarProgress:
    """Draws a bar on a terminal.

    Parameters
    ----------
    stream
        The terminal; stderr as a rule.
    """

    def __init__(self, stream: TextIO) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn

        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.fields[left]}"),
            console=Console(file=stream),
        )
        self._task: Any = None

    def update(self, status: Status) -> None:
        """Move the bar."""
        if self._task is None:
            self._task = self._bar.add_task("", total=status.total, left="")
            self._bar.start()
        self._bar.update(
            self._task,
            total=status.total,
            completed=status.done,
            description=_count(status),
            left=_left(status).lstrip(", "),
        )

    def message(self, text: str) -> None:
        """Write a line above the bar."""
        self._bar.console.print(text, markup=False, highlight=False)

    def close(self) -> None:
        """Leave the bar as it is."""
        self._bar.stop()


def progress_for(stream: TextIO) -> Progress:
    """Return a bar if `stream` is a terminal, else lines."""
    return BarProgress(stream) if stream.isatty() else LineProgress(stream)


def _count(status: Status) -> str:
    left_out = f", {status.skipped} skipped" if status.skipped else ""
    if status.done >= status.total:
        return f"{status.done - status.skipped} of {status.total} points done{left_out}"
    at_most = "" if status.at_most is None else f" (at most {status.at_most})"
    return f"point {status.done + 1} of {status.total}{at_most}{left_out}: {status.label}"


def _left(status: Status) -> str:
    if status.left_s is None or status.end is None or status.done >= status.total:
        return ""
    return f", {duration_text(status.left_s)} left, until {status.end:%H:%M}"


def duration_text(seconds: float) -> str:
    """Return a length of time as people say it, in two units at most."""
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    if seconds < 90.0 * 60.0:
        return f"{seconds / 60.0:.0f} min"
    if seconds < 48.0 * 3600.0:
        return f"{int(seconds // 3600)} h {int(seconds % 3600 // 60)} min"
    return f"{seconds / 86400.0:.1f} days"


class Stopwatch:
    """Estimates what is left of a run from what its points cost so far.

    Trials that failed cost time and bring the run no further; time in which nothing was tried does not count.

    Parameters
    ----------
    costs
        What each point is expected to cost, in any unit that is in proportion to time.
    """

    def __init__(self, costs: list[float], now: Callable[[], float] = time.monotonic) -> None:
        self._costs = costs
        self._now = now
        self._start = now()
        self._more = 0.0  # cost of trials that brought the run no further
        self._may_add = 0

    def again(self, cost: float) -> None:
        """Take note of a trial that cost as much as a point, and has to be made again."""
        self._more += cost

    def grow(self, costs: Sequence[float], may_add: int) -> None:
        """Take note of points that came on top, and of how many more may come."""
        self._costs += costs
        self._may_add = may_add

    @contextlib.contextmanager
    def standing(self) -> Iterator[None]:
        """Leave the time of the block out of account: nothing is being tried."""
        begin = self._now()
        try:
            yield
        finally:
            self._start += self._now() - begin

    def status(self, done: int, label: str, skipped: int = 0) -> Status:
        """Return the status after `done` points, `skipped` among them; time is known after the first.

        The time that is left is that of the points that are planned so far.
        """
        spent, left = sum(self._costs[:done]) + self._more, sum(self._costs[done:])
        left_s = (self._now() - self._start) * left / spent if spent > 0.0 else None
        end = None if left_s is None else datetime.now().astimezone() + timedelta(seconds=left_s)
        total = len(self._costs)
        return Status(done, total, label, left_s, end, skipped, total + self._may_add if self._may_add else None)
