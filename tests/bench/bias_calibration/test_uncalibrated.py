"""A run that goes through bias curves which nobody measured on this sensor is warned of."""

from __future__ import annotations

from importlib.resources import files
from typing import TYPE_CHECKING

from bench import cli
from bench.run import check
from bench.station import load_station
from protocols import parse_protocol

if TYPE_CHECKING:
    from pathlib import Path

    import pytest

SHIPPED = files("bench").joinpath("stations", "simulated.yaml").read_text(encoding="utf-8")
PROTOCOL = """\
format: evs-bench-protocol/1
title: t
roi: {x: 0, y: 0, width: 2, height: 2}
measurements:
  - name: physical
    settings: {thresholds: {on: 0.3, off: 0.25}, bandwidth_hz: 200}
    stimulus: &dark {kind: constant, duration_s: 0.1}
    sweep: {illuminance_lux: [10, 100]}
  - name: raw
    settings: {biases: {bias_diff_on: 10}}
    stimulus: *dark
    sweep: {illuminance_lux: 100}
"""


def _uncalibrated(station: Path, *biases: str) -> None:
    text = SHIPPED
    for bias in biases:
        head, name, rest = text.partition(f"bias: {bias}\n")
        text = head + name + rest.replace("calibrated: true", "calibrated: false", 1)
    station.write_text(text, encoding="utf-8")


def test_check_names_what_was_not_measured(tmp_path: Path) -> None:
    station = tmp_path / "bench.yaml"
    loaded = parse_protocol(PROTOCOL, "t.yaml").protocol
    _uncalibrated(station, "bias_diff_off", "bias_fo", "bias_refr")
    (finding,) = check(loaded, load_station(station)).findings
    assert (finding.severity, finding.kind, finding.measurement) == ("warning", "settings_not_calibrated", "physical")
    assert finding.points == (0, 1)
    assert finding.message.startswith("theta_off and bandwidth_hz: set through the station's bias map, which was not")
    _uncalibrated(station)
    assert check(loaded, load_station(station)).findings == ()


def test_a_run_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _uncalibrated(tmp_path / "bench.yaml", "bias_diff_on")
    (tmp_path / "t.yaml").write_text(PROTOCOL)
    arguments = ["run", str(tmp_path / "t.yaml"), "--station", str(tmp_path / "bench.yaml")]
    assert cli.run([*arguments, "--out", str(tmp_path / "run")]) == 0
    assert "warning: physical, points 0-1: theta_on: set through the station's bias map" in capsys.readouterr().err
