"""Run folders for the page: one that a simulated station left, and made-up ones."""

from __future__ import annotations

import fcntl
import json
import shutil
import subprocess
import sys
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import pytest

from bench.watch.watcher import Watcher

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

PROTOCOL = """\
format: evs-bench-protocol/1
title: "<b>Two</b> lights & some dark"
seed: 3
roi: {x: 632, y: 352, width: 6, height: 5}
expect: {theta_on: 0.3, theta_off: 0.25, dark_light_lux: 0.1, bandwidth_hz: 200, refractory_period_s: 0.005}
pulses: 4
measurements:
  - name: "square"
    stimulus: {kind: square, frequency_hz: 5}
    sweep: {illuminance_lux: [10, 100], contrast: {scale: log, values: [0.2, 0.3, 0.5]}}
  - name: "on"
    stimulus: {kind: reset_test, polarity: "on", reset_s: 0.04, test_s: 0.04,
               reset_contrast: {scale: log, value: 0.6}}
    sweep: {illuminance_lux: [10], contrast: {scale: log, values: [0.2, 0.4]}}
  - name: "dark"
    stimulus: {kind: constant, duration_s: 2}
    sweep: {illuminance_lux: [10, 100]}
"""


@pytest.fixture(scope="session")
def finished_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a small simulated run; it is not to be changed."""
    from bench.run import run_protocol
    from bench.station import load_station
    from protocols import parse_protocol

    folder = tmp_path_factory.mktemp("watched") / "run"
    run_protocol(parse_protocol(PROTOCOL, "watched.yaml"), load_station("simulated"), folder)
    return folder


@pytest.fixture(name="run")
def a_copy(finished_run: Path, tmp_path: Path) -> Path:
    """Return a copy of the finished run that a test may change."""
    return shutil.copytree(finished_run, tmp_path / "run")


def lines_of(run: Path) -> list[dict[str, Any]]:
    """Return the journal of a run as it stands in the file."""
    return [json.loads(line) for line in (run / "journal.jsonl").read_text().splitlines()]


def write_lines(run: Path, lines: list[dict[str, Any]]) -> None:
    """Make `lines` the journal of a run."""
    (run / "journal.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))


@pytest.fixture
def journal_of() -> Callable[[Path], list[dict[str, Any]]]:
    """Read the journal of a run."""
    return lines_of


@pytest.fixture
def make_journal() -> Callable[[Path, list[dict[str, Any]]], None]:
    """Replace the journal of a run."""
    return write_lines


@pytest.fixture
def state_of() -> Callable[[Path], dict[str, Any]]:
    """Return the state of a run when all its points are counted."""

    def state(run: Path) -> dict[str, Any]:
        watcher = Watcher(run)
        while watcher.count_one():
            pass
        watcher.look()
        found: dict[str, Any] = json.loads(watcher.snapshot.body)
        return found

    return state


@contextmanager
def _held(journal: Path) -> Iterator[None]:
    code = "import fcntl, sys; f = open(sys.argv[1]); fcntl.flock(f, fcntl.LOCK_EX); print(flush=True); input()"
    with subprocess.Popen(
        [sys.executable, "-c", code, str(journal)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as holder:
        assert holder.stdout is not None
        holder.stdout.readline()
        try:
            yield
        finally:
            holder.kill()


@pytest.fixture
def held_by_another() -> Callable[[Path], Any]:
    """Hold the lock on a journal in another process, as a writer does."""
    return _held


@pytest.fixture
def until() -> Callable[[Callable[[], Any]], Any]:
    """Return what a function returns as soon as that is true; fail after 60 s."""

    def wait(true: Callable[[], Any]) -> Any:
        limit = time.monotonic() + 60.0
        while time.monotonic() < limit:
            found = true()
            if found:
                return found
            time.sleep(0.05)
        raise AssertionError("it did not come true")

    return wait


@pytest.fixture
def lockable() -> Callable[[Path], bool]:
    """Say whether a writer that comes now gets its lock."""

    def free(journal: Path) -> bool:
        with journal.open("rb") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                return False
        return True

    return free
