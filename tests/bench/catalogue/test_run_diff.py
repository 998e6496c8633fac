"""What differs between two runs: the same small run taken with other settings."""

from __future__ import annotations

import json
import shutil
from typing import TYPE_CHECKING, Any

import h5py
import pytest

from bench.catalogue.run_diff import RunDiff, diff_runs
from bench.run import run_protocol
from bench.station import load_station
from bench.store import RunError
from bench.store.run import sha256_of
from protocols import parse_protocol

if TYPE_CHECKING:
    from pathlib import Path

PROTOCOL = """\
format: evs-bench-protocol/1
title: a small run
seed: 5
roi: {x: 10, y: 20, width: 2, height: 2}
expect: {dark_light_lux: 0.1}
pulses: 2
measurements:
  - name: "on"
    stimulus: {kind: square, frequency_hz: 20}
    settings: {biases: {bias_refr: 10}}
    sweep:
      illuminance_lux: [100]
      contrast: {scale: log, values: [0.5, 1.0]}
  - name: "dark"
    stimulus: {kind: constant, duration_s: 0.1}
    sweep: {illuminance_lux: [100]}
"""


def _take(folder: Path, text: str) -> Path:
    return run_protocol(parse_protocol(text, "small.yaml"), load_station("simulated_ideal"), folder).folder


@pytest.fixture(scope="module", name="two")
def two_runs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("runs")
    other = PROTOCOL.replace("a small run", "another").replace("[0.5, 1.0]", "[0.5, 1.0, 1.5]")
    other = other.replace("bias_refr: 10", "bias_refr: 20").replace("seed: 5", "seed: 6")
    return _take(folder / "one", PROTOCOL), _take(folder / "other", other)


def _with_digests(folder: Path) -> str:
    """Return the journal with the checksums of the files as they are now: they count as they were written."""
    lines = [json.loads(line) for line in (folder / "journal.jsonl").read_text().splitlines()]
    for line in lines:
        if line.get("file"):
            line["sha256"] = sha256_of(folder / line["file"])
    return "".join(json.dumps(line) + "\n" for line in lines)


def _group(found: RunDiff, name: str) -> list[tuple[str, Any, Any]]:
    (group,) = (group for group in found.groups if group.name == name)
    return [(one.path, one.left, one.right) for one in group.differences]


def test_a_run_is_equal_to_itself(two: tuple[Path, Path]) -> None:
    found = diff_runs(two[0], two[0])
    assert found.equal
    assert found.lines() == [f"{two[0]} | {two[0]}", "", "the settings are the same"]


def test_settings_of_the_protocol(two: tuple[Path, Path]) -> None:
    found = diff_runs(*two)
    assert not found.equal
    assert _group(found, "protocol") == [
        ("measurements[0].settings.biases.bias_refr", 10, 20),
        ("measurements[0].sweep.contrast.values", [0.5, 1.0], [0.5, 1.0, 1.5]),
    ]
    assert _group(found, "seed") == [("seed", 5, 6)]
    assert _group(found, "station") == _group(found, "sensor") == _group(found, "window") == []
    text = "\n".join(found.lines())
    assert "measurements[0].settings.biases.bias_refr: 10 | 20" in text
    assert "the same: station, sensor, window" in text


def test_points_and_what_was_read_back(two: tuple[Path, Path]) -> None:
    """Another contrast in between, and the points behind it are still found."""
    found = {path: (left, right) for path, left, right in _group(diff_runs(*two), "points")}
    assert found["taken"] == (3, 4)
    left, right = found["only in one of them"]
    assert left == "none"
    assert right.endswith("(on, 100 lux, log contrast 1.5)")
    changed = {path.partition(" at ")[0]: values for path, values in found.items() if " at " in path}
    assert changed["bias.bias_refr"] == (10.0, 20.0)
    assert set(changed) <= {"bias.bias_refr", "refractory_s"}


def test_points_of_another_contrast_are_the_same_points(two: tuple[Path, Path], tmp_path: Path) -> None:
    other = _take(tmp_path / "other", PROTOCOL.replace("[0.5, 1.0]", "[0.5, 1.25]"))
    found = {path.partition(" at ")[0]: values for path, *values in _group(diff_runs(two[0], other), "points")}
    assert found == {"log_contrast": [1.0, 1.25]}


def test_names_and_times_are_apart(two: tuple[Path, Path], tmp_path: Path) -> None:
    again = tmp_path / "again"
    shutil.copytree(two[0], again)
    text = (again / "run.yaml").read_text().replace("a small run", "the very same")
    (again / "run.yaml").write_text(text)
    found = diff_runs(two[0], again)
    assert found.equal
    assert ("title", "a small run", "the very same") in _group(found, "names and times")
    assert found.to_dict()["settings"]["protocol"] == []


def test_temperatures_are_told_as_ranges(two: tuple[Path, Path], tmp_path: Path) -> None:
    warm = tmp_path / "warm"
    shutil.copytree(two[0], warm)
    for i in range(3):
        with h5py.File(warm / "points" / f"{i:06d}.h5", "r+") as file:
            file.attrs["temperature_c"] = 30.0 + i
    (warm / "journal.jsonl").write_text(_with_digests(warm))
    found = diff_runs(two[0], warm)
    assert found.equal
    assert _group(found, "readings") == [("temperature_c", "25", "30 to 32")]


def test_a_damaged_point_is_left_out_and_told(two: tuple[Path, Path], tmp_path: Path) -> None:
    bad = tmp_path / "bad"
    shutil.copytree(two[0], bad)
    (bad / "points" / "000001.h5").write_bytes(b"nothing")
    found = diff_runs(two[0], bad)
    assert ("only in one of them", "point 1 (on, 100 lux, log contrast 1)", "none") in _group(found, "points")
    assert len(found.remarks) == 1
    assert "000001.h5" in found.lines()[-1]
    assert diff_runs(two[0], bad, points=False).equal


def test_a_run_without_its_station(two: tuple[Path, Path], tmp_path: Path) -> None:
    bare = tmp_path / "bare"
    shutil.copytree(two[0], bare)
    text = (bare / "run.yaml").read_text()
    (bare / "run.yaml").write_text(text[: text.index("\nstation:")] + text[text.index("\nsoftware:") :])
    assert [line for line in diff_runs(two[0], bare).lines() if "all of it" in line] == ["  all of it: there | -"]


def test_measurements_that_differ_alike_are_one_line(two: tuple[Path, Path], tmp_path: Path) -> None:
    fast = _take(tmp_path / "fast", PROTOCOL.replace("pulses: 2", "pulses: 2\nsettle: {light_s: 0.3}"))
    lines = diff_runs(two[0], fast).lines()
    assert "  measurements[0, 1].settle.light_s: 0.2 | 0.3" in lines


def test_what_is_no_run(tmp_path: Path, two: tuple[Path, Path]) -> None:
    with pytest.raises(RunError, match="there is no such run folder"):
        diff_runs(two[0], tmp_path / "none")
