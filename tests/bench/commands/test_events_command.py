"""`evs-bench events`."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import h5py
import pytest
from click.testing import CliRunner

from bench.commands.events import command
from protocols.errors import InputError

if TYPE_CHECKING:
    from pathlib import Path


def invoke(*arguments: str) -> str:
    result = CliRunner().invoke(command, list(arguments), catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.stdout


@pytest.fixture
def recording(data_folder: Path) -> str:
    return str(data_folder / "recordings/gen31_640x480_triggers.evt3")


def test_json_has_every_expected_figure(recording: str, data_folder: Path) -> None:
    expected: dict[str, Any] = json.loads(
        (data_folder / "recordings/gen31_640x480_triggers.expected.json").read_text()
    )
    for options in ((), ("--chunk", "1000"), ("--size", "640x480"), ("--format", "evt3")):
        printed = json.loads(invoke(recording, "--json", *options))
        assert {key: printed[key] for key in expected} == expected
        assert printed["schema"] == "evs-bench-events/1"
        assert not any(printed["violations"].values())
        assert printed["rates_hz"]["on"] > 0


def test_table(recording: str) -> None:
    table = invoke(recording)
    for text in ("EVT3 (no header)", "640 x 480", "343474", "125183", "4157", "channels 6", "TIME_HIGH"):
        assert text in table
    assert "violations            none" in table


def test_table_names_what_is_wrong(recording: str) -> None:
    assert "x_out_of_range" in invoke(recording, "--size", "320x480")


def test_measurement_point(tmp_path: Path) -> None:
    path = tmp_path / "000000.h5"
    with h5py.File(path, "w") as file:
        file.attrs["format"] = "evs-bench-point/1"
        for name, values in (("t", [1, 5, 9]), ("x", [3, 2, 1]), ("y", [0, 7, 0]), ("p", [1, 0, 1])):
            file[f"events/{name}"] = values
        file["triggers/t"] = [2, 4]
        file["triggers/p"] = [1, 0]
    printed = json.loads(invoke(str(path), "--json"))
    figures = {key: printed[key] for key in ("format", "n_cd", "n_on", "t_first", "t_last", "sensor", "n_trigger")}
    assert figures == {
        "format": "evs-bench-point/1",
        "n_cd": 3,
        "n_on": 2,
        "t_first": 1,
        "t_last": 9,
        "sensor": [4, 8],
        "n_trigger": 2,
    }
    assert printed["trigger_rising"] == 1
    assert "violations" not in printed
    assert "evs-bench-point/1" in invoke(str(path))
    refused = CliRunner().invoke(command, [str(path), "--format", "EVT3"])
    assert refused.exit_code == 2
    assert "do not apply" in refused.output


def test_hdf5_of_another_kind(tmp_path: Path) -> None:
    path = tmp_path / "other.h5"
    with h5py.File(path, "w") as file:
        file["data"] = 1
    with pytest.raises(InputError, match="is no measurement point"):
        invoke(str(path))


@pytest.mark.parametrize("options", [("--size", "big"), ("--chunk", "0")])
def test_options_that_make_no_sense(recording: str, options: tuple[str, str]) -> None:
    result = CliRunner().invoke(command, [recording, *options])
    assert result.exit_code == 2
    assert options[0] in result.output
