"""How a run is ended: Ctrl-C once stops it at the next safe moment, twice at once.

A kill, a terminal that goes away, and an operator at another terminal stop it at once. All that comes at once comes
as a signal, so that :func:`bench.store.signals.signals_later` can hold it back where work must not be cut in two.
"""

from __future__ import annotations

import _thread
import contextlib
import signal
import threading
from typing import TYPE_CHECKING, Any, Final

from bench.store.signals import ENDING_SIGNALS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

__all__ = ["Interruption", "StopFlag"]

#: What another thread sends to this process to interrupt the main one.
_SIGNAL: Final = signal.SIGTERM


class Interruption(BaseException):
    """A step that is cut short, without ending the run; like KeyboardInterrupt it passes what catches errors."""


class StopFlag:
    """A wish to stop, kept until the runner looks.

    Parameters
    ----------
    tell
        Called once, with a line for the operator, when the wish is made by Ctrl-C.

    Attributes
    ----------
    requested
        Whether somebody wishes to stop.
    reason
        Why, for the journal; empty where the operator pressed Ctrl-C.
    """

    def __init__(self, tell: Callable[[str], None] | None = None) -> None:
        self.requested = False
        self.reason = ""
        self._tell = tell
        self._idle = False
        self._listening = False
        self._lock = threading.Lock()
        self._ended = False  # at_once was called
        self._sent = False  # whether a signal from a thread of ours is on its way
        self._due: BaseException | None = None  # what it raises

    def request(self) -> None:
        """Stop at the next safe moment."""
        self.requested = True

    def at_once(self, reason: str) -> None:
        """Stop at once, from any thread; where the run is not in the main thread, at the next safe moment."""
        if not self._ended:
            self._ended, self.requested, self.reason = True, True, reason
            self.interrupt(KeyboardInterrupt())

    def interrupt(self, error: BaseException) -> bool:
        """Raise `error` in the main thread, where it listens; return whether it does.

        A wish to stop goes before what only cuts a step short.
        """
        with self._lock:
            if not self._listening:
                return False
            if not isinstance(self._due, KeyboardInterrupt):
                self._due = error
            if not self._sent:  # else the one that is on its way will do
                self._sent = True
                _send()
        return True

    def calm(self) -> None:
        """Forget an interruption that has not arrived yet: its step is over."""
        with self._lock:
            if isinstance(self._due, Interruption):
                self._due = None

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
                elif signal.getsignal(number) is not signal.SIG_IGN or number == _SIGNAL:
                    before[number] = signal.signal(number, self._arrived)
            self._listening = True
            yield
        finally:
            with self._lock:
                self._listening = False
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

    def _arrived(self, number: int, _frame: Any) -> None:
        """Raise what a thread of ours has sent, or end the run at once where the signal came from outside.

        No lock: the main thread may hold it when the signal comes.
        """
        if number == _SIGNAL and self._sent:
            self._sent = False  # before the next line: what is due from now on has a signal of its own
            due, self._due = self._due, None
            if due is not None:
                raise due
            return
        raise KeyboardInterrupt


def _send() -> None:
    """Send the main thread the signal; a call of the system that it waits in ends."""
    number = threading.main_thread().ident
    if hasattr(signal, "pthread_kill") and number is not None:
        signal.pthread_kill(number, _SIGNAL)
    else:
        _thread.interrupt_main(_SIGNAL)
