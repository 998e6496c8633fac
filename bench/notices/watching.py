"""A run that is watched: what it tells of its progress goes on to where it went, and notices are made of it."""

from __future__ import annotations

import threading
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

from bench.notices.notice import Notice, one_line
from bench.notices.stall import StallWatch

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from bench.notices.notice import Kind
    from bench.notices.notifier import Notifier
    from bench.run import RunResult
    from bench.run.progress import Progress, Status
    from protocols.schema import Protocol

__all__ = ["NoticeProgress", "RunFacts", "facts_of", "with_notices"]

_LOOK_EVERY_S: Final = 1.0


@dataclass(frozen=True, slots=True)
class RunFacts:
    """What notices say of a run, and how long its points are expected to take."""

    title: str
    station: str
    folder: Path | None = None  #: None if it is named when the run begins
    expected_s: tuple[float, ...] = ()  #: of each point, in the order of the plan


def facts_of(protocol: Protocol, station: str, folder: Path | None = None) -> RunFacts:
    """Return the facts of a run of `protocol`: each point is expected to take its recording and all its waits."""
    from protocols.estimation import recording_s

    expected_s = tuple(
        recording_s(p) + p.settle.light_s + p.settle.filter_s + p.settle.bias_s for p in protocol.expand()
    )
    return RunFacts(protocol.title, station, folder, expected_s)


class NoticeProgress:
    """Passes progress on, and tells those who asked for it what becomes of the run.

    It is a :class:`~bench.run.progress.Progress`. What no progress says is told it by its own methods: the run is
    `held`, is `going_on`, has `ended` or `failed`. None of them raises because of a notice.

    Parameters
    ----------
    inner
        Where progress goes on to.
    notifier
        Sends the notices.
    facts
        What they say of the run.
    watch
        Notices a standstill; default is one with the limits that the notifier was given.
    look_every_s
        Time between two looks at it, s.
    """

    def __init__(
        self,
        inner: Progress,
        notifier: Notifier,
        facts: RunFacts,
        *,
        watch: StallWatch | None = None,
        look_every_s: float = _LOOK_EVERY_S,
    ) -> None:
        self._inner = inner
        self._notifier = notifier
        self._facts = facts
        limits = {n: s.no_progress_s for n, s in enumerate(notifier.notices.subscriptions) if s.no_progress_s}
        self._who = tuple(limits)  # number of the subscription that each limit belongs to
        factor = notifier.notices.no_progress_factor
        self._watch = watch or StallWatch(tuple(limits.values()), factor)
        self._look_every_s = look_every_s
        self._over = threading.Event()
        self._watcher: threading.Thread | None = None
        self._status: Status | None = None
        self._seen: tuple[int, str] | None = None

    def begin(self) -> None:
        """Expect progress from now on."""
        self._watch.progressed()
        if self._who and self._watcher is None:
            self._watcher = threading.Thread(target=self._look, name="no progress", daemon=True)
            self._watcher.start()

    def update(self, status: Status) -> None:
        """Pass the status on; another point, or one more that is done, is progress."""
        self._inner.update(status)
        self._status = status
        if (status.done, status.label) != self._seen:
            self._seen = (status.done, status.label)
            self._watch.progressed(self._expected_s(status))

    def message(self, text: str) -> None:
        """Pass a message on."""
        self._inner.message(text)

    def close(self) -> None:
        """Pass on that the run is over; nothing is expected of it any more."""
        self.stop_watching()
        self._inner.close()

    def held(self, state: str, reason: str) -> None:
        """Tell that the run is ``paused`` or ``suspended``; no progress is expected until it goes on."""
        if state == "paused":
            self.paused(reason)
        else:
            self.suspended(reason)

    def paused(self, reason: str) -> None:
        """Tell that the run waits for a person; no progress is expected until it goes on."""
        self._watch.rest()
        self._tell("paused", reason)

    def suspended(self, reason: str) -> None:
        """Tell that the run waits until something is right again; no progress is expected until it goes on."""
        self._watch.rest()
        self._tell("suspended", reason)

    def going_on(self) -> None:
        """Expect progress again."""
        self._watch.progressed(0.0 if self._status is None else self._expected_s(self._status))

    def ended(self, result: RunResult) -> None:
        """Tell that the run is over: all points, or those before the operator stopped it."""
        self.stop_watching()
        how = "stopped after" if result.stopped else "done:"
        text = f"{how} {result.done} of {result.total} points, in {result.folder}"
        notice = self._notice("end", text)
        self._notifier.tell(_with_result(notice, result))

    def failed(self, error: BaseException) -> None:
        """Tell that the run was ended by an error, or at once by the operator."""
        self.stop_watching()
        reason = one_line(str(error)) or type(error).__name__
        if isinstance(error, KeyboardInterrupt):
            self._tell("end", "stopped at once by the operator" if not str(error) else reason)
        else:
            self._tell("failure", reason)

    def _tell(self, kind: Kind, text: str) -> None:
        self._notifier.tell(self._notice(kind, text))

    def _notice(self, kind: Kind, text: str) -> Notice:
        status, facts = self._status, self._facts
        return Notice(
            kind,
            facts.title,
            text,
            station=facts.station,
            run=None if facts.folder is None else str(facts.folder),
            points_done=None if status is None else status.done,
            points=None if status is None else status.total,
            label=None if status is None else status.label or None,
        )

    def _expected_s(self, status: Status) -> float:
        """Return what the point that begins is expected to take; of a resumed run the longest of its points."""
        expected_s = self._facts.expected_s
        if len(expected_s) == status.total and status.done < status.total:
            return expected_s[status.done]
        return max(expected_s, default=0.0)

    def _look(self) -> None:
        from bench.run.progress import duration_text

        while not self._over.wait(self._look_every_s):
            for number, passed_s in self._watch.overdue():
                notice = self._notice("no_progress", f"nothing new for {duration_text(passed_s)}")
                self._notifier.tell_one(self._who[number], notice)

    def stop_watching(self) -> None:
        """Expect nothing more."""
        self._watch.rest()
        self._over.set()


def _with_result(notice: Notice, result: RunResult) -> Notice:
    return replace(notice, run=str(result.folder), points_done=result.done, points=result.total, label=None)


def with_notices(
    take: Callable[[Progress], RunResult],
    inner: Progress,
    notifier: Notifier | None,
    facts: Callable[[], RunFacts],
    *,
    tell_outcome: bool = True,
) -> RunResult:
    """Return what `take` returns, called with a progress from which notices are made.

    Parameters
    ----------
    take
        Takes the run, and tells its progress to what it is given.
    inner
        Where progress is told to an operator.
    notifier
        Sends the notices; None for none.
    facts
        Returns what they say of the run; not called where there are none.
    tell_outcome
        Whether its end and its failure are told, too; False where the caller does that.
    """
    if notifier is None:
        return take(inner)
    progress = NoticeProgress(inner, notifier, facts())
    progress.begin()
    try:
        result = take(progress)
    except BaseException as error:
        if tell_outcome:
            progress.failed(error)
        raise
    finally:
        progress.stop_watching()
    if tell_outcome:
        progress.ended(result)
    return result
