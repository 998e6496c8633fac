"""`evs-bench devices` where one device of a station does not answer: the others are asked all the same."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import pytest
import yaml

from bench.cli import run
from bench.station import load_station

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


@pytest.fixture(name="station")
def station_writer(tmp_path: Path) -> Callable[[str, dict[str, Any]], str]:
    """Return a function that writes the station `wire_generator` with other arguments of one role."""

    def write(role: str, given: dict[str, Any]) -> str:
        plan: dict[str, Any] = load_station("wire_generator").resolved
        plan["roles"][role]["args"] |= given
        path = tmp_path / "bench.yaml"
        path.write_text(yaml.safe_dump(plan))
        return str(path)

    return write


def test_a_light_source_that_is_not_there_is_missing_and_the_others_answer(
    station: Callable[[str, dict[str, Any]], str], capsys: pytest.CaptureFixture[str]
) -> None:
    path = station("light", {"address": "/dev/usbtmc_none"})
    assert run(["devices", "--station", path]) == 1
    out = capsys.readouterr().out
    rows = {line.split()[0]: line for line in out.splitlines() if line}
    assert rows["light"].split()[1:] == ["missing"]
    assert "EVK4" in rows["camera"]
    assert "changed by hand" in rows["wheel"]
    assert rows["missing:"].startswith("missing: light source: open /dev/usbtmc_none: ")
    assert "is it plugged in, switched on, and nobody else's?" in rows["missing:"]


def test_programs_are_told_which_role_is_missing(
    station: Callable[[str, dict[str, Any]], str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["devices", "--json", "--station", station("light", {"dialect": "rigol"})]) == 1
    told = json.loads(capsys.readouterr().out)
    assert set(told["devices"]) == {"wheel", "camera"}
    assert set(told["missing"]) == {"light"}
    assert "this is Agilent Technologies 33521A; the dialect is for rigol; set another" in told["missing"]["light"]


def test_a_station_whose_devices_all_answer_is_no_error(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["devices", "--station", "wire_generator"]) == 0
    assert "missing" not in capsys.readouterr().out
