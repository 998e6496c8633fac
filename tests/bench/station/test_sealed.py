"""Sealed files, and stations whose world is in one."""

from __future__ import annotations

import base64
import hashlib
import json
import zlib
from typing import TYPE_CHECKING, Any

import pytest
import yaml

from bench.station import load_station, station_from
from bench.station.sealed import open_world, seal
from protocols.errors import InputError

if TYPE_CHECKING:
    from pathlib import Path

WORLD = {"class": "sim_backend.world:OpticalBench", "args": {"sensor_seed": 7, "leak": 0.123}}
SEALED = seal(WORLD)


def sealed(tmp_path: Path, data: bytes) -> Path:
    path = tmp_path / "sealed.bin"
    path.write_bytes(data)
    return path


def test_what_is_sealed_comes_back_and_cannot_be_read_by_accident(tmp_path: Path) -> None:
    data = seal(WORLD)
    assert data == seal(dict(reversed(WORLD.items())))
    assert not any(word in data for word in (b"sensor_seed", b"leak", b"0.123", b"OpticalBench"))
    assert open_world(sealed(tmp_path, data)).model_dump(by_alias=True) == {**WORLD, "bias_map": None}


def packed(text: bytes, version: int = 1) -> bytes:
    body = zlib.compress(text)
    return f"evs-bench-sealed/{version}\n{hashlib.sha256(body).hexdigest()}\n".encode() + base64.encodebytes(body)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "is no sealed file"),
        (b"format: evs-bench-station/1\n", "is no sealed file"),
        (packed(json.dumps(WORLD).encode(), version=2), "is of the format evs-bench-sealed/2; this version reads"),
        (SEALED[:100] + bytes([SEALED[100] ^ 1]) + SEALED[101:], "is damaged"),
        (seal(WORLD)[:-20], "is damaged"),
        (packed(b"no JSON"), "is damaged"),
        (packed(json.dumps({"leak": 0.123}).encode()), "holds no station that this version reads"),
        (packed(b'"' + bytes(1 << 21) + b'"'), "is damaged"),
    ],
)
def test_a_file_that_cannot_be_opened_is_one_line_that_tells_nothing(
    tmp_path: Path, data: bytes, message: str
) -> None:
    with pytest.raises(InputError, match=message) as caught:
        open_world(sealed(tmp_path, data))
    (problem,) = caught.value.problems
    assert "leak" not in str(problem)
    assert "0.123" not in str(problem)


def blind(tmp_path: Path, **changes: Any) -> Path:
    """Write the station `simulated` with its world sealed."""
    plan = load_station("simulated").resolved
    world = plan.pop("world")
    (tmp_path / "sealed.bin").write_bytes(seal(world))
    path = tmp_path / "station.yaml"
    path.write_text(yaml.safe_dump({**plan, "sealed_world": "sealed.bin", **changes}, sort_keys=False))
    return path


def test_a_blind_station_is_the_same_station_and_only_its_name_is_recorded(tmp_path: Path) -> None:
    station = load_station(blind(tmp_path))
    assert station.recorded == {"name": "simulated"}
    assert station.resolved == load_station("simulated").resolved
    assert station_from(station.resolved, "a worker").resolved == station.resolved
    seeing = load_station("simulated")
    assert seeing.recorded == seeing.resolved


def test_what_is_no_blind_station_is_said(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="there is a world beside it"):
        load_station(blind(tmp_path, world=WORLD))
    with pytest.raises(InputError, match=r"nothing\.bin: cannot be read"):
        load_station(blind(tmp_path, sealed_world="nothing.bin"))
    with pytest.raises(InputError, match=r"run\.yaml: .* a blind station, .* name its file with --station"):
        station_from({"name": "x"}, "run.yaml")
    with pytest.raises(InputError, match="only a station file can name one"):
        station_from(yaml.safe_load(blind(tmp_path).read_text()), "run.yaml")


def test_true_biases_may_differ_from_the_calibration(tmp_path: Path) -> None:
    plan = load_station("simulated").resolved
    curve = plan["calibration"]["bias_map"]["refractory_s"]
    plan["world"]["bias_map"] = {"refractory_s": {**curve, "table": [[o, 2 * v] for o, v in curve["table"]]}}
    plan["roles"]["camera"]["args"]["bias_behaviour"] = "$true_bias_map"
    with station_from(plan, "run.yaml") as station:
        station.connect()
        believed = station.calibration.settings_at({})["refractory_s"]
        assert station.camera.refractory_s() == pytest.approx(2 * believed)
