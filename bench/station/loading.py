"""Stations by name or by path: from a station file to devices that are not yet connected."""

from __future__ import annotations

from difflib import get_close_matches
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from bench.station.assembly import assemble
from bench.station.schema import StationFile
from bench.station.sealed import open_world
from protocols.errors import InputError
from protocols.files import parse_model, read_text
from protocols.yaml_strict import read_yaml

if TYPE_CHECKING:
    import os
    from collections.abc import Mapping

    from bench.station.station import Station

__all__ = ["load_station", "parse_station", "station_from", "stations"]

_SUFFIX: Final = ".yaml"


def stations() -> tuple[str, ...]:
    """Return the names of the stations that come with the bench, sorted."""
    folder = files("bench").joinpath("stations")
    return tuple(sorted(f.name.removesuffix(_SUFFIX) for f in folder.iterdir() if f.name.endswith(_SUFFIX)))


def load_station(name_or_path: str | os.PathLike[str]) -> Station:
    """Return a shipped station by its name, or the station of a file by its path. Nothing is connected.

    Raises
    ------
    InputError
        There is no such station, or with everything that is wrong in the file.
    """
    name = str(name_or_path)
    if name in stations():
        shipped = files("bench").joinpath("stations", name + _SUFFIX)
        return parse_station(shipped.read_text(encoding="utf-8"), f"{name}{_SUFFIX}")
    if not Path(name_or_path).exists():
        raise InputError(_unknown(name))
    return parse_station(read_text(name_or_path), name, Path(name_or_path).parent)


def station_from(resolved: Mapping[str, Any], source: str) -> Station:
    """Return the station that :attr:`Station.resolved` describes, as a run keeps it. Nothing is connected.

    Parameters
    ----------
    resolved
        The keys of a station file; `identities` is left aside.
    source
        Where it was found, for messages.

    Raises
    ------
    InputError
        With everything that is wrong in it, or if only the name of a blind station is left.
    """
    import yaml

    if set(resolved) == {"name"}:
        raise InputError(
            f"{source}: it was taken on {resolved['name']}, a blind station, of which a run keeps only the name; "
            "name its file with --station"
        )
    data = {key: value for key, value in resolved.items() if key != "identities"}
    return parse_station(yaml.safe_dump(data, sort_keys=False, allow_unicode=True), source)


def parse_station(text: str, source: str, folder: Path | None = None) -> Station:
    """Return the station that `text` describes. Nothing is connected.

    Parameters
    ----------
    text
        A station file.
    source
        Its name, for messages.
    folder
        The folder it lies in; without one, as in a run, there is no sealed file beside it.

    Raises
    ------
    InputError
        With everything that is wrong in it.
    """
    file = parse_model(text, StationFile, source)
    blind = file.sealed_world is not None
    if file.sealed_world is not None:
        if folder is None:
            raise InputError(f"{source}: sealed_world: only a station file can name one")
        world = open_world(folder / file.sealed_world)
        file = file.model_copy(update={"world": world, "sealed_world": None})
    return assemble(file, read_yaml(text, source), source, blind=blind)


def _unknown(name: str) -> str:
    close = get_close_matches(name, stations(), n=1)
    hint = f"did you mean {close[0]!r}?" if close else f"shipped are {', '.join(stations())}"
    return f"there is no station {name!r}: neither a file nor the name of a shipped one; {hint}"
