"""What the workers of the tests do. Workers import it, so it must not lie in a test file."""

from __future__ import annotations

import os
import signal
import threading
import time
from dataclasses import dataclass
from pathlib import Path

from drivers.errors import DataLost, OutOfRange

prepared = 0


@dataclass(frozen=True, slots=True)
class Task:
    """A number, and what happens on the way to its square."""

    number: int
    folder: str = ""
    deaths: int = 0  #: workers that die over it, one after the other
    error: bool = False
    delay_s: float = 0.0

    def __str__(self) -> str:
        return f"number {self.number}"


def square(task: Task) -> int:
    """Return the square, unless something happens."""
    if task.deaths and len(tried(task)) < task.deaths:
        Path(task.folder, f"{task.number}.{time.monotonic_ns()}").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    if task.error:
        raise OutOfRange("lamp", "level", 7.0, 0.0, 5.0, "V")
    time.sleep(task.delay_s)
    return task.number**2


def tried(task: Task) -> list[Path]:
    """Return one file for each worker that died over the task."""
    return list(Path(task.folder).glob(f"{task.number}.*"))


def who(_: int) -> tuple[int, int, str | None]:
    """Return the process, how often it was prepared, and its share of the processors."""
    time.sleep(0.05)
    return os.getpid(), prepared, os.environ.get("EVS_BENCH_THREADS")


def threads_of_algebra(_: int) -> str | None:
    """Return with how many threads the linear algebra was loaded."""
    return os.environ.get("OPENBLAS_NUM_THREADS")


def prepare() -> None:
    """Count."""
    global prepared
    prepared += 1


def cannot_prepare() -> None:
    """Fail."""
    raise DataLost("effects", "load", "no such file")


def unpicklable(number: int) -> object:
    """Return what cannot be sent."""
    return threading.Lock(), number


def note_and_wait(folder: str) -> None:
    """Leave the number of this process in `folder`, and wait for ever."""
    Path(folder, str(os.getpid())).touch()
    time.sleep(600)
