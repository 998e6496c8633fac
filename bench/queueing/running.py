"""Working through a queue, and going on with one that was stopped or killed."""

from __future__ import annotations

import contextlib
import logging
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from bench.logs import LOG_FILE, log_into
from bench.notices import Notice
from bench.notices.notice import one_line
from bench.queueing.journal import JOURNAL_FORMAT, QUEUE_FILE, Past, QueueJournal, read_past
from bench.queueing.loading import difference_problems, restored_queue
from bench.queueing.outcome import QueueResult, RunOutcome, State
from bench.queueing.taking import RunTaker
from bench.run.runner import new_run_id
from bench.run.stop import StopFlag
from bench.store.durable import sync_folder, write_whole
from protocols.errors import InputError
from protocols.files import read_text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bench.notices import Kind
    from bench.queueing.loading import LoadedQueue
    from bench.queueing.plan import QueuedRun
    from bench.queueing.schema import WarmUpSection
    from bench.queueing.taking import QueueCrew

__all__ = ["QueueResult", "RunOutcome", "asked_for", "resume_queue", "run_queue"]

_log = logging.getLogger("evs_bench.queue")
_STATES: Final[dict[str, State]] = {
    "run_done": "done",
    "run_failed": "failed",
    "run_suspended": "suspended",
    "run_stopped": "stopped",
}


def run_queue(queue: LoadedQueue, out: Path | None, crew: QueueCrew, stop: StopFlag | None = None) -> QueueResult:
    """Take all runs of `queue`, each into a folder of its own below that of the queue.

    Parameters
    ----------
    queue
        The queue; :func:`bench.queueing.checking.check_queue` has looked it over.
    out
        The folder to make; default is ``runs/ID``.
    crew
        Who sees to it.
    stop
        The operator's wish to stop, looked at between two runs; Ctrl-C is listened to meanwhile, also in a run.

    Raises
    ------
    InputError
        If the folder exists, or its journal cannot be written.
    KeyboardInterrupt
        If the operator wants to stop at once.
    """
    folder = out or Path("runs") / new_run_id(queue.title)
    _make_folder(folder)
    write_whole(folder / QUEUE_FILE, queue.text, ".part")
    with QueueJournal(folder) as journal:
        journal.note(
            "queue_started", format=JOURNAL_FORMAT, title=queue.title, runs=len(queue.runs), **queue.to_dict()
        )
        return _Work(queue, folder, journal, crew, stop, Past({}, {}, frozenset())).all()


def asked_for(folder: Path, file: Path | None = None) -> tuple[LoadedQueue, Past]:
    """Return the queue in `folder` as it was asked for, and what happened to it so far.

    Parameters
    ----------
    folder
        The folder of the queue.
    file
        The queue file, if the operator names it once more.

    Raises
    ------
    InputError
        If there is no queue; or with all that differs, if the queue or a station was changed since.
    """
    past = read_past(folder)
    written = str(past.asked["queue"])
    for path in (folder / QUEUE_FILE, *([] if file is None else [file])):
        problems = difference_problems(written, read_text(path), str(path)) if path.exists() or file else []
        if problems:
            hint = "what was asked for is what is resumed; put it back, or begin a new queue with what is left"
            raise InputError(*problems, hint)
    return restored_queue(past.asked), past


def resume_queue(
    queue: LoadedQueue, past: Past, folder: Path, crew: QueueCrew, stop: StopFlag | None = None
) -> QueueResult:
    """Take the rest of a queue that was stopped or killed.

    A run that is done is not taken again; one that was begun, or has failed, is gone on with; the others follow.

    Parameters
    ----------
    queue, past
        What :func:`asked_for` returned.
    folder
        The folder of the queue.
    crew, stop
        As for :func:`run_queue`, also for what is raised.
    """
    with QueueJournal(folder) as journal:
        journal.note("queue_resumed")
        return _Work(queue, folder, journal, crew, stop, past).all()


def _make_folder(folder: Path) -> None:
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        folder.mkdir()
        sync_folder(folder.parent)
    except FileExistsError:
        raise InputError(
            f"{folder}: exists already, and a queue never overwrites; choose another name, or go on with it: "
            f"evs-bench queue --resume {folder}"
        ) from None
    except OSError as error:
        raise InputError(f"{folder}: cannot be made: {error.strerror}") from None


class _Work:
    """One way through a queue."""

    def __init__(
        self,
        queue: LoadedQueue,
        folder: Path,
        journal: QueueJournal,
        crew: QueueCrew,
        stop: StopFlag | None,
        past: Past,
    ) -> None:
        self._queue = queue
        self._folder = folder
        self._journal = journal
        self._crew = crew
        self._stop = stop or StopFlag(crew.tell)
        self._past = past
        self._taker = RunTaker(queue, folder, journal, crew, self._stop)

    def all(self) -> QueueResult:
        """Take all runs that are left."""
        with self._stop.listening(), log_into(self._folder / LOG_FILE):
            try:
                outcomes = self._outcomes()
            except BaseException as error:
                reason = one_line(str(error)) or type(error).__name__
                with contextlib.suppress(InputError):  # a full disk must not keep the notice from being sent
                    self._journal.note("queue_stopped", reason=reason)
                if isinstance(error, KeyboardInterrupt):
                    self._tell("end", f"stopped at once, in {self._folder}")
                    raise KeyboardInterrupt(self._stopped_at_once()) from error
                self._tell("failure", reason)
                raise
            result = QueueResult(self._folder, self._queue.title, tuple(outcomes), self._stopped(outcomes))
            cut = result.stopped_by_operator or result.count("not begun") > 0
            self._journal.note("queue_stopped" if cut else "queue_finished", reason=result.text)
            self._tell("end", f"{result.text}, in {self._folder}")
            return result

    def _stopped(self, outcomes: Sequence[RunOutcome]) -> bool:
        """Return whether the operator stopped the queue before its end."""
        return self._stop.requested and any(outcome.state in ("stopped", "not begun") for outcome in outcomes)

    def _stopped_at_once(self) -> str:
        return (
            f"stopped at once; what was being taken is not kept, go on with: evs-bench queue --resume {self._folder}"
        )

    def _outcomes(self) -> list[RunOutcome]:
        outcomes: list[RunOutcome] = []
        going_on = True
        cold = True
        for run in self._queue.runs:
            earlier = self._past.outcomes.get(run.number)
            if earlier is not None and earlier["state"] == "run_done":
                outcomes.append(_remembered(run, self._folder, earlier))
            elif not going_on or self._stop.requested:
                outcomes.append(self._left(run, earlier))
            else:
                wanted = self._last_warm_up(run) if cold else run.warm_up
                cold = False
                outcomes.append(self._taken(run, wanted))
                going_on = self._may_go_on(outcomes[-1])
        return outcomes

    def _taken(self, run: QueuedRun, wanted: WarmUpSection | None) -> RunOutcome:
        what = f"{run.protocol} on {run.station}" + (", the reference" if run.is_reference else "")
        self._crew.tell(f"run {run.number} of {len(self._queue.runs)}: {what}")
        outcome = self._taker.take(run, wanted)
        if outcome.state == "failed":
            self._crew.tell(f"run {run.number} failed: {outcome.reason}")
        return outcome

    def _last_warm_up(self, run: QueuedRun) -> WarmUpSection | None:
        """Return the warm-up before `run`, its own or one before: what was warm when the queue ended is cold now."""
        warm_ups = [r.warm_up for r in self._queue.runs if r.number <= run.number and r.warm_up is not None]
        return warm_ups[-1] if warm_ups else None

    def _left(self, run: QueuedRun, earlier: dict[str, Any] | None) -> RunOutcome:
        if earlier is None:
            return RunOutcome(run, self._folder / run.folder, "not begun")
        return _remembered(run, self._folder, earlier)

    def _may_go_on(self, outcome: RunOutcome) -> bool:
        """Return whether the next run may begin."""
        if outcome.state == "done":
            return True
        if outcome.unsafe:
            self._crew.tell("a device could not be brought to its safe state: the queue stops, see to it")
            return False
        return outcome.state in ("failed", "suspended") and outcome.run.on_failure == "next"

    def _tell(self, kind: Kind, text: str) -> None:
        if self._crew.notifier is not None:
            self._crew.notifier.tell(Notice(kind, f"queue {self._queue.title}", text, run=str(self._folder)))


def _remembered(run: QueuedRun, folder: Path, line: dict[str, Any]) -> RunOutcome:
    """Return what the journal of the queue tells of a run."""
    return RunOutcome(
        run,
        folder / run.folder,
        _STATES[line["state"]],
        points_done=line.get("points_done"),
        points=line.get("points"),
        reason=line.get("reason"),
        cause=line.get("cause"),
        took_s=line.get("took_s"),
    )
