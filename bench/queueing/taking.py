"""Taking one run of a queue: begin it or go on with it, and say what became of it whatever happens."""

from __future__ import annotations

import contextlib
import logging
import math
import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

from bench.notices import Notice, facts_of, with_notices
from bench.notices.notice import one_line
from bench.queueing.outcome import RunOutcome
from bench.queueing.warm_up import warm_up
from bench.run import resume, run_protocol
from bench.run.stop import StopFlag
from bench.store.layout import JOURNAL_FILE, PART_SUFFIX, POINTS_FOLDER, RUN_FILE
from drivers.errors import DeviceError
from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from bench.compute import Workforce
    from bench.notices import Notifier, RunFacts
    from bench.queueing.journal import QueueJournal
    from bench.queueing.loading import LoadedQueue
    from bench.queueing.plan import QueuedRun
    from bench.queueing.schema import WarmUpSection
    from bench.run import RunResult
    from bench.run.progress import Progress
    from bench.station import Station

__all__ = ["QueueCrew", "RunTaker"]

_log = logging.getLogger("evs_bench.queue")


@dataclass(frozen=True, slots=True)
class QueueCrew:
    """Who sees to the runs of a queue."""

    tell: Callable[[str], None]  #: what an operator should know, a line each
    progress: Callable[[], Progress]  #: makes one for each run
    operator: Callable[[str], None] | None = None  #: see :func:`~bench.run.runner.take_run`
    workforce: Workforce | None = None
    notifier: Notifier | None = None


class RunTaker:
    """Takes runs of one queue into its folder.

    Parameters
    ----------
    queue
        The queue.
    folder
        Its folder.
    journal
        Of the queue.
    crew
        Who sees to it.
    stop
        The operator's wish to stop.
    """

    def __init__(
        self, queue: LoadedQueue, folder: Path, journal: QueueJournal, crew: QueueCrew, stop: StopFlag
    ) -> None:
        self._queue = queue
        self._folder = folder
        self._journal = journal
        self._crew = crew
        self._stop = stop

    def take(self, run: QueuedRun, wanted: WarmUpSection | None) -> RunOutcome:
        """Take one run, after the warm-up that is `wanted`; what goes wrong with it is in what is returned.

        Raises
        ------
        InputError
            If the journal of the queue cannot be written.
        KeyboardInterrupt
            If the operator wants to stop at once.
        """
        begin_s = time.monotonic()
        folder = self._folder / run.folder
        self._journal.note("run_started", run=run.number, name=run.name, folder=run.folder)
        try:
            outcome = self._attempt(run, folder, wanted)
        except BaseException as error:
            if isinstance(error, Exception):
                raise
            self._journal.note("run_stopped", run=run.number, reason=one_line(str(error)) or "stopped at once")
            raise
        outcome = replace(outcome, took_s=round(time.monotonic() - begin_s, 3))
        self._journal.note(f"run_{outcome.state}", run=run.number, **outcome.journal_facts())
        return outcome

    def _attempt(self, run: QueuedRun, folder: Path, wanted: WarmUpSection | None) -> RunOutcome:
        station: Station | None = None
        try:
            station = self._queue.stations[run.station].load()
            if wanted is not None and not self._warmed_up(run, station, wanted):
                return RunOutcome(run, folder, "stopped", reason="stopped by the operator in the warm-up")
            # A flag of its own: a run that is given up, as its protocol says, does not stop the others.
            stop = StopFlag(self._wished)
            result = self._result(run, station, folder, stop)
        except Exception as error:  # noqa: BLE001 - the night goes on: each failure is told and kept with its run
            _log.error("run %d failed", run.number, exc_info=error)
            unsafe = station is not None and bool(station.unsafe)
            return self._told(replace(_failure(run, folder, error), unsafe=unsafe))
        return self._outcome(run, folder, result, stop)

    def _told(self, outcome: RunOutcome) -> RunOutcome:
        """Return `outcome`, a failure, after those who asked for it were told."""
        if self._crew.notifier is not None:
            run, text = outcome.run, outcome.reason or ""
            title = f"run {run.number} of {len(self._queue.runs)} ({run.name}) of queue {self._queue.title}"
            notice = Notice("failure", title, text, station=run.station, run=str(outcome.folder))
            self._crew.notifier.tell(notice)
        return outcome

    def _warmed_up(self, run: QueuedRun, station: Station, wanted: WarmUpSection) -> bool:
        """Warm up; return whether the operator let it come to its end."""
        done = warm_up(station, wanted, self._stop, self._crew.tell)
        if station.unsafe:
            raise station.unsafe[0]
        self._crew.tell(done.text())
        self._journal.note(
            "warmed_up",
            run=run.number,
            waited_s=done.waited_s,
            temperature_c=done.temperature_c if math.isfinite(done.temperature_c) else None,
            steady=done.steady,
        )
        return not done.stopped

    def _result(self, run: QueuedRun, station: Station, folder: Path, stop: StopFlag) -> RunResult:
        _clear_unbegun(folder)
        crew = self._crew
        loaded = self._queue.protocols[run.protocol]

        def facts() -> RunFacts:
            return facts_of(loaded.protocol, station.name, folder)

        def take(progress: Progress) -> RunResult:
            operator, workforce = crew.operator, crew.workforce
            if folder.exists():
                return resume(
                    folder, station=station, progress=progress, stop=stop, operator=operator, workforce=workforce
                )
            return run_protocol(
                loaded, station, folder, seed=run.seed, progress=progress, stop=stop, operator=operator,
                workforce=workforce,
            )  # fmt: skip

        return with_notices(take, crew.progress(), crew.notifier, facts, tell_outcome=False)

    def _wished(self, text: str) -> None:
        """Take Ctrl-C in a run as the wish to stop the whole queue."""
        self._stop.request()
        self._crew.tell(text)

    def _outcome(self, run: QueuedRun, folder: Path, result: RunResult, stop: StopFlag) -> RunOutcome:
        """Return what became of a run that was not ended by an error."""
        skipped = getattr(result, "skipped", 0)
        outcome = RunOutcome(run, folder, "done", result.done, result.total)
        if not result.stopped:
            return replace(outcome, reason=f"{skipped} points skipped") if skipped else outcome
        if self._stop.requested:
            return replace(outcome, state="stopped", reason="stopped by the operator")
        reason = getattr(stop, "reason", None) if stop.requested else None
        return replace(outcome, state="suspended", reason=reason or "it was left before its last point")


def _failure(run: QueuedRun, folder: Path, error: Exception) -> RunOutcome:
    from bench.compute.executor import ItemFailed

    inner = error.error if isinstance(error, ItemFailed) else error
    cause: Literal["device", "input", "bug"] = "bug"
    if isinstance(inner, DeviceError):
        cause = "device"
    elif isinstance(inner, InputError | OSError | MemoryError):
        cause = "input"
    text = one_line(str(inner)) or type(inner).__name__
    return RunOutcome(
        run, folder, "failed", reason=text if cause != "bug" else f"{type(inner).__name__}: {text}", cause=cause
    )


def _clear_unbegun(folder: Path) -> None:
    """Remove the folder of a run that was killed before its first point was planned: there is no data in it.

    Anything that such a run does not leave keeps the folder where it is.
    """
    points = folder / POINTS_FOLDER
    journal = folder / JOURNAL_FILE
    if not folder.is_dir() or (points.is_dir() and any(points.iterdir())):
        return
    if (folder / RUN_FILE).exists() and journal.exists() and journal.stat().st_size:
        return
    for name in (RUN_FILE, RUN_FILE + PART_SUFFIX, JOURNAL_FILE):
        (folder / name).unlink(missing_ok=True)
    with contextlib.suppress(OSError):
        points.rmdir()
        folder.rmdir()
