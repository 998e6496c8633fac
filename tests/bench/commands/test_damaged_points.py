"""A run with damaged points: the rest is analysed, and the loss is told first."""

from __future__ import annotations

import hashlib
import json
import shutil
from typing import TYPE_CHECKING

import pytest

from bench.cli import run

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture(name="folder")
def run_folder(data_folder: Path, tmp_path: Path) -> Path:
    """Return a run of four points, with a journal that calls each of them done."""
    source, folder = data_folder / "practice/practice_3", tmp_path / "run"
    (folder / "points").mkdir(parents=True)
    shutil.copy(source / "run.yaml", folder)
    lines = []
    for i in range(4):
        shutil.copy(source / f"points/{i:06d}.h5", folder / "points")
        digest = hashlib.sha256((source / f"points/{i:06d}.h5").read_bytes()).hexdigest()
        at = {"t": "2026-11-20T00:00:00Z", "point": i}
        lines += [{**at, "state": "planned"}]
        lines += [{**at, "state": "done", "file": f"points/{i:06d}.h5", "sha256": digest}]
    (folder / "journal.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    return folder


def damage(folder: Path, point: int) -> None:
    file = folder / f"points/{point:06d}.h5"
    file.write_bytes(file.read_bytes()[:3000])


@pytest.mark.slow
def test_the_rest_is_analysed_and_the_loss_is_told_first(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    damage(folder, 2)
    assert run(["analyze", str(folder), "--no-pixel-maps"]) == 0
    out = capsys.readouterr().out
    assert out.startswith("DATA LOST: 1 point is damaged and left out")
    assert "000002.h5: damaged" in out
    assert "planned points were taken" not in out
    assert run(["analyze", str(folder), "--no-pixel-maps", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert len(found["damaged"]) == 1
    assert "000002.h5" in found["damaged"][0]
    assert {row["point"] for row in [*found["responses"], *found["background"]]} == {0, 1, 3}


def test_with_nothing_left_it_fails(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for point in range(4):
        damage(folder, point)
    assert run(["analyze", str(folder)]) == 1
    assert capsys.readouterr().err.count("damaged") == 4


def test_a_whole_run_says_nothing_of_loss(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["analyze", str(folder), "--no-pixel-maps", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["damaged"] == []
