"""Sending notices beside a run: a thread for each way, bounded in time, and harmless whatever happens."""

from __future__ import annotations

import contextlib
import logging
import queue
import threading
import time
from collections import deque
from pathlib import Path
from typing import TYPE_CHECKING, Final

from bench.logs import LOG_FILE, log_into
from bench.notices.loading import load_notices
from bench.notices.way import NotSent

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from bench.notices.loading import Notices, Subscription
    from bench.notices.notice import Notice

__all__ = ["CLOSING_S", "Notifier", "notifying"]

_all_logs = logging.getLogger("evs_bench")
_log = logging.getLogger("evs_bench.notices")

#: What notices that are still on their way are given at the end, s.
CLOSING_S: Final = 10.0
#: Between two attempts, s.
_PAUSES_S: Final = (2.0, 15.0, 60.0)
#: The same at the end, when nobody wants to wait.
_LAST_PAUSE_S: Final = 0.5
#: Notices that may wait for one way; a run that has so much to tell is told of enough.
_MOST_WAITING: Final = 50


class Notifier:
    """Sends notices to all who want them.

    Parameters
    ----------
    notices
        Who wants what, and how.
    pauses_s
        Waits between attempts, s; there is one attempt more than there are waits.
    """

    def __init__(self, notices: Notices, pauses_s: tuple[float, ...] = _PAUSES_S) -> None:
        self.notices = notices
        self._outboxes = [_Outbox(subscription, pauses_s) for subscription in notices.subscriptions]
        self._folder: str | None = None  # of the run that was last told of

    @property
    def problems(self) -> tuple[str, ...]:
        """What went wrong so far, a line each, without a secret."""
        return tuple(line for outbox in self._outboxes for line in tuple(outbox.problems))

    def tell(self, notice: Notice) -> None:
        """Send `notice` to those who want its kind; returns at once and never raises."""
        self._folder = notice.run
        for outbox in self._outboxes:
            if notice.kind in outbox.subscription.on:
                outbox.put(notice)

    def tell_one(self, number: int, notice: Notice) -> None:
        """Send `notice` to the one subscription `number`."""
        self._outboxes[number].put(notice)

    def close(self, timeout_s: float = CLOSING_S) -> tuple[str, ...]:
        """Give what is on its way at most `timeout_s`, and return what went wrong, a line each.

        What goes wrong now is still in the log of the run, which is over.
        """
        deadline_s = time.monotonic() + timeout_s
        with _logging_into(self._folder):
            for outbox in self._outboxes:
                outbox.end()
            for outbox in self._outboxes:
                outbox.join(max(deadline_s - time.monotonic(), 0.0), timeout_s)
                outbox.log_the_rest()
        return self.problems


@contextlib.contextmanager
def _logging_into(folder: str | None) -> Iterator[None]:
    """Log into the log of a run or a queue, if it has one that can be written."""
    with contextlib.ExitStack() as stack:
        if folder is not None and (Path(folder) / LOG_FILE).exists():
            with contextlib.suppress(OSError):
                stack.enter_context(log_into(Path(folder) / LOG_FILE))
        yield


class _Outbox:
    """The notices that go one way, and the thread that sends them."""

    def __init__(self, subscription: Subscription, pauses_s: tuple[float, ...]) -> None:
        self.subscription = subscription
        self.problems: list[str] = []
        self._unlogged: deque[str] = deque()
        self._pauses_s = pauses_s
        self._waiting: queue.Queue[Notice | None] = queue.Queue()
        self._ending = threading.Event()
        self._thread: threading.Thread | None = None

    def put(self, notice: Notice) -> None:
        """Let the thread send `notice` as soon as it can."""
        if self._waiting.qsize() >= _MOST_WAITING:
            self._problem(notice, f"{_MOST_WAITING} others wait already")
            return
        self._waiting.put(notice)
        if self._thread is None:
            thread = threading.Thread(target=self._work, name=self.subscription.way.name, daemon=True)
            try:
                thread.start()
            except RuntimeError as error:  # the machine has no thread left
                self._problem(notice, str(error))
                return
            self._thread = thread

    def end(self) -> None:
        """Let the thread end when all is sent, and be quick about it."""
        self._ending.set()
        self._waiting.put(None)

    def join(self, left_s: float, allowed_s: float) -> None:
        """Wait for the thread; what it has not sent by then is lost."""
        if self._thread is None:
            return
        self._thread.join(left_s)
        if self._thread.is_alive():
            self._note(f"{self.subscription.way.name}: not all notices could leave in the last {allowed_s:g} s")

    def _work(self) -> None:
        while (notice := self._waiting.get()) is not None:
            try:
                self._deliver(notice)
            except Exception as error:  # noqa: BLE001 - a notice never touches the run, whatever a server does
                self._problem(notice, type(error).__name__)

    def _deliver(self, notice: Notice) -> None:
        way, timeout_s = self.subscription.way, self.subscription.timeout_s
        for pause_s in (*self._pauses_s, None):
            try:
                way.send(notice, timeout_s)
            except NotSent as error:
                if pause_s is None or not error.again:
                    self._problem(notice, str(error))
                    return
                self._wait(pause_s)
            else:
                _log.info("%s: told of %s", way.name, notice.kind)
                return

    def _wait(self, pause_s: float) -> None:
        if self._ending.wait(pause_s):
            time.sleep(min(pause_s, _LAST_PAUSE_S))

    def _problem(self, notice: Notice, reason: str) -> None:
        self._note(f"{self.subscription.way.name}: notice of {notice.kind} not sent: {reason}")

    def _note(self, line: str) -> None:
        self.problems.append(line)
        self._unlogged.append(line)
        if any(not isinstance(handler, logging.NullHandler) for handler in _all_logs.handlers):
            self.log_the_rest()

    def log_the_rest(self) -> None:
        """Log what went wrong while no log was open, as between the end of a run and that of its command."""
        while self._unlogged:
            with contextlib.suppress(IndexError):  # the other thread was quicker
                _log.warning("%s", self._unlogged.popleft())


@contextlib.contextmanager
def notifying(file: Path | None, tell_problem: Callable[[str], None]) -> Iterator[Notifier | None]:
    """Have notices sent as `file` says, or the file in ``EVS_BENCH_NOTIFY``; None if there is neither.

    At the end notices get ten seconds to leave; what went wrong is told line by line.

    Raises
    ------
    InputError
        With everything that is wrong in the file.
    """
    notices = load_notices(file)
    if notices is None:
        yield None
        return
    notifier = Notifier(notices)
    try:
        yield notifier
    finally:
        for line in notifier.close():
            tell_problem(line)
