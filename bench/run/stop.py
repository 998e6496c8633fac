"""How an operator ends a run: Ctrl-C once stops it at the next safe moment, twice at once.

A kill, and a terminal that goes away, stop it at once.
"""

from __future__ import annotations

import contextlib
import signal
import threading
from typing import TYPE_CHECKING, Any

from bench.store.signals import ENDING_SIGNALS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

__all__ = ["StopFlag"]


class StopFlag:
    """A wish to stop, kept until the runner looks.

    Parameters
    ----------
    tell
        Called once, with a line for the operator, when the wish is made by Ctrl-C.
    """

    def __init__(self, tell: Callable[[str], None] | None = None) -> None:
        self.requested = False
        self._tell = tell
        self._idle = False

    def request(self) -> None:
        """Stop at the next safe moment."""
        self.requested = True

    @contextlib.contextmanager
    def listening(self) -> Iterator[None]:
        """Take Ctrl-C as the wish to stop, meanwhile, and SIGTERM and SIGHUP as the wish to stop at once.

        A SIGHUP that is ignored, as under ``nohup``, stays ignored. Signals come to the main thread only; in another
        one this does nothing.
        """
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        before: dict[int, Any] = {}
        try:
            for number in ENDING_SIGNALS:
                if number == signal.SIGINT:
                    before[number] = signal.signal(number, self._ctrl_c)
                elif signal.getsignal(number) is not signal.SIG_IGN:
                    before[number] = signal.signal(number, self._at_once)
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    @contextlib.contextmanager
    def idle(self) -> Iterator[None]:
        """Stop at once at the first Ctrl-C, meanwhile: nothing is being measured."""
        self._idle = True
        try:
            yield
        finally:
            self._idle = False

    def _ctrl_c(self, _signal: int, _frame: Any) -> None:
        if self.requested or self._idle:
            raise KeyboardInterrupt
        self.requested = True
        if self._tell is not None:
            self._tell("stopping after this point; press Ctrl-C again to stop at once")

    def _at_once(self, _signal: int, _frame: Any) -> None:
        raise KeyboardInterrupt
