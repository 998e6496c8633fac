"""Protocols by name or by path."""

from __future__ import annotations

from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING

from protocols import library
from protocols.errors import InputError
from protocols.files import parse_model, read_text
from protocols.schema import Protocol

if TYPE_CHECKING:
    import os

__all__ = ["LoadedProtocol", "load_protocol", "parse_protocol"]


@dataclass(frozen=True, slots=True)
class LoadedProtocol:
    """A protocol, and the file it came from."""

    protocol: Protocol
    text: str  #: as it was written
    source: str  #: path, or name of a ready-made protocol


def load_protocol(name_or_path: str | os.PathLike[str]) -> LoadedProtocol:
    """Return a ready-made protocol by its name, or a protocol file by its path.

    Parameters
    ----------
    name_or_path
        A name that is in :func:`protocols.library.names` is that; everything else is a path.

    Raises
    ------
    InputError
        If there is no such protocol, or with everything that is wrong in the file.
    """
    name = str(name_or_path)
    if name in library.names():
        return parse_protocol(library.text(name), name)
    if not Path(name_or_path).exists():
        raise InputError(_unknown(name))
    return parse_protocol(read_text(name_or_path), name)


def parse_protocol(text: str, source: str) -> LoadedProtocol:
    """Return the protocol that `text` describes; `source` is its name in messages."""
    return LoadedProtocol(parse_model(text, Protocol, source), text, source)


def _unknown(name: str) -> str:
    close = get_close_matches(name, library.names(), n=1)
    hint = f"did you mean {close[0]!r}?" if close else f"ready-made are {', '.join(library.names())}"
    return f"there is no protocol {name!r}: neither a file nor the name of a ready-made one; {hint}"
