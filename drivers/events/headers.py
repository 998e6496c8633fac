"""The text at the start of RAW and DAT files: lines of ``% key value``."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Final

from protocols.errors import InputError, Problem

__all__ = ["LONGEST_HEADER", "FileHeader", "parse_header"]

#: A header is a few hundred bytes long; so many are looked at.
LONGEST_HEADER: Final = 1 << 16

_FORMATS: Final = {"EVT3": "EVT3", "EVT21": "EVT2.1", "EVT2.1": "EVT2.1", "EVT2": "EVT2"}
_FORMAT_OF_VERSION: Final = {"3.0": "EVT3", "2.1": "EVT2.1", "2.0": "EVT2"}
_GEOMETRY: Final = re.compile(r"(\d{1,6})x(\d{1,6})", re.ASCII)
_NUMBER: Final = re.compile(r"\d{1,6}", re.ASCII)


@dataclass(frozen=True, slots=True)
class FileHeader:
    """What the text ahead of the data says; what it does not say is None."""

    lines: tuple[str, ...] = ()  #: as in the file, without the leading ``% `` and the end of the line
    fields: dict[str, str] = field(default_factory=dict)  #: value by key; of a repeated key the last
    data_offset: int = 0  #: bytes ahead of the data
    format: str | None = None  #: ``EVT3``, ``EVT2.1``, ``EVT2`` or ``DAT``
    width: int | None = None  #: of the sensor, pixels
    height: int | None = None
    legacy: bool | None = None  #: EVT2.1: whether the upper half of a word comes first


def parse_header(data: bytes, source: str = "") -> FileHeader:
    """Read the header at the start of `data`.

    It ends after a line ``% end``, or at the first line that does not begin with ``% `` or is not text. Both the
    older keys (``evt``, ``geometry``; in DAT files ``Width``, ``Height``) and the newer ``format`` are understood.

    Parameters
    ----------
    data
        The first bytes of a file: all of it, or :data:`LONGEST_HEADER`.
    source
        Name of the file, for messages.

    Raises
    ------
    InputError
        If a key that matters has a value that makes no sense, or two keys contradict each other.
    """
    lines, offset = _split(data)
    fields = {}
    for line in lines:
        key, _, value = line.partition(" ")
        fields[key] = value.strip()
    options = _options(fields.get("format", ""))
    width, height = _size(fields, options, source)
    return FileHeader(
        tuple(lines), fields, offset, _format(lines, fields, source), width, height, _legacy(fields, options, source)
    )


def _split(data: bytes) -> tuple[list[str], int]:
    """Return the lines of the header and where the data begin."""
    lines: list[str] = []
    offset = 0
    while data.startswith(b"% ", offset):
        end = data.find(b"\n", offset)
        text = _text(data[offset + 2 : end]) if end >= 0 else None
        if text is None:
            break
        offset = end + 1
        if text == "end":
            break
        lines.append(text)
    return lines, offset


def _text(line: bytes) -> str | None:
    """Return `line` as text, or None if it is none: data can begin with the two bytes of ``% `` by chance."""
    try:
        text = line.decode("utf-8").rstrip("\r")
    except UnicodeDecodeError:
        return None
    return text.strip() if text.replace("\t", " ").isprintable() else None


def _options(text: str) -> dict[str, str]:
    """Return the options of ``EVT3;height=720;width=1280``."""
    pairs = (part.partition("=") for part in text.split(";")[1:])
    return {key.strip(): value.strip() for key, _, value in pairs}


def _format(lines: list[str], fields: dict[str, str], source: str) -> str | None:
    """Return the format that the header names."""
    named = fields.get("format", "").split(";")[0].strip()
    if named and named not in _FORMATS:
        raise _error(f"format {named!r} is not known; known are {', '.join(sorted(set(_FORMATS.values())))}", source)
    version = fields.get("evt", "")
    if version and version not in _FORMAT_OF_VERSION:
        raise _error(f"evt version {version!r} is not known; known are {', '.join(_FORMAT_OF_VERSION)}", source)
    found = {_FORMATS[named]} if named else set()
    if version:
        found.add(_FORMAT_OF_VERSION[version])
    if any(line.startswith("Data file containing") for line in lines):
        found.add("DAT")
    if len(found) > 1:
        raise _error(f"the header contradicts itself: it names {' and '.join(sorted(found))}", source)
    return found.pop() if found else None


def _size(fields: dict[str, str], options: dict[str, str], source: str) -> tuple[int | None, int | None]:
    """Return width and height of the sensor, from the first place that gives both."""
    if "geometry" in fields:
        match = _GEOMETRY.fullmatch(fields["geometry"])
        if match is None:
            raise _error(f"geometry {fields['geometry']!r} is not of the form 1280x720", source)
        return int(match[1]), int(match[2])
    for place, names in ((options, ("width", "height")), (fields, ("Width", "Height"))):
        if all(name in place for name in names):
            values = [place[name] for name in names]
            if not all(_NUMBER.fullmatch(value) for value in values):
                raise _error(
                    f"{names[0]} and {names[1]} are {values[0]!r} and {values[1]!r}; expected pixels", source
                )
            return int(values[0]), int(values[1])
    return None, None


def _legacy(fields: dict[str, str], options: dict[str, str], source: str) -> bool | None:
    """Return whether 64-bit words come with their upper half first."""
    value = options.get("endianness", fields.get("endianness"))
    if value in (None, "legacy", "little"):
        return None if value is None else value == "legacy"
    raise _error(f"endianness {value!r} is not known; known are legacy and little", source)


def _error(message: str, source: str) -> InputError:
    return InputError(Problem(f"header: {message}", source))
