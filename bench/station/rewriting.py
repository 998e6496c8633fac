"""Changing values of a station file, with its comments and its order kept, and the old file beside it."""

from __future__ import annotations

import io
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from bench.station.loading import parse_station, stations
from bench.station.schema import StationFile
from bench.store.durable import sync_file, write_whole
from protocols.errors import InputError, Problem
from protocols.files import parse_model, read_text
from protocols.yaml_strict import read_yaml

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["flow_rows", "refuse_shipped", "rewrite", "round_trip"]

_WIDTH: Final = 100_000  #: no line is broken


def rewrite(path: Path, change: Callable[[Any], None], wanted: Callable[[Any], Any]) -> Path:
    """Change a station file, and return the name of the copy of what it was.

    The file is there in full at any moment, the old one or the new one.

    Parameters
    ----------
    path
        The station file.
    change
        Changes the document, as ruamel.yaml reads it with its comments.
    wanted
        From the old values of the file to what they should be now; anything else is refused.

    Raises
    ------
    InputError
        It is a shipped station, it cannot be written, or other values would change.
    """
    refuse_shipped(path)
    text = _changed(read_text(path), change, wanted, str(path))
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


def _changed(old: str, change: Callable[[Any], None], wanted: Callable[[Any], Any], source: str) -> str:
    """Return the text with its values changed, and make sure that nothing else became another value."""
    from ruamel.yaml.error import YAMLError
    from ruamel.yaml.util import load_yaml_guess_indent

    parse_model(old, StationFile, source)  # says what is wrong with a file that is none, with its place
    try:
        _, sequence, offset = load_yaml_guess_indent(old)
        yaml = round_trip(sequence or 4, offset if offset is not None else 2)
        document = yaml.load(old)
        change(document)
        out = io.StringIO()
        yaml.dump(document, out)
    except YAMLError as error:
        raise InputError(Problem(f"cannot be changed: {' '.join(str(error).split())}", source)) from None
    text = out.getvalue()
    if read_yaml(text, source).value != wanted(read_yaml(old, source).value):
        raise InputError(Problem("cannot be changed without changing other values; change it by hand", source))
    return text.replace("\n", "\r\n") if "\r\n" in old else text


def round_trip(sequence: int = 4, offset: int = 2) -> Any:
    """Return what reads and writes YAML with its comments, indented as given."""
    from ruamel.yaml import YAML

    yaml = YAML()
    yaml.preserve_quotes = True
    yaml.width = _WIDTH
    yaml.indent(mapping=2, sequence=sequence, offset=offset)
    return yaml


def flow_rows(values: list[Any]) -> Any:
    """Return a list for YAML: numbers in one line; lists in a line each, one below the other."""
    from ruamel.yaml.comments import CommentedSeq

    made = CommentedSeq([flow_rows(v) if isinstance(v, list) else v for v in values])
    if not any(isinstance(v, list) for v in values):
        made.fa.set_flow_style()
    return made
