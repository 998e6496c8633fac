"""A new bias map in a station file: what belongs there, and writing it without touching the rest."""

from __future__ import annotations

import datetime
import io
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from bench.station.loading import load_station
from bench.station.rewriting import flow_rows, rewrite, round_trip
from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from bench.bias_calibration.calibrate import BiasCalibration
    from bench.bias_calibration.table import BiasTable

__all__ = ["NewBiasMap", "OfStation", "new_bias_map", "of_station", "write_bias_map", "yaml_text"]

_UNCERTAINTY_DIGITS: Final = 2


@dataclass(frozen=True, slots=True)
class OfStation:
    """What a station says of its biases and its light before they are calibrated."""

    biases: Mapping[str, str]  #: which sets which quantity, as far as its bias map says
    scales: Mapping[str, str]  #: of the curves that it has
    light_edge_s: float  #: 10 % to 90 %
    map_is_the_truth: bool  #: a simulated station whose camera does what the bias map says, right or wrong


@dataclass(frozen=True, slots=True)
class NewBiasMap:
    """The sections that change below ``calibration.bias_map``, by quantity: their keys and values."""

    curves: dict[str, dict[str, Any]]


def of_station(station: str | Path) -> OfStation:
    """Return what a shipped station or a station file says of its biases and its light.

    Raises
    ------
    InputError
        There is no such station, or with everything that is wrong in the file.
    """
    loaded = load_station(station)
    curves = loaded.calibration.bias_map.curves
    camera = loaded.resolved["roles"]["camera"]["args"] if "roles" in loaded.resolved else {}
    return OfStation(
        biases={curve.quantity: curve.bias for curve in curves},
        scales={curve.quantity: curve.scale for curve in curves},
        light_edge_s=loaded.light.edge_time_s,
        map_is_the_truth="$bias_map" in camera.values(),
    )


def new_bias_map(found: BiasCalibration, station: OfStation | None, date: datetime.date) -> NewBiasMap:
    """Return what belongs into a station file; a curve that the station has keeps its scale.

    Raises
    ------
    InputError
        No quantity has a curve.
    """
    if not found.usable:
        raise InputError(f"{found.run_id}: no quantity has a curve", *found.remarks)
    scales = {} if station is None else station.scales
    return NewBiasMap(
        {table.quantity: _section(table, scales.get(table.quantity, "log"), date) for table in found.usable}
    )


def _section(table: BiasTable, scale: str, date: datetime.date) -> dict[str, Any]:
    return {
        "bias": table.bias,
        "scale": scale,
        "calibrated": True,
        "date": date,
        "uncertainty": [float(f"{row.sd:.{_UNCERTAINTY_DIGITS}g}") for row in table.rows],
        "table": [[row.offset, row.value] for row in table.rows],
    }


def yaml_text(new: NewBiasMap) -> str:
    """Return what belongs below ``calibration:``, as YAML."""
    out = io.StringIO()
    sections = {quantity: _for_yaml(values) for quantity, values in new.curves.items()}
    round_trip().dump({"bias_map": sections}, out)
    return out.getvalue()


def _for_yaml(values: Mapping[str, Any]) -> dict[str, Any]:
    return {key: _own(value) for key, value in values.items()}


def _own(value: Any) -> Any:
    """Return a date or a list as an object of its own, with lists of numbers in one line."""
    if isinstance(value, datetime.date):
        return value.replace()
    return flow_rows(value) if isinstance(value, list) else value


def write_bias_map(path: Path, new: NewBiasMap) -> Path:
    """Change a station file, and return the name of the copy of what it was.

    Comments, order and all other values stay; curves that were not measured stay as they are.

    Raises
    ------
    InputError
        It is a shipped station, it cannot be written, or it would no longer be what it was in everything else.
    """

    def change(document: Any) -> None:
        calibration = document["calibration"]
        if calibration.get("bias_map") is None:
            calibration["bias_map"] = {}
        for quantity, values in new.curves.items():
            _set(calibration["bias_map"], quantity, values)

    def wanted(old: Any) -> Any:
        calibration = dict(old["calibration"])
        before = calibration.get("bias_map") or {}
        calibration["bias_map"] = {
            **before,
            **{quantity: {**before.get(quantity, {}), **_as_read(values)} for quantity, values in new.curves.items()},
        }
        return {**old, "calibration": calibration}

    return rewrite(path, change, wanted)


def _set(bias_map: Any, quantity: str, values: Mapping[str, Any]) -> None:
    """Set one curve; new keys come before its table, behind which the comments of the next section stand."""
    if quantity not in bias_map:
        bias_map[quantity] = _for_yaml(values)
        return
    section = bias_map[quantity]
    for key, value in values.items():
        if key == "table":
            _replace_rows(section["table"], value)
        elif key in section:
            section[key] = _own(value)
        else:
            section.insert(list(section).index("table"), key, _own(value))


def _replace_rows(table: Any, rows: list[list[Any]]) -> None:
    """Replace the rows of a table in place, so that what is written around them stays."""
    behind = table.ca.items.get(len(table) - 1)
    while len(table):
        del table[-1]
    table.ca.items.clear()  # remarks on rows that are gone
    table.extend(flow_rows(rows))
    if behind is not None:
        table.ca.items[len(table) - 1] = behind


def _as_read(values: Mapping[str, Any]) -> dict[str, Any]:
    return {key: str(value) if isinstance(value, datetime.date) else value for key, value in values.items()}
