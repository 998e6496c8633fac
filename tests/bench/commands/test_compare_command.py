"""`evs-bench compare`: what is told of the data above the tables. A comparison made by hand stands for the fit."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from click.testing import CliRunner

from bench import cli
from bench.commands.compare import command
from bench.diagnosis.comparison import Comparison
from sim_backend.pixel import PixelModel

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from bench.diagnosis.result import Outcome

PROTOCOL = """\
format: evs-bench-protocol/1
title: dark
roi: {x: 10, y: 20, width: 3, height: 2}
measurements:
  - name: dark
    stimulus: {kind: constant, duration_s: 0.1}
    sweep: {illuminance_lux: [100]}
"""


@pytest.fixture(name="folder", scope="module")
def small_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("compare")
    (folder / "dark.yaml").write_text(PROTOCOL)
    assert cli.run(["run", str(folder / "dark.yaml"), "--out", str(folder / "run")]) == 0
    return folder / "run"


@pytest.fixture(name="compared")
def compare_command(
    folder: Path, tmp_path: Path, explained: Outcome, residuals_of: Callable[[float], Any],
    monkeypatch: pytest.MonkeyPatch,
) -> Callable[..., list[str]]:  # fmt: skip
    """Return what the command prints where a comparison has found this of the data."""

    def run(*arguments: str, **told: Any) -> list[str]:
        found = residuals_of(0.0)
        values: dict[str, Any] = {"findings": (), "step": explained.steps[0], "residuals": found, **told}
        made = Comparison(("a",), correlation=np.eye(len(found)), model=PixelModel(), **values)
        monkeypatch.setattr("bench.diagnosis.comparison.compare", lambda *_, **__: made)
        done = CliRunner().invoke(command, [str(folder), "--out", str(tmp_path), *arguments])
        assert done.exit_code == 0, done.output
        lines: list[str] = done.stdout.splitlines()
        return lines

    return run


def test_why_data_are_not_fit_is_told_above_the_tables(compared: Callable[..., list[str]], tmp_path: Path) -> None:
    lines = compared(findings=("12 events", "lost triggers"))
    assert lines[0].endswith("1 point, 6 pixels, not fit to judge")
    assert lines[1:3] == ["not fit to judge: 12 events", "not fit to judge: lost triggers"]
    assert lines[3].startswith("thresholds, ")
    assert (tmp_path / "comparison/model.yaml").exists()


def test_what_is_to_be_known_of_data_that_are_fit_is_told_above_the_tables(
    compared: Callable[..., list[str]], tmp_path: Path
) -> None:
    lines = compared(cautions=("the readout was the limit",))
    assert lines[0].endswith("1 point, 6 pixels, fit to judge")
    assert lines[1] == "fit to judge, but the readout was the limit"
    assert lines[2].startswith("thresholds, ")
    quality = json.loads((tmp_path / "comparison/comparison.json").read_text())["data_quality"]
    assert quality == {"ok": True, "findings": ["the readout was the limit"]}


def test_json_has_the_reasons(compared: Callable[..., list[str]]) -> None:
    told = json.loads("\n".join(compared("--json", findings=("12 events",))))
    assert told["data_quality"] == {"ok": False, "findings": ["12 events"]}
