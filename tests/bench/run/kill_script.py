"""Runs a protocol of many points, with a camera that makes events up quickly, and waits to be killed.

Each line of standard input, ``EVENTS FOLDER``, asks for a run with at most so many events in a point. It has a
process of its own, forked when all is imported: importing takes longer than the run. Its standard error is the named
pipe ``FOLDER.stderr``. Standard output says its number, and its exit code when it is over.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from conftest import PROTOCOL, build_station  # type: ignore[import-not-found]

from bench.run import run_protocol
from bench.run.progress import LineProgress
from drivers.events.types import EVENT_DTYPE, EventChunk, empty_triggers
from protocols import parse_protocol
from sim_backend.devices.camera import SimulatedCamera

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivers.interfaces import Recording


class QuickCamera(SimulatedCamera):
    """A camera whose events are noise from the seed of the recording: nothing to compile, nothing to wait for."""

    most_events = 20_000

    def start(self, recording: Recording) -> None:
        super().start(recording)
        self._seed = recording.seed

    def chunks(self) -> Iterator[EventChunk]:
        rng = np.random.default_rng(self._seed)
        events = np.empty(int(rng.integers(self.most_events // 2, self.most_events)), EVENT_DTYPE)
        events["t"] = np.sort(rng.integers(0, 500_000, len(events)))
        events["x"], events["y"] = rng.integers(10, 14, len(events)), rng.integers(20, 23, len(events))
        events["p"] = rng.integers(0, 2, len(events))
        for part in np.array_split(events, 3):
            yield EventChunk(part, empty_triggers())


def next_run() -> tuple[int, Path]:
    """Fork a process for each line, in which this returns what it asks for."""
    while line := sys.stdin.readline():
        if number := os.fork():
            print(number, flush=True)  # noqa: T201
            print(os.waitstatus_to_exitcode(os.waitpid(number, 0)[1]), flush=True)  # noqa: T201
            continue
        events, _, folder = line.rstrip("\n").partition(" ")
        os.dup2(os.open(f"{folder}.stderr", os.O_WRONLY), sys.stderr.fileno())
        return int(events), Path(folder)
    sys.exit()


def main(folder: Path) -> None:
    """Take many more points into `folder` than anybody waits for."""
    text = PROTOCOL.replace("values: [0.5, 1.0]", "linspace: {start: 0.1, stop: 1.0, num: 150}")
    protocol = parse_protocol(text, "killed.yaml")
    run_protocol(protocol, build_station(camera=QuickCamera), folder, progress=LineProgress(sys.stderr, 0.0))


if __name__ == "__main__":
    QuickCamera.most_events, asked = next_run()
    main(asked)
