"""Recordings of event streams on disk: which format a file has, and its events, a chunk at a time."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from drivers.events import decoders
from drivers.events.headers import LONGEST_HEADER, FileHeader, parse_header
from protocols.errors import InputError, Problem

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

    from drivers.events.types import EventChunk

__all__ = ["CHUNK_BYTES", "FORMATS", "Recording", "open_recording"]

#: So much of a file is read and decoded at once: fits the cache of a processor with its events, measured as fastest.
CHUNK_BYTES: Final = 1 << 20

#: Formats by the name under which they are asked for. "EVT2.1 legacy" has the upper half of each word first.
FORMATS: Final = ("EVT3", "EVT2.1", "EVT2.1 legacy", "EVT2", "DAT")

_FORMAT_OF_EXTENSION: Final = {".evt3": "EVT3", ".evt21": "EVT2.1", ".evt2": "EVT2", ".dat": "DAT"}
_DAT_EVENTS: Final = (0x00, 0x0C)
_DAT_TRIGGERS: Final = 0x0E
_TIME_HIGH: Final = 0x8  #: type of a word of EVT2.1


@dataclass(frozen=True, slots=True)
class _Layout:
    """How the data of a file are to be decoded."""

    format: str
    width: int | None
    height: int | None
    legacy: bool = False  # EVT2.1
    triggers: bool = False  # DAT

    def decoder(self) -> decoders.Decoder:
        if self.format == "EVT3":
            return decoders.Evt3Decoder(self.width, self.height)
        if self.format == "EVT2":
            return decoders.Evt2Decoder(self.width, self.height)
        if self.format == "EVT2.1":
            return decoders.Evt21Decoder(self.width, self.height, legacy=self.legacy)
        return decoders.DatDecoder(self.width, self.height, triggers=self.triggers)


class Recording:
    """A recording that can be read, made by :func:`open_recording`.

    Attributes
    ----------
    path
        The file.
    header
        What the text at its start says; :attr:`FileHeader.data_offset` is where the words begin.
    format
        ``EVT3``, ``EVT2.1``, ``EVT2`` or ``DAT``; followed by ``(no header)`` where the file does not say it itself.
    width, height
        Size of the sensor in pixels, None if nobody said it.
    """

    def __init__(self, path: Path, header: FileHeader, layout: _Layout, chunk_bytes: int) -> None:
        self.path = path
        self.header = header
        self.format = layout.format if header.lines else f"{layout.format} (no header)"
        self.width = layout.width
        self.height = layout.height
        self._layout = layout
        self._chunk_bytes = chunk_bytes
        self._decoder = layout.decoder()

    def chunks(self) -> Iterator[EventChunk]:
        """Yield the events and triggers in the order of the file; chunks with neither are left out.

        Times are as the sensor sent them, nothing is subtracted. Memory is bounded by the size of a chunk. Each call
        begins at the start of the file, and the counts below begin anew.
        """
        self._decoder = self._layout.decoder()
        with self.path.open("rb") as file:
            file.seek(self.header.data_offset)
            while data := file.read(self._chunk_bytes):
                chunk = self._decoder.feed(data)
                if len(chunk.events) or len(chunk.triggers):
                    yield chunk
        self._decoder.finish()

    @property
    def violations(self) -> dict[str, int]:
        """What broke the rules of the format, as far as :meth:`chunks` was read."""
        return self._decoder.violations

    @property
    def word_types(self) -> dict[int, int]:
        """Number of words of each type, as far as :meth:`chunks` was read; empty for DAT."""
        return self._decoder.word_types

    @property
    def erc_counts(self) -> decoders.ErcCounts:
        """What the sensor said of its event-rate controller, as far as :meth:`chunks` was read."""
        return self._decoder.erc_counts


def open_recording(
    path: str | Path,
    *,
    format: str | None = None,  # noqa: A002 - the word that the file itself uses
    width: int | None = None,
    height: int | None = None,
    chunk_bytes: int = CHUNK_BYTES,
) -> Recording:
    """Find out what a recording is, and make it ready to be read.

    Parameters
    ----------
    path
        A RAW file, a DAT file, or a file of bare words whose extension says the format (.evt3, .evt21, .evt2).
    format
        One of :data:`FORMATS`, instead of what the file says.
    width, height
        Size of the sensor in pixels, instead of what the file says. Both or neither.
    chunk_bytes
        So many bytes are read and decoded at once.

    Raises
    ------
    InputError
        If the file cannot be read, or its format is not known.
    """
    path = Path(path)
    if chunk_bytes < 1:
        raise InputError(f"chunks of {chunk_bytes} bytes make no sense; at least 1 is needed")
    if (width is None) != (height is None):
        raise InputError("give width and height of the sensor, or neither")
    head = _read_head(path)
    header = parse_header(head, str(path))
    name = _known_format(format) if format else _find_format(path, header)
    size = (header.width, header.height) if width is None else (width, height)
    layout = _Layout(name.removesuffix(" legacy"), *size)
    if layout.format == "EVT2.1":
        layout = replace(layout, legacy=_is_legacy(name, bool(format), header, head, path))
    if layout.format == "DAT":
        layout = replace(layout, triggers=_dat_holds_triggers(head, header, path))
        header = replace(header, data_offset=header.data_offset + 2)
    try:
        return Recording(path, header, layout, chunk_bytes)
    except ValueError as error:
        raise InputError(Problem(str(error), str(path))) from None


def _read_head(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(LONGEST_HEADER)
    except OSError as error:
        raise InputError(Problem(f"cannot be read: {error.strerror}", str(path))) from None


def _known_format(name: str) -> str:
    """Return the format that was asked for, in its own spelling."""
    spellings = {known.lower().replace(".", "").replace(" ", "-"): known for known in FORMATS}
    found = spellings.get(name.lower().replace(".", "").replace(" ", "-"))
    if found is None:
        raise InputError(f"format {name!r} is not known; known are {', '.join(FORMATS)}")
    return found


def _find_format(path: Path, header: FileHeader) -> str:
    """Return the format that the header names, or else the extension."""
    found = header.format or _FORMAT_OF_EXTENSION.get(path.suffix.lower())
    if found is None:
        message = "what format it has is said neither by a header nor by its extension"
        raise InputError(Problem(f"{message}; say which: {', '.join(FORMATS)}", str(path)))
    return found


def _is_legacy(name: str, asked: bool, header: FileHeader, head: bytes, path: Path) -> bool:
    """Return whether the upper half of each word comes first: as asked, as the file says, or as its words show."""
    if asked:
        return name.endswith(" legacy")
    if header.legacy is not None:
        return header.legacy
    n_words = (len(head) - header.data_offset) // 8
    halves = np.frombuffer(head, "<u4", 2 * n_words, header.data_offset).reshape(-1, 2)
    first, second = _time_high_words(halves[:, 0], halves[:, 1]), _time_high_words(halves[:, 1], halves[:, 0])
    if first == second:
        message = "EVT2.1: neither the header nor the words tell which half of a word comes first"
        raise InputError(Problem(f"{message}; say EVT2.1 or 'EVT2.1 legacy'", str(path)))
    return first > second


def _time_high_words(upper: npt.NDArray[np.uint32], lower: npt.NDArray[np.uint32]) -> int:
    """Return how many words are a TIME_HIGH: type 8, and nothing in the lower half."""
    return int(np.count_nonzero((upper >> 28 == _TIME_HIGH) & (lower == 0)))


def _dat_holds_triggers(head: bytes, header: FileHeader, path: Path) -> bool:
    """Read the two bytes that say what the records of a DAT file are."""
    kind_and_size = head[header.data_offset : header.data_offset + 2]
    if len(kind_and_size) < 2:
        raise InputError(Problem("DAT: ends ahead of its data", str(path)))
    kind, size = kind_and_size
    if kind not in (*_DAT_EVENTS, _DAT_TRIGGERS) or size != 8:
        message = f"DAT: holds records of type 0x{kind:02X} with {size} bytes"
        expected = "expected 0x00 or 0x0C (events) or 0x0E (triggers) with 8 bytes"
        raise InputError(Problem(f"{message}; {expected}", str(path)))
    return kind == _DAT_TRIGGERS
