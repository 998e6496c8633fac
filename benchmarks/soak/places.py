"""Moments at which a process that takes a run kills itself, by SIGKILL: nothing is closed, nothing is tidied up."""

from __future__ import annotations

import os
import signal
import threading
import time
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["IN_A_RESUME", "PLACES", "RANDOM", "arm"]

RANDOM: Final = "at a random moment"


def _die() -> None:
    os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(60.0)  # until it arrives


class _Countdown:
    """Reaches zero at the so-many-th call; may be called by several threads."""

    def __init__(self, number: int) -> None:
        self._left = number
        self._lock = threading.Lock()

    def is_over(self) -> bool:
        with self._lock:
            self._left -= 1
            return self._left == 0


def _before(owner: Any, name: str, countdown: _Countdown) -> None:
    """Die instead of the so-many-th call of a function."""
    function: Callable[..., Any] = getattr(owner, name)

    def dying(*arguments: Any, **named: Any) -> Any:
        if countdown.is_over():
            _die()
        return function(*arguments, **named)

    _put(owner, name, dying)


def _after(owner: Any, name: str, countdown: _Countdown) -> None:
    """Die after the so-many-th call of a function."""
    function: Callable[..., Any] = getattr(owner, name)

    def dying(*arguments: Any, **named: Any) -> Any:
        result = function(*arguments, **named)
        if countdown.is_over():
            _die()
        return result

    _put(owner, name, dying)


def _put(owner: Any, name: str, function: Callable[..., Any]) -> None:
    setattr(owner, name, function)


def _inside_the_temporary_file(countdown: _Countdown) -> None:
    """Die after a part of the events was written."""
    from bench.store.point_writer import PointWriter

    function = getattr(PointWriter, "_extend")  # noqa: B009 - it is private, and the place that is wanted

    def dying(self: Any, spec: Any, values: Any) -> None:
        if not countdown.is_over():
            function(self, spec, values)
            return
        function(self, spec, values[: len(values) // 2])
        self._file.flush()
        _die()

    _put(PointWriter, "_extend", dying)


def _before_the_rename(countdown: _Countdown) -> None:
    """Die when the file is whole and on disk, but has no name yet."""
    import bench.store.point_writer as module

    _after(module, "sync_file", countdown)


def _after_the_rename(countdown: _Countdown) -> None:
    """Die when the file has its name, and no line in the journal."""
    import bench.store.point_writer as module

    _before(module, "sync_folder", countdown)


def _in_a_journal_line(countdown: _Countdown) -> None:
    """Die when half of a line is in the journal."""
    from bench.store.journal_file import JournalFile

    function = JournalFile.append

    def dying(self: Any, text: str) -> None:
        if not countdown.is_over():
            function(self, text)
            return
        line = text.encode()
        self._file.write(line[: len(line) // 2])
        os.fsync(self._file.fileno())
        _die()

    _put(JournalFile, "append", dying)


def _during_resume(countdown: _Countdown) -> None:
    """Die when the run was looked through, and before the first point is taken."""
    import bench.run.resuming as module

    del countdown
    _before(module, "carry_out", _Countdown(1))


def _during_verification(countdown: _Countdown) -> None:
    """Die while the files of the points that are done are read."""
    import bench.store.run as module

    _before(module, "sha256_of", countdown)


def _at_a_random_moment(countdown: _Countdown) -> None:
    """Nothing is armed: who began the process kills it."""
    del countdown


#: The places; those in :data:`IN_A_RESUME` come only there.
PLACES: Final[dict[str, Callable[[_Countdown], None]]] = {
    RANDOM: _at_a_random_moment,
    "inside the temporary file": _inside_the_temporary_file,
    "before the rename": _before_the_rename,
    "after the rename": _after_the_rename,
    "in the middle of a journal line": _in_a_journal_line,
    "during resume": _during_resume,
    "during its verification": _during_verification,
}
IN_A_RESUME: Final = frozenset({"during resume", "during its verification"})


def arm(place: str, number: int) -> None:
    """Let this process kill itself at the so-many-th time that it comes to `place`."""
    PLACES[place](_Countdown(number))
