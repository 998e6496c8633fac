"""Which trace the devices of a station write their bytes into, when they are connected."""

from __future__ import annotations

import contextlib
from contextvars import ContextVar
from typing import TYPE_CHECKING

from drivers.transport.trace import Trace
from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

__all__ = ["current_trace", "tracing"]

_CURRENT: ContextVar[Trace | None] = ContextVar("trace", default=None)


def current_trace() -> Trace | None:
    """Return the trace that a station which is connected now writes to; None: no bytes are written down."""
    return _CURRENT.get()


@contextlib.contextmanager
def tracing(path: Path) -> Iterator[Trace]:
    """Write every byte of the stations that are connected meanwhile, with its time, into a text file.

    Raises
    ------
    InputError
        The file cannot be written.
    """
    try:
        trace = Trace(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror})") from None
    token = _CURRENT.set(trace)
    try:
        yield trace
    finally:
        _CURRENT.reset(token)
        trace.close()
