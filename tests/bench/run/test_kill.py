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


def _kill_at_a_random_moment(folder: Path, wait_s: float) -> None:
    """Start a run in `folder`, and kill it `wait_s` seconds after its first point began."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p or "." for p in sys.path)}
    command = [sys.executable, str(SCRIPT), str(folder)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, env=environment) as child:
        assert child.stderr is not None
        first = child.stderr.readline()
        assert first.startswith(b"point 1 of"), first + child.stderr.read()
        time.sleep(wait_s)
        assert child.poll() is None, "the run was over before it was killed"
        child.send_signal(signal.SIGKILL)
        child.stderr.read()


@pytest.mark.slow
def test_every_point_that_is_done_survives_a_kill(tmp_path: Path) -> None:
    rng = np.random.default_rng(20)
    interrupted = 0
    for number in range(KILLS):
        folder = tmp_path / f"run{number}"
        _kill_at_a_random_moment(folder, float(rng.uniform(0.0, 0.4)))
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
