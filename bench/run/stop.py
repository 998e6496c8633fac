"""How an operator ends a run: Ctrl-C once stops it at the next safe moment, twice at once."""

from __future__ import annotations

import contextlib
import signal
import threading
from typing import TYPE_CHECKING, Any

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

    def request(self) -> None:
        """Stop at the next safe moment."""
        self.requested = True

    @contextlib.contextmanager
    def listening(self) -> Iterator[None]:
        """Take Ctrl-C as the wish to stop, meanwhile, and SIGTERM as the wish to stop at once.

        Signals come to the main thread only; in another one this does nothing.
        """
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        before = {s: signal.signal(s, h) for s, h in ((signal.SIGINT, self._ctrl_c), (signal.SIGTERM, self._at_once))}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    def _ctrl_c(self, _signal: int, _frame: Any) -> None:
        if self.requested:
            raise KeyboardInterrupt
        self.requested = True
        if self._tell is not None:
            self._tell("stopping after this point; press Ctrl-C again to stop at once")

    def _at_once(self, _signal: int, _frame: Any) -> None:
        raise KeyboardInterrupt
