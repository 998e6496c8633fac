"""A new calibration of the light in a station file: what belongs there, and writing it without touching the rest."""

from __future__ import annotations

import datetime
import io
from dataclasses import dataclass
from difflib import get_close_matches
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from bench.station.loading import load_station, parse_station, stations
from bench.station.schema import StationFile
from bench.store.durable import sync_file, write_whole
from protocols.errors import InputError, Problem
from protocols.files import parse_model, read_text
from protocols.yaml_strict import read_yaml

if TYPE_CHECKING:
    from collections.abc import Mapping

    from bench.photometry.meter import MeterCalibration

__all__ = ["NewLight", "OfStation", "new_light", "of_station", "refuse_shipped", "write_light", "yaml_text"]

_WIDTH: Final = 100_000  #: no line is broken
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
    yaml = _round_trip()
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
    refuse_shipped(path)
    text = _changed(read_text(path), new, str(path))
    parse_station(text, str(path), path.parent)
    kept: Path | None = None
    try:
        kept = _keep(path)
        write_whole(path.resolve(), text, ".part")  # a link stays one
    except OSError as error:
        if kept is not None:
            kept.unlink()
        raise InputError(f"{path} cannot be written: {error.strerror}") from None
    return kept


def refuse_shipped(path: str | Path) -> None:
    """Raise where `path` is a station that comes with the bench.

    Raises
    ------
    InputError
        It is one.
    """
    folder = files("bench").joinpath("stations")
    shipped = str(path) in stations() or Path(path).resolve().parent == Path(str(folder)).resolve()
    if shipped:
        raise InputError(f"{path} comes with the bench and is not written: copy it first, and name the copy")


def _keep(path: Path) -> Path:
    """Copy a file beside itself, under a name that no file has yet."""
    data = path.read_bytes()
    number = 1
    while True:
        kept = path.with_name(f"{path.stem}.before{'' if number == 1 else f'-{number}'}{path.suffix}")
        try:
            with kept.open("xb") as file:
                file.write(data)
        except FileExistsError:
            number += 1
            continue
        sync_file(kept)
        return kept


def _changed(old: str, new: NewLight, source: str) -> str:
    """Return the text of a station file with the new values, and make sure that nothing else became another value."""
    from ruamel.yaml.error import YAMLError
    from ruamel.yaml.util import load_yaml_guess_indent

    parse_model(old, StationFile, source)  # says what is wrong with a file that is none, with its place
    try:
        _, sequence, offset = load_yaml_guess_indent(old)
        yaml = _round_trip(sequence or 4, offset if offset is not None else 2)
        document = yaml.load(old)
        calibration = document["calibration"]
        _set(calibration["light"], new.light)
        for name, values in new.filters.items():
            _set(calibration["filters"][name], values)
        out = io.StringIO()
        yaml.dump(document, out)
    except YAMLError as error:
        raise InputError(Problem(f"cannot be changed: {' '.join(str(error).split())}", source)) from None
    text = out.getvalue()
    if read_yaml(text, source).value != _wanted(read_yaml(old, source).value, new):
        raise InputError(Problem("cannot be changed without changing other values; change it by hand", source))
    return text.replace("\n", "\r\n") if "\r\n" in old else text


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


def _round_trip(sequence: int = 4, offset: int = 2) -> Any:
    from ruamel.yaml import YAML

    yaml = YAML()
    yaml.preserve_quotes = True
    yaml.width = _WIDTH
    yaml.indent(mapping=2, sequence=sequence, offset=offset)
    return yaml
