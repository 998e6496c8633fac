"""Small queues of small protocols on the simulated station."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from bench.queueing import QueueCrew
from bench.run.progress import NoProgress

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

SMALL = """\
format: evs-bench-protocol/1
title: {title}
seed: 1
roi: {{x: 632, y: 352, width: 4, height: 4}}
measurements:
  - name: light
    stimulus: {{kind: constant, duration_s: 2}}
    sweep: {{illuminance_lux: [{lux}]}}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with the protocols `bright.yaml`, of two points, and `dark.yaml`, of one."""
    (tmp_path / "bright.yaml").write_text(SMALL.format(title="bright", lux="10, 100"))
    (tmp_path / "dark.yaml").write_text(SMALL.format(title="dark", lux="1"))
    return tmp_path


@pytest.fixture
def write_queue(folder: Path) -> Callable[..., Path]:
    """Return a function that writes a queue file of entries, with further keys of the file."""

    def write(*entries: str, more: str = "") -> Path:
        lines = "".join(f"  - {{{entry}}}\n" for entry in entries)
        path = folder / "queue.yaml"
        path.write_text(f"format: evs-bench-queue/1\ntitle: night\n{more}entries:\n{lines}")
        return path

    return write


class Crew:
    """A crew, and what it was told."""

    def __init__(self) -> None:
        self.told: list[str] = []

    def of(self, **more: Any) -> QueueCrew:
        """Return the crew; `more` are its other members."""
        return QueueCrew(self.told.append, NoProgress, **more)


@pytest.fixture
def crew() -> Crew:
    """Return a crew that remembers what it is told."""
    return Crew()
