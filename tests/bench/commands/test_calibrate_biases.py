"""`evs-bench calibrate-biases` on a simulated sensor of which the station does not know what its biases do."""

from __future__ import annotations

import json
import math
from importlib.resources import files
from typing import TYPE_CHECKING, Any

import pytest
from ruamel.yaml import YAML

from bench import cli
from bench.analysis.whole import analyze
from bench.run import run_protocol
from bench.station import load_station
from bench.store import Run
from protocols import parse_protocol

if TYPE_CHECKING:
    from pathlib import Path

#: Few pixels, few offsets, and each contrast where it tells.
PROTOCOL = """\
format: evs-bench-protocol/1
title: few biases
seed: 8
roi: {x: 632, y: 352, width: 12, height: 12}
settings: {biases: {bias_diff_on: 0, bias_diff_off: 0, bias_fo: 0, bias_refr: -20}}
pulses: 12
measurements:
  - name: a
    stimulus: &pulses {kind: reset_test, polarity: "on", gap_s: 0.06, reset_s: 0.04, test_s: 0.04,
                       reset_contrast: {scale: log, value: 1.1}}
    sweep: &sweep
      illuminance_lux: 100
      biases: {bias_diff_on: [0, 17]}
      contrast: {scale: log, linspace: {start: 0.09, stop: 0.54, num: 16}}
  - name: b
    stimulus: {<<: *pulses, polarity: "off"}
    sweep: {<<: *sweep, biases: {bias_diff_off: [0, 20]}}
  - name: c
    stimulus: *pulses
    sweep: {<<: *sweep, biases: {bias_fo: [-13, 0, 22]}}
  - name: d
    stimulus: {kind: constant, duration_s: 0.05}
    sweep: {illuminance_lux: 100, biases: {bias_refr: [-20, 0, 60]}}
  - name: e
    stimulus: {kind: constant, duration_s: 20}
    sweep: {illuminance_lux: 100, biases: {bias_diff_on: [0, 17], bias_diff_off: [0, 20]}}
"""
PAIR = """\
format: evs-bench-protocol/1
title: the pair
roi: {x: 600, y: 300, width: 32, height: 32}
settings: {biases: {$pair}}
measurements:
  - name: constant
    stimulus: {kind: constant, duration_s: 20}
    sweep: {illuminance_lux: 100}
"""
TARGET_HZ = 0.012


@pytest.fixture(name="station", scope="module")
def station_that_knows_nothing(tmp_path_factory: pytest.TempPathFactory) -> Path:
    yaml = YAML()
    station = yaml.load(files("bench").joinpath("stations", "simulated.yaml").read_text(encoding="utf-8"))
    station["world"]["bias_map"] = station["calibration"].pop("bias_map")
    station["roles"]["camera"]["args"]["bias_behaviour"] = "$true_bias_map"
    path = tmp_path_factory.mktemp("biases") / "bench.yaml"
    yaml.dump(station, path)
    return path


@pytest.fixture(name="run", scope="module")
def run_of_biases(station: Path) -> Path:
    return run_protocol(parse_protocol(PROTOCOL, "few.yaml"), load_station(station), station.with_name("run")).folder


@pytest.mark.slow
def test_what_is_found_is_true_within_its_errors(
    run: Path, station: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["--station", str(station), "--write", "--date", "2026-12-01", "--target-background", str(TARGET_HZ)]
    assert cli.run(["calibrate-biases", str(run), *options, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["format"] == "evs-bench-bias-calibration/1"
    _true_within_errors(found)
    assert ["no value" in r and "light's edge of 0.22 ms" in r for r in found["remarks"]] == [True]
    _true_background(found, station.parent)
    assert found["written"] == {"station": str(station), "before": str(station.with_name("bench.before.yaml"))}
    written = load_station(station).calibration
    assert written.uncalibrated == ()
    for curve in written.bias_map.curves:
        rows = found["tables"][curve.quantity]["rows"]
        assert list(curve.values) == [row["value"] for row in rows]
    dates = {curve["date"] for curve in load_station(station).resolved["calibration"]["bias_map"].values()}
    assert dates == {"2026-12-01"}


def _true_within_errors(found: dict[str, Any]) -> None:
    truth = load_station("simulated").calibration.bias_map
    offsets = {"theta_on": [0, 17], "theta_off": [0, 20], "bandwidth_hz": [-13, 0], "refractory_s": [-20, 0, 60]}
    for quantity, table in found["tables"].items():
        assert [row["offset"] for row in table["rows"]] == offsets[quantity]
        for row in table["rows"]:
            true = truth.curve(quantity).value_at(row["offset"])
            # Nine values: all within 3.3 standard errors in 99 of 100 such runs.
            assert abs(math.log(row["value"] / true)) < 3.3 * row["sd"], (quantity, row, true)
            assert row["low"] < row["value"] < row["high"]
            assert row["sd"] < 0.08, "an interval that holds all tells nothing"


def _true_background(found: dict[str, Any], folder: Path) -> None:
    """Count the events at the pair of offsets that was found: another recording, of more pixels."""
    tuning = found["tuning"]
    assert 0 < tuning["on_offset"] < 17
    assert 0 <= tuning["off_offset"] < 20
    assert tuning["theta_on"] == pytest.approx(tuning["theta_off"], rel=0.01)
    assert tuning["rate"]["value"] <= TARGET_HZ
    pair = f"bias_diff_on: {tuning['on_offset']}, bias_diff_off: {tuning['off_offset']}, bias_refr: -20"
    loaded = parse_protocol(PAIR.replace("$pair", pair), "pair.yaml")
    again = analyze(Run.open(run_protocol(loaded, load_station("simulated"), folder / "pair").folder))
    counted = sum(row.events for row in again.background)
    rate = counted / again.background[0].pixel_seconds
    assert counted > 100
    # The interval is that of the counts; what lies between the measured pairs is known to a third.
    assert tuning["rate"]["low"] / 1.3 < rate < tuning["rate"]["high"] * 1.3


def test_a_run_without_swept_biases_is_refused_in_words(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = PAIR.replace("$pair", "bias_refr: -20").replace("duration_s: 20", "duration_s: 0.1")
    run = run_protocol(parse_protocol(text, "few.yaml"), load_station("simulated"), tmp_path / "run").folder
    assert cli.run(["calibrate-biases", str(run)]) == 1
    error = capsys.readouterr().err
    assert "no bias was swept; take a run of the protocol bias_calibration" in error
    assert "theta_on: the run has no reset and test pulses at several offsets of bias_diff_on" in error


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--write"], "--write needs --station FILE"),
        (["--write", "--station", "simulated"], "simulated comes with the bench and is not written"),
        (["--station", "no_such_station"], "there is no station 'no_such_station'"),
        (["--target-background", "0"], "Invalid value for '--target-background'"),
        ([], "there is no such run folder"),
    ],
)
def test_bad_input_is_one_line(options: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["calibrate-biases", "no_such_run", *options]) == 1
    error = capsys.readouterr().err
    assert message in error
    assert len(error.splitlines()) == 1
