"""A new calibration of the light in a station file: what belongs there, and writing it without touching the rest."""

from __future__ import annotations

import datetime
import io
from dataclasses import dataclass
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any, Final

from bench.station.loading import load_station
from bench.station.rewriting import rewrite, round_trip
from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from bench.photometry.meter import MeterCalibration

__all__ = ["NewLight", "OfStation", "new_light", "of_station", "write_light", "yaml_text"]

_DIGITS: Final = 5  #: of a measured number
_UNCERTAINTY_DIGITS: Final = 2
#: New keys are put beside the first of these that is there.
_ANCHORS: Final = ("date", "lux_per_level", "transmission", "unit", "nd_od")


@dataclass(frozen=True, slots=True)
class OfStation:
    """What a station file says of its light before it is calibrated."""

    unit: str  #: of the level
    nd_od: Mapping[str, float]  #: nominal optical density of each filter
    clear_name: str | None  #: of the filter of density 0
    clear_transmission: float  #: of that; 1 where there is none


@dataclass(frozen=True, slots=True)
class NewLight:
    """Values of the keys that change, below ``calibration``."""

    light: dict[str, Any]
    filters: dict[str, dict[str, Any]]


def of_station(station: str | Path) -> OfStation:
    """Return what a shipped station or a station file says of its light.

    Raises
    ------
    InputError
        There is no such station, or with everything that is wrong in the file.
    """
    plan = load_station(station).resolved["calibration"]
    nd_od = {name: section["nd_od"] for name, section in plan["filters"].items()}
    clear = next((name for name, od in nd_od.items() if od == 0.0), None)
    transmission = 1.0 if clear is None else plan["filters"][clear]["transmission"]
    return OfStation(plan["light"]["unit"], nd_od, clear, transmission)


def new_light(found: MeterCalibration, station: OfStation, date: datetime.date) -> NewLight:
    """Return what belongs into a station file.

    A clear position that takes some of the light (its transmission is not 1) was in the path of all readings: lux per
    level is that without it.

    Raises
    ------
    InputError
        A filter is not one of the station, or lets more than all of the light through.
    """
    clear = station.clear_transmission
    slope = found.lux_per_level
    filters = {}
    for line in found.filters:
        _known_filter(line.filter_name, station)
        measured = found.transmission(line)
        if measured.value * clear > 1.0:
            raise InputError(
                f"filter {line.filter_name}: a transmission of {measured.value * clear:.4g} is above 1; are its "
                "readings and those without a filter mixed up?"
            )
        filters[line.filter_name] = {
            "transmission": _rounded(measured.value * clear, _DIGITS),
            "date": date,
            "uncertainty": _rounded(measured.sd / measured.value, _UNCERTAINTY_DIGITS),
        }
    light = {
        "lux_per_level": _rounded(slope.value / clear, _DIGITS),
        "date": date,
        "uncertainty": _rounded(slope.sd / slope.value, _UNCERTAINTY_DIGITS),
    }
    return NewLight(light, filters)


def _known_filter(name: str, station: OfStation) -> None:
    if name in station.nd_od:
        return
    close = get_close_matches(name, list(station.nd_od), n=1)
    hint = f"did you mean {close[0]!r}?" if close else f"it has {', '.join(station.nd_od)}"
    raise InputError(f"there is no filter {name!r} in the station; {hint}")


def _rounded(value: float, digits: int) -> float:
    return float(f"{value:.{digits}g}")


def yaml_text(new: NewLight) -> str:
    """Return what belongs below ``calibration:``, as YAML."""
    yaml = round_trip()
    out = io.StringIO()
    light, filters = _owned(new.light), {name: _owned(values) for name, values in new.filters.items()}
    yaml.dump({"light": light, **({"filters": filters} if filters else {})}, out)
    return out.getvalue()


def write_light(path: Path, new: NewLight) -> Path:
    """Change a station file, and return the name of the copy of what it was.

    Comments, order and all other values stay. The file is there in full at any moment, the old one or the new one.

    Raises
    ------
    InputError
        It is a shipped station, it cannot be written, or it would no longer be what it was in everything else.
    """

    def change(document: Any) -> None:
        _set(document["calibration"]["light"], new.light)
        for name, values in new.filters.items():
            _set(document["calibration"]["filters"][name], values)

    return rewrite(path, change, lambda old: _wanted(old, new))


def _set(section: Any, values: Mapping[str, Any]) -> None:
    """Set the values of a section. A new key comes before what stands below the section, comments included."""
    for key, value in values.items():
        if key in section:
            section[key] = _own(value)
            continue
        keys = list(section)
        anchor = next(keys.index(name) for name in _ANCHORS if name in keys)
        last = anchor == len(keys) - 1 and not section.fa.flow_style()
        section.insert(anchor if last else anchor + 1, key, _own(value))


def _owned(values: Mapping[str, Any]) -> dict[str, Any]:
    return {key: _own(value) for key, value in values.items()}


def _own(value: Any) -> Any:
    """Return a date as an object of its own: of one that stands in two places YAML writes an anchor and an alias."""
    return value.replace() if isinstance(value, datetime.date) else value


def _wanted(old: Any, new: NewLight) -> Any:
    """Return the values of a station file as they should be now."""
    calibration = dict(old["calibration"])
    calibration["light"] = {**calibration["light"], **_as_read(new.light)}
    calibration["filters"] = {
        name: {**section, **_as_read(new.filters.get(name, {}))} for name, section in calibration["filters"].items()
    }
    return {**old, "calibration": calibration}


def _as_read(values: Mapping[str, Any]) -> dict[str, Any]:
    return {key: str(value) if isinstance(value, datetime.date) else value for key, value in values.items()}
