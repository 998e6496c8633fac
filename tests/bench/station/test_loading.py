"""Station files: what is accepted, and what is said about the rest."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

import pytest
import yaml

from bench.station import load_station, station_from, stations
from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from tests.bench.station.conftest import Diary


def problems(path: Path) -> list[str]:
    """Return what is wrong with a station file, without the folder it lies in."""
    with pytest.raises(InputError) as caught:
        load_station(str(path))
    return [str(problem).removeprefix(f"{path.parent}/") for problem in caught.value.problems]


def test_a_lab_of_its_own_is_loaded(write: Callable[..., Path]) -> None:
    station = load_station(str(write({"roles/light/args": {"secret": "$clock"}})))
    assert station.name == "lab"
    assert station.light.name == "lamp"
    assert vars(station.light)["secret"] is station.clock
    assert (station.sensor.width, station.sensor.photons_per_lux) == (64, 1.12e16)
    assert not station.light.connected


def test_unknown_station_names_the_nearest() -> None:
    with pytest.raises(InputError, match=r"no station 'simulatd'.*did you mean 'simulated'"):
        load_station("simulatd")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format": "evs-bench-station/9"}, "lab.yaml:1:9: format: "),
        ({"nmae": "x"}, "unknown key, did you mean 'name'?"),
        ({"roles/light/arguments": {}}, "roles.light.arguments: unknown key"),
        ({"roles/camera": None}, "key 'camera' is missing"),
        ({"sensor/quantum_efficiency": 1.5}, "sensor.quantum_efficiency: "),
        ({"sensor/width": "64"}, "sensor.width: "),
        ({"calibration/light/lux_per_level": None}, "lux_per_level is missing"),
        ({"calibration/light/lux_per_level": -1.0}, "calibration.light.lux_per_level: "),
        ({"calibration/light/geometry": {"kind": "mirror"}}, "calibration.light.geometry.kind: "),
        ({"calibration/filters/grey/nd_od": 0.0}, "filter none has optical density 0 too"),
        ({"calibration/filters/grey/transmission": 1.2}, "calibration.filters.grey.transmission: "),
        ({"calibration/bias_map/theta": {}}, "calibration.bias_map.theta: unknown key"),
        ({"calibration/bias_map/theta_on/calibrated": None}, "key 'calibrated' is missing"),
        ({"calibration/bias_map/theta_on/table": [[0, 0.1]]}, "calibration.bias_map.theta_on.table: "),
        (
            {"calibration/bias_map/theta_on/table": [[0, 0.1], [0, 0.2]]},
            "table[1][0]: offset 0 does not ascend from 0",
        ),
        (
            {"calibration/bias_map/theta_on/table": [[0, 0.1], [1, 0.3], [2, 0.2]]},
            "table[2][1]: value 0.2 does not rise from 0.3",
        ),
        ({"calibration/bias_map/theta_on/table": [[0, 0.2], [1, 0.0]]}, "table[1][1]: value 0 must be above 0"),
        ({"calibration/bias_map/theta_on/table": [[0.5, 0.2], [1, 0.3]]}, "table[0][0]: "),
        ({"world/class": "not a path"}, "world.class: "),
        # What only the drivers know.
        (
            {"roles/light/driver": "lab_of_tests:Lmap"},
            "roles.light.driver: module lab_of_tests has no 'Lmap', did you",
        ),
        ({"roles/light/driver": "no_such_package.x:Y"}, "roles.light.driver: cannot import 'no_such_package.x'"),
        (
            {"roles/light/driver": "rs7"},
            "roles.light.driver: there is no driver 'rs7'; expected package.module:Class",
        ),
        ({"roles/light/driver": "lab_of_tests:Wheel"}, "roles.light.driver: lab_of_tests:Wheel is no LightSource"),
        ({"roles/clock/driver": "lab_of_tests:Wheel"}, "is no clock: it needs now and sleep"),
        ({"roles/clock/driver": "math:pi"}, "roles.clock.driver: math:pi is no class"),
        ({"roles/light/args": {"highst": 5.0}}, "roles.light.args.highst: unknown argument, did you mean 'highest'?"),
        (
            {"roles/light/args": {"secret": "$wrld"}},
            "roles.light.args.secret: $wrld stands for nothing; known are $w",
        ),
        (
            {"roles/light/args": {"secret": "$world"}},
            "roles.light.args: $world is named, but the station has no world",
        ),
        (
            {"roles/light/driver": "sim_backend.devices.light:SimulatedLightSource"},
            "missing for SimulatedLightSource: world, lowest, highest, unit",
        ),
        (
            {"world/class": "sim_backend.world:OpticalBench"},
            "world.args: missing for OpticalBench: lux_per_level, pixel, sensor_seed",
        ),
        (
            {"calibration/light/unit": "percent"},
            "calibration.light.unit: 'percent' is not the unit of lamp, which is",
        ),
        ({"calibration/filters/grey": None}, "calibration.filters: filter 'grey' of wheel is not calibrated"),
        (
            {"calibration/filters/dark": {"nd_od": 4.0, "transmission": 1e-4}},
            "calibration.filters.dark: wheel has no such filter; it has none, grey",
        ),
        ({"calibration/filters/grey/nd_od": 2.5}, "nd_od: 2.5 is not the optical density that wheel has there, 2"),
        ({"sensor/height": 40}, "sensor.width: 64 x 40 pixels, but camera has 64 x 48"),
        ({"calibration/bias_map/theta_on/bias": "bias_c"}, "theta_on.bias: camera has no 'bias_c'; it has bias_a"),
    ],
)
def test_mistakes_are_told_in_one_line_with_their_place(
    write: Callable[..., Path], changes: dict[str, Any], message: str
) -> None:
    found = problems(write(changes))
    assert len(found) == 1, found
    assert message in found[0]
    assert found[0].startswith("lab.yaml:")
    line, column = found[0].split(":")[1:3]
    assert int(line) >= 1
    assert int(column) >= 1


def test_place_is_that_of_the_key(write: Callable[..., Path]) -> None:
    file = write({"roles/light/args": {"highest": 5.0, "secrt": 1}})
    lines = file.read_text().splitlines()
    (found,) = problems(file)
    line, column = (int(part) for part in found.split(":")[1:3])
    assert lines[line - 1][column - 1 :].startswith("secrt:")


def test_five_mistakes_are_five_lines(write: Callable[..., Path]) -> None:
    found = problems(
        write(
            {
                "nmae": "x",
                "sensor/width": -1,
                "roles/light/args": [],
                "calibration/light/uncertainty": -0.1,
                "calibration/filters/grey/transmission": 0,
            }
        )
    )
    assert len(found) == 5
    places = [int(line.split(":")[1]) for line in found]
    assert places == sorted(places)


def test_wrong_arguments_of_all_roles_are_told_at_once(write: Callable[..., Path]) -> None:
    found = problems(
        write(
            {"roles/light/args": {"a": 1}, "roles/wheel/args": {"b": 1}, "roles/camera/driver": "lab_of_tests:None"}
        )
    )
    assert len(found) == 3


def test_values_that_a_driver_refuses_are_told_with_their_place(write: Callable[..., Path]) -> None:
    simulated = load_station("simulated").resolved
    simulated["world"]["args"]["lux_per_level"] = -1.0
    with pytest.raises(InputError, match=r"run.yaml:\d+:\d+: world.args: optical bench: lux_per_level is -1.0"):
        station_from(simulated, "run.yaml")


def test_a_value_of_the_wrong_type_is_the_users_mistake(write: Callable[..., Path]) -> None:
    simulated = load_station("simulated").resolved
    simulated["roles"]["light"]["args"]["lowest"] = "twenty"
    with pytest.raises(InputError, match=r"roles.light.args: SimulatedLightSource cannot be made of them"):
        station_from(simulated, "run.yaml")


def test_entry_points_are_drivers(write: Callable[..., Path], monkeypatch: pytest.MonkeyPatch) -> None:
    from importlib.metadata import EntryPoint

    lamp = EntryPoint("my_lamp", "lab_of_tests:Lamp", "evs_bench.drivers")
    broken = EntryPoint("broken_lamp", "no_such_package:Lamp", "evs_bench.drivers")
    monkeypatch.setattr("bench.station.drivers.entry_points", lambda **_: [lamp, broken])
    assert load_station(str(write({"roles/light/driver": "my_lamp"}))).light.name == "lamp"
    assert "no driver 'my_lmap', did you mean 'my_lamp'?" in problems(write({"roles/light/driver": "my_lmap"}))[0]
    assert "driver 'broken_lamp' cannot be imported" in problems(write({"roles/light/driver": "broken_lamp"}))[0]


def test_resolved_station_makes_the_same_station(write: Callable[..., Path]) -> None:
    for name in (*stations(), str(write({"calibration/light/date": "2026-11-20"}))):
        resolved = load_station(name).resolved
        assert station_from(resolved, "run.yaml").resolved == resolved


def test_loading_needs_no_simulation_where_there_is_none(write: Callable[..., Path], diary: Diary) -> None:
    import subprocess

    code = (
        "import sys\nfrom bench.station import load_station\n"
        "load_station('simulated')\n"
        "print('numba' in sys.modules, 'h5py' in sys.modules, 'matplotlib' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split()[0] == "False"


@pytest.mark.parametrize("place", ["world", "roles/light", "roles/wheel", "roles/camera", "roles/clock"])
@pytest.mark.parametrize("code", ["subprocess:Popen", "os:system"])
def test_a_class_that_does_not_declare_itself_is_not_called(
    write: Callable[..., Path], tmp_path: Path, place: str, code: str
) -> None:
    touched = tmp_path / "touched"
    key = "class" if place == "world" else "driver"
    path = write({place: {key: code, "args": {"args": ["touch", str(touched)]}}})
    assert any(code in problem and " is no " in problem for problem in problems(path))
    with pytest.raises(InputError, match=" is no "):  # as a run is taken again
        station_from(yaml.safe_load(path.read_text()), "run.yaml")
    assert not touched.exists()
