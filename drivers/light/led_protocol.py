"""The lines that host and LED driver exchange: ASCII, numbered, each with its checksum.

A request is ``<number> <text>*<crc>`` and LF; its replies carry the same number. The checksum is CRC-16/CCITT-FALSE
of all before the ``*``, four hexadecimal digits. All commands are in `drivers/firmware/led_driver/README.md`.
"""

from __future__ import annotations

import binascii
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivers.light.led_program import Program

__all__ = [
    "LONGEST_LINE",
    "PROTOCOL",
    "DeviceFacts",
    "Reply",
    "crc16",
    "encode_line",
    "encode_program",
    "parse_facts",
    "parse_reply",
    "text_of_line",
]

PROTOCOL: Final = 1
LONGEST_LINE: Final = 240  #: bytes, with its LF
EDGES_IN_A_LINE: Final = 12
#: In place of a number: what nobody asked for, and a request that could not be read.
UNASKED: Final = "!"
UNREADABLE: Final = "?"


def crc16(data: bytes) -> int:
    """Return the checksum CRC-16/CCITT-FALSE: polynomial 0x1021, from 0xFFFF, nothing reflected."""
    return binascii.crc_hqx(data, 0xFFFF)


def encode_line(text: str) -> bytes:
    """Return a line with its checksum and LF."""
    data = text.encode("ascii")
    return data + b"*%04X\n" % crc16(data)


def text_of_line(line: bytes) -> str:
    """Return the text of a line without its LF.

    Raises
    ------
    ValueError
        It is not what was sent.
    """
    data, star, digits = line.rpartition(b"*")
    if not star or digits != b"%04X" % crc16(data):
        raise ValueError("the checksum is wrong")
    if not data or not all(0x20 <= byte < 0x7F for byte in data):
        raise ValueError("it has bytes that are no text")
    return data.decode("ascii")


@dataclass(frozen=True, slots=True)
class Reply:
    """A line from the device."""

    number: int | None  #: of the request; None where there was none, or none that could be read
    kind: str  #: ok, done, error; for what nobody asked for, what happened
    words: tuple[str, ...]


def parse_reply(line: bytes) -> Reply:
    """Return what a line from the device, without its LF, says.

    Raises
    ------
    ValueError
        It makes no sense.
    """
    number, kind, *words = [*text_of_line(line).split(" "), ""]
    if number == UNASKED and kind:
        return Reply(None, kind, tuple(words[:-1]))
    if number == UNREADABLE and kind == "error":
        return Reply(None, kind, tuple(words[:-1]))
    if not number.isdecimal() or kind not in ("ok", "done", "error"):
        raise ValueError("it is no reply")
    return Reply(int(number), kind, tuple(words[:-1]))


@dataclass(frozen=True, slots=True)
class DeviceFacts:
    """What the device says of itself."""

    protocol: int
    firmware: str
    serial: str
    tick_us: int  #: times are multiples of it, us
    dac_bits: int
    max_edges: int  #: of a stored waveform
    shortest_us: int  #: between two edges, us


def parse_facts(words: tuple[str, ...]) -> DeviceFacts:
    """Return what the device answers to hello.

    Raises
    ------
    ValueError
        Something is missing, or is no number.
    """
    said = dict(word.split("=", 1) for word in words if "=" in word)
    try:
        numbers = {name: int(said[name]) for name in ("protocol", "tick_us", "dac_bits", "max_edges", "shortest_us")}
        facts = DeviceFacts(firmware=said["firmware"], serial=said["serial"], **numbers)
    except KeyError as error:
        raise ValueError(f"it does not tell its {error.args[0]}") from None
    if min(facts.tick_us, facts.dac_bits, facts.max_edges, facts.shortest_us) < 1:
        raise ValueError("it tells numbers below 1")
    return facts


def encode_program(program: Program) -> Iterator[str]:
    """Yield the requests, without number and checksum, that store a program in the device."""
    if program.square is not None:
        low, high, period_us, bright_us, count, preamble_us = program.square
        yield f"square {low} {high} {period_us} {bright_us} {count} {preamble_us}"
        return
    edges = program.stored
    loop = f"{program.loop_from} {program.loop_edges} {program.loops}"
    yield f"wave {program.begin} {len(edges)} {loop} {program.end_us}"
    for first in range(0, len(edges), EDGES_IN_A_LINE):
        part = " ".join(f"{delta_us}:{level}" for delta_us, level in edges[first : first + EDGES_IN_A_LINE])
        yield f"edges {first} {part}"
