"""Putting files on disk so that they survive a crash: the one place that knows the platform.

On POSIX systems a rename is on disk when its folder was fsynced. Windows cannot fsync a folder; there the rename is
durable when the file system says so.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

__all__ = ["lock_file", "replace_file", "sync_file", "sync_folder", "write_whole"]


def sync_file(path: Path) -> None:
    """Return when the contents of the closed file `path` are on disk."""
    descriptor = os.open(path, os.O_RDWR)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def sync_folder(path: Path) -> None:
    """Return when the names in the folder `path` are on disk; does nothing where the platform cannot."""
    if os.name != "posix":
        return
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def lock_file(descriptor: int) -> None:
    """Let no other process lock the open file; the lock ends with the process, however that ends.

    Does nothing where the platform cannot. A file that another process has locked raises `BlockingIOError`.
    """
    if os.name != "posix":
        return
    import fcntl

    fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


def replace_file(path: Path, content: bytes) -> None:
    """Write a result so that the file is there completely or not at all; it can be made again, and is not synced."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        temporary.write_bytes(content)
        temporary.replace(path)
    except OSError as error:
        error.filename = error.filename or os.fspath(path)  # a full disk does not say for which file
        raise
    finally:
        temporary.unlink(missing_ok=True)


def write_whole(path: Path, text: str, part_suffix: str) -> None:
    """Write `text` to `path` so that the file is there completely or not at all."""
    part = path.with_name(path.name + part_suffix)
    try:
        part.write_text(text, encoding="utf-8")
        sync_file(part)
        part.replace(path)
    except OSError:
        part.unlink(missing_ok=True)
        raise
    sync_folder(path.parent)
