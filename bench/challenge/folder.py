"""The folder of a challenge: a station file for the operator, and beside it the sealed world."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from bench.challenge.draw import draw
from bench.challenge.truth import Truth
from bench.station.loading import load_station
from bench.station.schema import StationFile
from bench.station.sealed import SEALED_FILE, digest, open_world, seal
from protocols.errors import InputError
from protocols.files import read_model

if TYPE_CHECKING:
    from pathlib import Path

    from bench.challenge.draw import Draw, Level

__all__ = ["STATION_FILE", "make_challenge", "read_truth"]

STATION_FILE: Final = "station.yaml"
#: What a blind station has in common with this one: instruments, calibration, and what its biases are believed to do.
_LIKE: Final = "simulated_ideal"
_HEAD: Final = f"""\
# A blind station: light, filters and calibration are as they stand here, what the pixel is stands in {SEALED_FILE}.
# The bias map is that of a data sheet, not of this sensor: its biases move in the same way, from other values.
"""
#: Which number of the pixel a quantity of the bias map is.
_OF_A_BIAS: Final = {
    "theta_on": "theta_on",
    "theta_off": "theta_off",
    "refractory_s": "refractory_s",
    "bandwidth_hz": "corner_hz",
}


def make_challenge(
    seed: int,
    level: Level = "medium",
    effects_count: int | None = None,
    out: Path | None = None,
    *,
    may_be_nothing: bool = False,
) -> Path:
    """Make the folder of a challenge and return it; see :func:`~bench.challenge.draw.draw` for what is in it.

    Parameters
    ----------
    out
        The folder to make; default is the name of the station, here. It must not exist.

    Raises
    ------
    InputError
        The folder is there already, or cannot be written.
    """
    from pathlib import Path

    import yaml

    common = load_station(_LIKE).resolved
    world = _world(common, draw(seed, level, effects_count, may_be_nothing=may_be_nothing))
    name = f"blind-{digest(world)[:8]}"  # tells challenges apart, and nothing of what is in them
    folder = out or Path(name)
    text = _HEAD + yaml.safe_dump(_station(common, name), sort_keys=False, allow_unicode=True)
    try:
        folder.mkdir(parents=True)
        (folder / SEALED_FILE).write_bytes(seal(world))
        (folder / STATION_FILE).write_text(text, encoding="utf-8")
    except FileExistsError:
        raise InputError(f"{folder}: exists already; choose another folder with --out") from None
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror}") from None
    return folder


def read_truth(folder: Path) -> Truth:
    """Return what the station of a challenge really is.

    Raises
    ------
    InputError
        `folder` holds no challenge, or the sealed file is damaged.
    """
    path = folder / STATION_FILE
    station = read_model(path, StationFile)
    if station.sealed_world is None:
        raise InputError(f"{path}: is no blind station; make one with: evs-bench challenge new")
    return Truth.of(station.name, open_world(folder / station.sealed_world))


def _world(common: dict[str, Any], drawn: Draw) -> dict[str, Any]:
    """Return the world that was drawn, as a station file would have it."""
    world: dict[str, Any] = common["world"]
    pixel = {**world["args"]["pixel"], "noise_rms": drawn.base["noise_rms"], "effects": drawn.effects}
    curves = common["calibration"]["bias_map"]
    return {
        "class": world["class"],
        "args": {**world["args"], "sensor_seed": drawn.sensor_seed, "pixel": pixel},
        "bias_map": {q: _moved(curve, drawn.base[_OF_A_BIAS[q]]) for q, curve in curves.items()},
    }


def _moved(curve: dict[str, Any], at_factory: float) -> dict[str, Any]:
    """Return a bias curve that has this value at offset 0, and the same shape."""
    factor = at_factory / dict(map(tuple, curve["table"]))[0]
    return {**curve, "table": [[o, at_factory if o == 0 else value * factor] for o, value in curve["table"]]}


def _station(common: dict[str, Any], name: str) -> dict[str, Any]:
    """Return the station as its operator knows it."""
    station = {key: value for key, value in common.items() if key != "world"}
    calibration = station["calibration"]
    roles = station["roles"]
    camera = {**roles["camera"], "args": {**roles["camera"]["args"], "bias_behaviour": "$true_bias_map"}}
    believed = {q: {**curve, "calibrated": False} for q, curve in calibration["bias_map"].items()}
    return {
        **station,
        "name": name,
        "description": "Blind station: a simulated sensor of which nobody is told what it is",
        "sealed_world": SEALED_FILE,
        "roles": {**roles, "camera": camera},
        "sensor": {**station["sensor"], "name": "simulated sensor, unknown"},
        "calibration": {**calibration, "bias_map": believed},
    }
