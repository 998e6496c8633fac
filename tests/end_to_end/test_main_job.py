"""The main job on the simulated bench, through the commands that an operator uses."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

EVS_BENCH = str(Path(sys.executable).parent / "evs-bench")

IDEAL = """\
format: evs-bench-protocol/1
title: noise-free steps around the threshold
seed: 1
roi: {x: 636, y: 356, width: 4, height: 4}
expect: {dark_light_lux: 0, theta_on: 0.30, theta_off: 0.30, bandwidth_hz: 200}
settings: {long_refractory_period_s: 0.010, thresholds: {on: 0.30, off: 0.30}, bandwidth_hz: 200}
pulses: 5
measurements:
  - name: reset_test
    stimulus: {kind: reset_test, gap_s: 0.03, reset_s: 0.03, reset_contrast: {scale: log, value: 0.6}, test_s: 0.03}
    sweep:
      illuminance_lux: 100
      polarity: ["on", "off"]
      contrast: &contrast {scale: log, logspace: {start: 0.2926, stop: 0.3074, num: 11}}
  - name: square
    stimulus: {kind: square, frequency_hz: 10}
    sweep: {illuminance_lux: 100, contrast: *contrast}
"""

#: What makes `on_family` a matter of seconds: all its levels of light, but fewer pixels, pulses and contrasts.
SMALL = {"width: 32, height: 32": "width: 6, height: 6", "pulses: 100": "pulses: 5", "num: 30": "num: 6"}
#: Points of the practice run at its lowest level: the background, and square waves of two widths.
ONE_LEVEL = range(13)


def evs_bench(*arguments: str, cwd: Path) -> str:
    """Run the installed command, and return what it printed."""
    done = subprocess.run([EVS_BENCH, *arguments], cwd=cwd, capture_output=True, text=True, timeout=280)
    assert done.returncode == 0, done.stderr
    return done.stdout


def curves(run: str, cwd: Path) -> list[dict[str, Any]]:
    """Return the curves that `evs-bench analyze` finds."""
    found: list[dict[str, Any]] = json.loads(evs_bench("analyze", run, "--json", cwd=cwd))["curves"]
    return found


def all_events(run: Path) -> list[np.ndarray[Any, Any]]:
    """Return time, column, row and polarity of all events of each point."""
    events = []
    for file in sorted((run / "points").glob("*.h5")):
        with h5py.File(file) as point:
            events.append(np.stack([point[f"events/{name}"][:].astype(np.int64) for name in "txyp"]))
    return events


def test_noise_free_thresholds_are_within_one_per_cent(tmp_path: Path) -> None:
    (tmp_path / "ideal.yaml").write_text(IDEAL)
    evs_bench("run", "ideal.yaml", "--station", "simulated_ideal", "--out", "run", cwd=tmp_path)
    found = curves("run", tmp_path)
    kinds = {(curve["key"]["waveform"], curve["key"]["polarity"]) for curve in found}
    assert kinds == {(w, p) for w in ("reset_test", "square") for p in ("on", "off")}
    for curve in found:
        for name in ("half", "intercept"):
            estimate = curve[name]
            assert estimate["value"] == pytest.approx(0.3, rel=0.01)
            assert estimate["low"] <= 0.3 <= estimate["high"]
            # The interval is what the spacing of the contrasts leaves open, 0.5 %, not a fitted width of zero.
            assert 0.003 < (estimate["high"] - estimate["low"]) / 0.3 < 0.02


@pytest.mark.slow
def test_on_family_passes_check_and_runs_small(tmp_path: Path) -> None:
    text = evs_bench("protocols", "show", "on_family", cwd=tmp_path)
    small = text
    for shipped, less in SMALL.items():
        assert small.count(shipped) == 1
        small = small.replace(shipped, less)
    (tmp_path / "small.yaml").write_text(small)
    for protocol in ("on_family", "off_family", "small.yaml"):
        assert json.loads(evs_bench("check", protocol, "--json", cwd=tmp_path))["findings"] == []
    result = json.loads(evs_bench("run", "small.yaml", "--out", "run", "--json", cwd=tmp_path))
    assert result["points_done"] == result["points"] == 48
    assert {curve["key"]["baseline_lux"] for curve in curves("run", tmp_path)} == {
        0.076, 0.1, 0.152, 0.304, 1.0, 3.0, 30.0, 300.0,
    }  # fmt: skip


def test_rerun_gives_the_same_events_and_another_seed_gives_others(tmp_path: Path) -> None:
    text = IDEAL.replace("num: 11", "num: 2")
    (tmp_path / "two.yaml").write_text(text)
    evs_bench("run", "two.yaml", "--out", "first", cwd=tmp_path)
    evs_bench("rerun", "first", "--out", "again", cwd=tmp_path)
    evs_bench("run", "two.yaml", "--out", "other", "--seed", "2", cwd=tmp_path)
    first, again, other = (all_events(tmp_path / name) for name in ("first", "again", "other"))
    assert len(first) == 6
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))
    assert not any(np.array_equal(a, b) for a, b in zip(first, other, strict=True))


def test_a_recording_is_imported_analysed_and_reported(tmp_path: Path, data_folder: Path) -> None:
    recording = data_folder / "recordings" / "gen31_640x480_triggers.evt3"
    folder = tmp_path / "lab"
    folder.mkdir()
    (folder / "dark.evt3").write_bytes(recording.read_bytes())
    (folder / "recordings.yaml").write_text(
        "format: evs-bench-run/1\n"
        "id: gen31\n"
        "sensor: {name: Gen3.1, width: 640, height: 480, pixel_pitch_m: 15.0e-6, quantum_efficiency: 0.3}\n"
        "roi: {x: 0, y: 0, width: 640, height: 480}\n"
        "points:\n"
        "  - {file: dark.evt3, waveform: constant, polarity: both, baseline_lux: 10, nd_od: 0, edges: [[0, 10]]}\n"
    )
    evs_bench("import", "lab", "--out", "run", cwd=tmp_path)
    rows = json.loads(evs_bench("analyze", "run", "--json", cwd=tmp_path))["background"]
    expected = json.loads(recording.with_suffix(".expected.json").read_text())
    assert {row["polarity"]: row["events"] for row in rows} == {"on": expected["n_on"], "off": expected["n_off"]}
    page = Path(tmp_path / evs_bench("report", "run", cwd=tmp_path).strip())
    assert page.read_text().lower().startswith("<!doctype html>")


@pytest.mark.slow
def test_a_run_of_another_simulator_is_analysed_and_reported(tmp_path: Path, data_folder: Path) -> None:
    source = data_folder / "practice" / "practice_3"
    (tmp_path / "run" / "points").mkdir(parents=True)
    for name in ("run.yaml", *(f"points/{number:06d}.h5" for number in ONE_LEVEL)):
        (tmp_path / "run" / name).write_bytes((source / name).read_bytes())
    page = Path(tmp_path / evs_bench("report", "run", cwd=tmp_path).strip())
    assert page.exists()
    with (page.parent / "tables" / "curves.csv").open(newline="") as table:
        assert sorted(curve["polarity"] for curve in csv.DictReader(table)) == ["off", "off", "on", "on"]
