"""Keeping the signals that end a program out of work that must not be cut in two."""

from __future__ import annotations

import contextlib
import signal
import threading
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ["ENDING_SIGNALS", "signals_later"]

#: Ctrl-C, a polite kill, and a terminal that went away; the last does not exist on every platform.
ENDING_SIGNALS: Final = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)


@contextlib.contextmanager
def signals_later() -> Iterator[None]:
    """Hold back the signals that end a program, and deliver them at the end of the block.

    HDF5 calls back into Python, and Python runs a signal's handler in such a call. An exception of the handler would
    then pass through C code that cannot clean up after it, and takes the process down. Blocking the signal for this
    thread would not do: another thread takes it, and the handler runs in the main thread all the same.

    Handlers run in the main thread only; in another one this does nothing.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    arrived: list[int] = []
    before: dict[int, Any] = {}
    try:
        for number in ENDING_SIGNALS:
            if signal.getsignal(number) is not None:  # None: a handler that is not Python's, and cannot be put back
                before[number] = signal.signal(number, lambda which, _frame: arrived.append(which))
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        for number in arrived:
            signal.raise_signal(number)
