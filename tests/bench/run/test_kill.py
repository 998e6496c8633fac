"""A run that is killed at a random moment: every point that the journal calls done is there and whole."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from bench.store import Run
from bench.store.run import sha256_of

SCRIPT = Path(__file__).parent / "kill_script.py"
KILLS = 20


def _kill_at_a_random_moment(folder: Path, after_points: int, later_s: float, *, while_writing: bool) -> None:
    """Start a run in `folder`, and kill it after some points and a little later, or while a file is being written."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p or "." for p in sys.path)}
    command = [sys.executable, str(SCRIPT), str(folder), "200000" if while_writing else "20000"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, env=environment) as child:
        assert child.stderr is not None
        first = child.stderr.readline()
        assert first.startswith(b"point 1 of"), first + child.stderr.read()
        # Progress, not time, says when: a slow machine comes to the same moments.
        while len(list((folder / "points").glob("*.h5"))) < after_points:
            assert child.poll() is None, "the run was over before it was killed"
            time.sleep(0.001)
        while while_writing and not list((folder / "points").glob("*.part")):
            assert child.poll() is None, "the run was over before a file was seen being written"
        if not while_writing:
            time.sleep(later_s)
        child.send_signal(signal.SIGKILL)
        child.stderr.read()


@pytest.mark.slow
def test_two_interrupts_in_quick_succession_crash_nothing(tmp_path: Path) -> None:
    rng = np.random.default_rng(8)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p or "." for p in sys.path)}
    for number in range(8):
        folder = tmp_path / f"run{number}"
        command = [sys.executable, str(SCRIPT), str(folder), "200000"]
        with subprocess.Popen(command, stderr=subprocess.PIPE, env=environment) as child:
            assert child.stderr is not None
            for _ in range(int(rng.integers(1, 6))):
                child.stderr.readline()
            child.send_signal(signal.SIGINT)
            time.sleep(float(rng.uniform(0.0005, 0.008)))
            child.send_signal(signal.SIGINT)
            said = child.stderr.read().decode()
        assert child.returncode in (0, -signal.SIGINT, 130), said
        run = Run.open(folder)
        run.verify()
        assert run.journal[-1].state == "run_aborted"
        assert not list((folder / "points").glob("*.part"))


@pytest.mark.slow
def test_every_point_that_is_done_survives_a_kill(tmp_path: Path) -> None:
    rng = np.random.default_rng(20)
    interrupted = 0
    for number in range(KILLS):
        folder = tmp_path / f"run{number}"
        _kill_at_a_random_moment(
            folder, int(rng.integers(0, 20)), float(rng.uniform(0.0, 0.03)), while_writing=number % 2 == 0
        )
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
