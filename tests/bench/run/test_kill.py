"""A run that is killed at a random moment: every point that the journal calls done is there and whole."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from bench.store import Run
from bench.store.run import sha256_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

SCRIPT = Path(__file__).parent / "kill_script.py"
KILLS = 8
#: The most points before a kill, and the most events of one whose file takes a while to write.
LATEST, LARGE = 8, 100_000


class Child:
    """A run in a process of its own, which :mod:`kill_script` forks."""

    def __init__(self, script: subprocess.Popen[str], folder: Path, events: int) -> None:
        assert script.stdin is not None
        assert script.stdout is not None
        self._out, pipe = script.stdout, folder.with_name(folder.name + ".stderr")
        os.mkfifo(pipe)
        script.stdin.write(f"{events} {folder}\n")
        script.stdin.flush()
        self._number = int(self._out.readline())
        self.stderr = pipe.open("rb")

    def send_signal(self, which: signal.Signals) -> None:
        # Its number is given to no other process before its exit code is told.
        if not self.over:
            os.kill(self._number, which)

    @property
    def over(self) -> bool:
        return bool(select.select([self._out], [], [], 0.0)[0])

    def end(self) -> tuple[int, str]:
        """Return the exit code and the rest of what was said, when it is over."""
        with self.stderr:
            said = self.stderr.read().decode()
        return int(self._out.readline()), said


@pytest.fixture(scope="module")
def begin() -> Iterator[Callable[[Path, int], Child]]:
    """Return a function that begins a run in a folder, with points of at most so many events."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p or "." for p in sys.path)}
    with subprocess.Popen(
        [sys.executable, str(SCRIPT)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment, text=True
    ) as script:
        yield partial(Child, script)


def _files(folder: Path, suffix: str) -> int:
    """Return how many point files there are; it is asked all the time, and must leave the run its processor."""
    return sum(name.endswith(suffix) for name in os.listdir(folder / "points"))  # noqa: PTH208 - a tenth of the time


def _kill_at_a_random_moment(
    child: Child, folder: Path, after_points: int, later_s: float, while_writing: bool
) -> None:
    """Kill a run after some points and a little later, or while a file is being written."""
    first = child.stderr.readline()
    assert first.startswith(b"point 1 of"), first + child.stderr.read()
    # Progress, not time, says when: a slow machine comes to the same moments.
    while _files(folder, ".h5") < after_points:
        assert not child.over, "the run was over before it was killed"
        time.sleep(0.001)
    while while_writing and not _files(folder, ".part"):
        assert not child.over, "the run was over before a file was seen being written"
        time.sleep(0.0002)
    if not while_writing:
        time.sleep(later_s)
    child.send_signal(signal.SIGKILL)
    assert child.end()[0] == -signal.SIGKILL


@pytest.mark.slow
def test_two_interrupts_in_quick_succession_crash_nothing(
    begin: Callable[[Path, int], Child], tmp_path: Path
) -> None:
    rng = np.random.default_rng(8)
    for number in range(8):
        folder = tmp_path / f"run{number}"
        child = begin(folder, LARGE)
        for _ in range(int(rng.integers(1, 6))):
            child.stderr.readline()
        child.send_signal(signal.SIGINT)
        time.sleep(float(rng.uniform(0.0005, 0.008)))
        child.send_signal(signal.SIGINT)
        code, said = child.end()
        assert code in (0, -signal.SIGINT, 130), said
        run = Run.open(folder)
        run.verify()
        assert run.journal[-1].state == "run_aborted"
        assert not list((folder / "points").glob("*.part"))


@pytest.mark.slow
def test_every_point_that_is_done_survives_a_kill(begin: Callable[[Path, int], Child], tmp_path: Path) -> None:
    rng = np.random.default_rng(20)
    interrupted = 0
    for number in range(KILLS):
        folder = tmp_path / f"run{number}"
        writing = number % 2 == 0
        child = begin(folder, LARGE if writing else 20_000)
        _kill_at_a_random_moment(child, folder, int(rng.integers(0, LATEST)), float(rng.uniform(0.0, 0.03)), writing)
        run = Run.open(folder)
        assert run.journal[0].state == "run_started"
        for file in run.files:
            assert file.sha256 == sha256_of(file.path)
        run.verify()
        assert [point.index for point in run.points()] == list(range(len(run)))
        # At most one file can be there without its line: killed between the two.
        present = {path.name for path in (folder / "points").glob("*.h5")}
        assert 0 <= len(present) - len(run) <= 1
        interrupted += bool(list((folder / "points").glob("*.part")))
    assert interrupted > 0  # some of the kills came while a file was being written
