"""A bias map on its way into a station file."""

from __future__ import annotations

import datetime
import difflib
from importlib.resources import files
from typing import TYPE_CHECKING

import pytest
import yaml

from bench.bias_calibration.calibrate import BiasCalibration
from bench.bias_calibration.station_map import NewBiasMap, new_bias_map, of_station, write_bias_map, yaml_text
from bench.bias_calibration.table import Row, make_table
from bench.station import load_station
from protocols.errors import InputError

if TYPE_CHECKING:
    from pathlib import Path

DATE = datetime.date(2026, 12, 1)
SHIPPED = files("bench").joinpath("stations", "simulated.yaml").read_text(encoding="utf-8")
DEAD_TIME = make_table("refractory_s", "bias_refr", [Row(-20, 0.0212345678, 0.01), Row(235, 0.0001, 0.0234)])
NEW = NewBiasMap(
    {
        "refractory_s": {
            "bias": "bias_refr", "scale": "log", "calibrated": True, "date": DATE, "uncertainty": [0.01, 0.023],
            "table": [[-20, 0.021235], [235, 0.0001]],
        }
    }
)  # fmt: skip


def found(*tables: object) -> BiasCalibration:
    return BiasCalibration("a-run", "2026-12-01T10:00:00Z", tables, (), ("", ""), None, ("why not",))  # type: ignore[arg-type]


@pytest.fixture
def station(tmp_path: Path) -> Path:
    path = tmp_path / "bench.yaml"
    path.write_text(SHIPPED, encoding="utf-8")
    return path


def changes(old: str, new: str) -> list[str]:
    lines = difflib.unified_diff(old.splitlines(), new.splitlines(), n=0, lineterm="")
    return [line for line in lines if line[0] in "+-" and line[:3] not in ("+++", "---")]


def test_what_belongs_there_is_made_of_the_tables() -> None:
    assert new_bias_map(found(DEAD_TIME), None, DATE) == NEW
    with pytest.raises(InputError, match="no quantity has a curve"):
        new_bias_map(found(make_table("theta_on", "bias_diff_on", [])), None, DATE)


def test_only_the_curve_that_was_measured_is_another(station: Path) -> None:
    kept = write_bias_map(station, NEW)
    assert kept == station.with_name("bench.before.yaml")
    assert kept.read_text() == SHIPPED
    assert changes(SHIPPED, station.read_text()) == [
        "+      date: 2026-12-01",
        "+      uncertainty: [0.01, 0.023]",
        "-        - [-20, 20.0e-3]",
        "-        - [-10, 10.0e-3]",
        "-        - [0, 5.0e-3]",
        "-        - [30, 2.0e-3]",
        "-        - [60, 1.0e-3]",
        "-        - [100, 0.5e-3]",
        "-        - [160, 0.2e-3]",
        "-        - [235, 0.1e-3]",
        "+        - [-20, 0.021235]",
        "+        - [235, 0.0001]",
    ]
    curve = load_station(str(station)).calibration.bias_map.curve("refractory_s")
    assert (curve.offsets, curve.values, curve.calibrated) == ((-20, 235), (0.021235, 0.0001), True)


@pytest.mark.parametrize("last", ["[235, 0.1e-3]", "[235, 0.1e-3]  # the fastest"])
def test_comments_behind_a_table_stay(station: Path, last: str) -> None:
    old = SHIPPED.replace("    bandwidth_hz:  # Hz", "    # Of the source follower.\n    bandwidth_hz:  # Hz")
    old = old.replace("[235, 0.1e-3]", last)
    station.write_text(old)
    write_bias_map(station, NEW)
    new = station.read_text()
    row = last.replace("0.1e-3", "0.0001")
    assert f"        - {row}\n    # Of the source follower.\n    bandwidth_hz:  # Hz" in new
    assert len(changes(old, new)) == 12, "nothing but rows and keys of the curve"


def test_a_station_without_a_map_gets_one(station: Path) -> None:
    before, _, _ = SHIPPED.partition("  # Rows are [offset")
    station.write_text(before.replace("$bias_map", "$true_bias_map") + "# The end.\n")
    write_bias_map(station, NEW)
    new = station.read_text()
    assert "# The end." in new
    assert yaml.safe_load(new)["calibration"]["bias_map"]["refractory_s"]["date"] == DATE


def test_a_map_in_one_line_stays_a_station(station: Path) -> None:
    before, _, _ = SHIPPED.partition("  # Rows are [offset")
    line = "{bias: bias_refr, scale: linear, calibrated: false, table: [[-20, 0.02], [235, 0.0001]]}"
    station.write_text(f"{before}  bias_map:\n    refractory_s: {line}\n")
    assert of_station(station).scales == {"refractory_s": "linear"}
    assert load_station(str(station)).calibration.uncalibrated == (
        "theta_on", "theta_off", "refractory_s", "bandwidth_hz",
    )  # fmt: skip
    write_bias_map(station, NEW)
    assert load_station(str(station)).calibration.uncalibrated == ("theta_on", "theta_off", "bandwidth_hz")


def test_a_curve_keeps_the_scale_that_the_station_gave_it(station: Path) -> None:
    station.write_text(
        SHIPPED.replace("      bias: bias_refr\n      scale: log", "      bias: bias_refr\n      scale: linear")
    )
    new = new_bias_map(found(DEAD_TIME), of_station(station), DATE)
    assert new.curves["refractory_s"]["scale"] == "linear"


def test_a_shipped_station_is_not_written() -> None:
    from pathlib import Path

    for path in (Path("simulated"), Path(str(files("bench").joinpath("stations", "simulated.yaml")))):
        with pytest.raises(InputError, match="comes with the bench and is not written: copy it first"):
            write_bias_map(path, NEW)


def test_a_file_that_would_be_no_station_is_left_alone(station: Path) -> None:
    wrong = NewBiasMap({"refractory_s": {**NEW.curves["refractory_s"], "uncertainty": [0.01]}})
    with pytest.raises(InputError, match="uncertainty: 1 values for a table of 2 rows; expected one for each row"):
        write_bias_map(station, wrong)
    assert station.read_text() == SHIPPED
    assert [path.name for path in station.parent.iterdir()] == ["bench.yaml"]


def test_what_is_printed_is_what_would_be_written() -> None:
    printed = yaml.safe_load(yaml_text(NEW))
    assert printed == {"bias_map": NEW.curves}
    assert "      - [-20, 0.021235]\n" in yaml_text(NEW)
