"""`evs-bench diff`: what it prints, and its exit codes."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from click.testing import CliRunner

from bench.commands.diff import command

if TYPE_CHECKING:
    from pathlib import Path

RUN = """\
format: evs-bench-run/1
id: {name}
sensor: {{name: IMX636, width: 8, height: 8}}
roi: {{x: 0, y: 0, width: {width}, height: 4}}
"""


def _run(folder: Path, width: int) -> str:
    (folder / "points").mkdir(parents=True)
    (folder / "run.yaml").write_text(RUN.format(name=folder.name, width=width))
    return str(folder)


def test_settings_that_differ(tmp_path: Path) -> None:
    two = [_run(tmp_path / "a", 4), _run(tmp_path / "b", 5)]
    done = CliRunner().invoke(command, two, catch_exceptions=False, standalone_mode=False)
    assert done.return_value == 0
    assert "window\n  width: 4 | 5\n" in done.output
    assert "names and times (no difference of the settings)\n  id: a | b\n" in done.output
    coded = CliRunner().invoke(command, [*two, "--exit-code", "--json"], standalone_mode=False)
    assert coded.return_value == 3
    payload = json.loads(coded.output)
    assert (payload["format"], payload["equal"]) == ("evs-bench-run-diff/1", False)
    assert payload["settings"]["window"] == [{"path": "width", "left": 4, "right": 5}]
    assert payload["apart"]["names and times"] == [{"path": "id", "left": "a", "right": "b"}]


def test_equal_settings(tmp_path: Path) -> None:
    two = [_run(tmp_path / "a", 4), _run(tmp_path / "b", 4)]
    done = CliRunner().invoke(command, [*two, "--exit-code", "--no-points"], standalone_mode=False)
    assert done.return_value == 0
    assert done.output.endswith("the settings are the same\n")
