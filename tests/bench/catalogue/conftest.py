"""Run folders as the catalogue sees them: run.yaml, journal and files of points, made by hand."""

from __future__ import annotations

import json
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
import yaml

RunMaker = Callable[..., Path]
START = datetime(2026, 11, 20, 21, 0, tzinfo=UTC)


def line(state: str, at_s: float, point: int | None = None, **more: Any) -> dict[str, Any]:
    """Return one line of a journal, `at_s` seconds after the start."""
    moment = (START + timedelta(seconds=at_s)).isoformat(timespec="milliseconds").replace("+00:00", "Z")
    return {"t": moment, "state": state, **({} if point is None else {"point": point}), **more}


def whole_journal(points: int = 2, step_s: float = 10.0) -> list[dict[str, Any]]:
    """Return the journal of a run that came to its end: a point each `step_s`."""
    lines = [line("run_started", 0.0, points=points), *(line("planned", 0.0, i) for i in range(points))]
    for i in range(points):
        lines.append(line("started", i * step_s, i))
        lines.append(line("done", (i + 1) * step_s, i, file=f"points/{i:06d}.h5"))
    return [*lines, line("run_finished", points * step_s)]


def header_of(name: str, **changes: Any) -> dict[str, Any]:
    """Return the keys of a run.yaml; a change with None takes a key away."""
    content = {
        "format": "evs-bench-run/1",
        "id": f"2026-11-20T21-00-00.000Z-{name}",
        "created": "2026-11-20T21:00:00Z",
        "title": f"title of {name}",
        "sensor": {"name": "IMX636", "width": 1280, "height": 720},
        "roi": {"x": 0, "y": 0, "width": 4, "height": 4},
        "seed": 1,
        "protocol": {"title": f"title of {name}", "measurements": [{"name": "on", "pulses": 30}]},
        "station": {
            "name": "box",
            "roles": {"light": {"driver": "a:B"}},
            "identities": {"camera": {"serial": "00042"}},
        },
        **changes,
    }
    return {key: value for key, value in content.items() if value is not None}


def write_run(
    folder: Path, journal: list[dict[str, Any]] | None = None, header: dict[str, Any] | None = None, **changes: Any
) -> Path:
    """Write a run folder; its points are files that only look like some."""
    (folder / "points").mkdir(parents=True)
    (folder / "run.yaml").write_text(yaml.safe_dump(header or header_of(folder.name, **changes)))
    journal = whole_journal() if journal is None else journal
    (folder / "journal.jsonl").write_text("".join(json.dumps(one) + "\n" for one in journal))
    for name in {one["file"] for one in journal if one.get("file")}:
        (folder / name).write_bytes(b"x" * 1000)
    return folder


@pytest.fixture
def make_run(tmp_path: Path) -> RunMaker:
    """Return a maker of run folders below ``runs``."""

    def make(name: str, journal: list[dict[str, Any]] | None = None, **changes: Any) -> Path:
        return write_run(tmp_path / "runs" / name, journal, **changes)

    return make


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    """Return the folder in which the maker puts its runs."""
    (tmp_path / "runs").mkdir()
    return tmp_path / "runs"


@pytest.fixture
def journal_line() -> Callable[..., dict[str, Any]]:
    """Return the maker of journal lines."""
    return line
