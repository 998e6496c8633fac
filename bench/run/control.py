"""What an operator wishes of a run from another terminal: a small file in the run folder, which the run takes away.

The file is there in full or not at all, and the last wish counts. That it is gone says that the run has heard it.
"""

from __future__ import annotations

import contextlib
import json
import threading
import time
from enum import StrEnum
from typing import TYPE_CHECKING, Final, Self

from bench.store.durable import replace_file
from bench.store.errors import RunError
from bench.store.layout import CONTROL_FILE, RUN_FILE
from bench.store.point_writer import cannot_write
from bench.store.writer import is_being_written, utc_now

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

__all__ = ["Control", "Wish", "ask", "was_heard"]

_LOOK_S: Final = 0.2  #: so often a run looks for a wish
_MOST_BYTES: Final = 10_000


class Wish(StrEnum):
    """What an operator may wish of a run."""

    PAUSE = "pause"  #: before the next point
    CONTINUE = "continue"
    ABORT = "abort"  #: now, also in the middle of a point


def ask(folder: Path, wish: Wish) -> None:
    """Leave a wish for the process that takes the run in `folder`; the last one counts.

    Raises
    ------
    RunError
        If there is no run, nobody is taking it, or the wish cannot be written.
    """
    if not (folder / RUN_FILE).exists():
        raise RunError(f"{folder}: there is no such run")
    if not is_being_written(folder):
        raise RunError(f"{folder}: nobody is taking this run now; go on with it: evs-bench resume {folder}")
    file = folder / CONTROL_FILE
    try:
        replace_file(file, json.dumps({"t": utc_now(), "wish": str(wish)}).encode() + b"\n")
    except OSError as error:
        raise cannot_write(file, error) from error


def was_heard(folder: Path, within_s: float) -> bool:
    """Wait until the run has taken the wish, and return whether it did in time."""
    until = time.monotonic() + within_s
    while (folder / CONTROL_FILE).exists():
        if time.monotonic() > until:
            return False
        time.sleep(_LOOK_S / 4)
    return True


class Control:
    """Listens for wishes while a run is taken. As a context manager; a thread of its own looks for them.

    Parameters
    ----------
    folder
        Of the run.
    abort
        Called in that thread when the run is to end now.
    """

    def __init__(self, folder: Path, abort: Callable[[], None]) -> None:
        self._file = folder / CONTROL_FILE
        self._abort = abort
        self._lock = threading.Lock()
        self._pause = False
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._listen, name="evs-bench control", daemon=True)

    @property
    def pause(self) -> bool:
        """Whether the run is to be paused, or to stay so."""
        self.look()
        return self._pause

    def hold(self) -> None:
        """Pause the run, as if the operator had wished it: it goes on when one says so."""
        self._pause = True

    def look(self) -> None:
        """Take a wish, if there is one; what cannot be read is no wish."""
        with self._lock:
            wish = self._taken()
            if wish is not None:
                self._pause = wish == Wish.PAUSE
        if wish == Wish.ABORT:
            self._abort()

    def _taken(self) -> Wish | None:
        taken = self._file.with_name(self._file.name + ".taken")
        with contextlib.suppress(OSError, ValueError, KeyError, TypeError, RecursionError):
            self._file.replace(taken)  # a wish that is written meanwhile stays
            try:
                with taken.open("rb") as file:
                    return Wish(json.loads(file.read(_MOST_BYTES))["wish"])
            finally:
                taken.unlink(missing_ok=True)
        return None

    def __enter__(self) -> Self:
        """Begin to listen."""
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Listen no more; what was wished too late is removed."""
        self._over.set()
        self._thread.join()
        with contextlib.suppress(OSError):
            self._file.unlink(missing_ok=True)

    def _listen(self) -> None:
        while not self._over.wait(_LOOK_S):
            self.look()
