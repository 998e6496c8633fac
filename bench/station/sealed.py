"""Sealed files: what a blind station really is, so that nobody reads it by accident.

One line with the format, one with the SHA-256 of what is sealed, then compressed JSON in base64. This is no
cryptography: whoever wants to look can.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import json
import zlib
from typing import TYPE_CHECKING, Any, Final

from pydantic import ValidationError

from bench.station.schema import WorldSection
from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

__all__ = ["SEALED_FILE", "digest", "open_world", "seal"]

#: Usual name of the file beside a station file.
SEALED_FILE: Final = "sealed.bin"
_FORMAT: Final = "evs-bench-sealed/1"
_FAMILY: Final = _FORMAT.rpartition("/")[0]
_MOST_BYTES: Final = 1 << 20  # of the file, and of what comes out of it


def seal(content: Mapping[str, Any]) -> bytes:
    """Return the bytes of a sealed file that holds plain values; the same values give the same bytes."""
    packed = zlib.compress(_plain(content), 9)
    lines = [_FORMAT, hashlib.sha256(packed).hexdigest(), base64.encodebytes(packed).decode("ascii")]
    return "\n".join(lines).encode("ascii")


def digest(content: Mapping[str, Any]) -> str:
    """Return the SHA-256 of plain values, in hex digits."""
    return hashlib.sha256(_plain(content)).hexdigest()


def open_world(path: Path) -> WorldSection:
    """Return the world that is sealed in a file.

    Raises
    ------
    InputError
        It cannot be read, is no sealed file, of a newer format, or damaged. The message shows nothing of the content.
    """
    content = _unsealed(path)
    try:
        return WorldSection.model_validate(content)
    except ValidationError:
        raise InputError(
            f"{path}: holds no station that this version reads; expected one that its 'evs-bench challenge new' made"
        ) from None


def _plain(content: Mapping[str, Any]) -> bytes:
    return json.dumps(content, sort_keys=True, allow_nan=False).encode("ascii")


def _unsealed(path: Path) -> object:
    try:
        with path.open("rb") as file:
            head, _, rest = file.read(_MOST_BYTES).partition(b"\n")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    if head.decode("ascii", "replace").rpartition("/")[0] != _FAMILY:
        raise InputError(f"{path}: is no sealed file; expected one that 'evs-bench challenge new' made")
    if head != _FORMAT.encode("ascii"):
        raise InputError(f"{path}: is of the format {head.decode('ascii', 'replace')}; this version reads {_FORMAT}")
    checksum, _, body = rest.partition(b"\n")
    try:
        packed = base64.b64decode(body.replace(b"\n", b""), validate=True)
        if hashlib.sha256(packed).hexdigest().encode("ascii") != checksum:
            raise ValueError
        found: object = json.loads(zlib.decompressobj().decompress(packed, _MOST_BYTES))
    except (binascii.Error, zlib.error, ValueError):
        raise InputError(f"{path}: is damaged; expected what 'evs-bench challenge new' made") from None
    return found
