"""Samples that are sent to an emulated function generator: where they lie among lines, and what they are."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

__all__ = ["Refused", "block_of", "requests_of", "shares_of"]

_LONGEST_LINE: Final = 4096  # bytes
_LONGEST_HEAD: Final = 300  # bytes
_MOST_BYTES: Final = 1 << 24
#: What begins a line with samples in it, and where the bytes begin; the group is how many there are.
_BLOCK: Final = re.compile(rb"[^\n#]{0,200}DATA:[^\n#]{1,200}#(?P<digits>[1-9])")
_NAMED: Final = re.compile(rb"[^\n]{1,100}LENGTH,(?P<bytes>\d{1,9})B,[^\n]{0,200}?WAVEDATA,")
_BEGINS: Final = re.compile(rb"(?::SOUR1:TRAC:DATA:DAC16|(?::?SOUR1:)?DATA:ARB:DAC|C1:WVDT) ", re.IGNORECASE)


class Refused(Exception):
    """Samples that an instrument does not take."""


def requests_of(buffer: bytearray) -> list[bytes]:
    """Take the whole lines off the front of `buffer`, and return them; samples count as part of their line."""
    requests = []
    while (length := _length(buffer)) is not None:
        requests.append(bytes(buffer[:length]).removesuffix(b"\n"))
        del buffer[:length]
    if not _BEGINS.match(buffer):
        buffer[:] = buffer[-_LONGEST_LINE:]
    return requests


def _length(buffer: bytearray) -> int | None:
    """Return how long the first line is, with its end; None if it is not whole."""
    if _BEGINS.match(buffer):
        begin, count = _bytes_in(buffer)
        if begin is None:
            if len(buffer) < _LONGEST_HEAD and b"\n" not in buffer:
                return None
        elif count <= _MOST_BYTES:
            end = begin + count
            return None if len(buffer) <= end else end + (buffer[end : end + 1] == b"\n")
    at = buffer.find(b"\n")
    return None if at < 0 else at + 1


def _bytes_in(buffer: bytearray | bytes) -> tuple[int | None, int]:
    """Return where the samples of a line begin, and how many bytes they are; None if that has not come."""
    head = bytes(buffer[:_LONGEST_HEAD])
    named = _NAMED.match(head)
    if named is not None:
        return named.end(), int(named["bytes"])
    block = _BLOCK.match(head)
    if block is None:
        return None, 0
    digits = head[block.end() : block.end() + int(block["digits"])]
    if len(digits) < int(block["digits"]) or not digits.isdigit():
        return None, 0
    return block.end() + len(digits), int(digits)


def block_of(request: bytes) -> tuple[str, bytes] | None:
    """Return what stands before the samples, and the samples; None for a line without any."""
    if not _BEGINS.match(request):
        return None
    begin, count = _bytes_in(request)
    if begin is None or len(request) != begin + count:
        raise Refused("the number of bytes is not what was said")
    return request[:begin].decode("ascii", "replace"), request[begin:]


def shares_of(data: bytes, kind: str, lowest: int, highest: int, fewest: int, most: int) -> npt.NDArray[np.float64]:
    """Return samples as parts of the way from the lower to the upper level.

    Raises
    ------
    Refused
        There are too few or too many of them, or one is out of range.
    """
    if len(data) % 2 or not fewest <= len(data) // 2 <= most:
        raise Refused(f"{len(data)} bytes")
    code = np.frombuffer(data, kind).astype(np.int64)
    if code.min() < lowest or code.max() > highest:
        raise Refused(f"codes {code.min()} to {code.max()}")
    return np.asarray((code - lowest) / (highest - lowest), np.float64)
