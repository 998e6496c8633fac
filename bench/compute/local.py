"""Workers on this machine: this process alone, or processes of their own.

A worker is a process and a pipe, and has one item at a time, so that it is known over which item it died.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import pickle
import signal
import threading
from multiprocessing.connection import wait
from typing import TYPE_CHECKING, Any, Final

from bench.compute.executor import ATTEMPTS, ComputeError, Executor, WorkerLost
from bench.compute.work import perform, perform_pickled

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from multiprocessing.connection import Connection

    from bench.compute.work import Outcome, Work

__all__ = ["THREADS", "InProcess", "LocalExecutor"]

#: Environment variable with the number of threads of the simulation in a process.
THREADS: Final = "EVS_BENCH_THREADS"
_ALGEBRA: Final = "OPENBLAS_NUM_THREADS"
_HELLO: Final = b"ready"
_PATIENCE_S: Final = 5.0  #: for a worker that was asked to end


class InProcess(Executor):
    """One worker: this process."""

    _waiting: tuple[int, Work] | None = None

    def _room(self) -> int:
        return 1

    def _start(self, index: int, name: str, work: Work) -> None:
        del name
        self._waiting = index, work

    def _finished(self) -> tuple[int, Outcome]:
        if self._waiting is None:
            raise RuntimeError("nothing is under way")
        (index, work), self._waiting = self._waiting, None
        return index, perform(work)

    def _give_up(self) -> None:
        self._waiting = None


class LocalExecutor(Executor):
    """Processes on this machine. A worker that dies is replaced, and its item is done again.

    Parameters
    ----------
    workers
        Number of processes, 1 or more; each has its share of the processors for the simulation.
    setup, tell
        See :class:`~bench.compute.executor.Executor`.
    """

    def __init__(
        self, workers: int, setup: Callable[[], object] | None = None, tell: Callable[[str], None] | None = None
    ) -> None:
        if workers < 1:
            raise ComputeError(f"{workers} workers; expected 1 or more")
        super().__init__(setup, tell)
        self._threads = max(1, _processors() // workers)
        self._workers: list[_Worker | None] = [None] * workers

    def close(self) -> None:
        """End the processes: those that wait for an item by themselves, those that are at work at once."""
        self._give_up()
        for worker in filter(None, self._workers):
            worker.end()
        self._workers = [None] * len(self._workers)

    def _room(self) -> int:
        return len(self._workers)

    def _start(self, index: int, name: str, work: Work) -> None:
        free = next(i for i, worker in enumerate(self._workers) if worker is None or worker.job is None)
        self._give(free, _Job(index, name, pickle.dumps(work)))

    def _give(self, place: int, job: _Job) -> None:
        worker = self._workers[place] or _Worker(self._threads)
        self._workers[place] = worker
        worker.take(job)

    def _finished(self) -> tuple[int, Outcome]:
        while True:
            busy = {w.connection: i for i, w in enumerate(self._workers) if w is not None and w.job is not None}
            for connection in wait(list(busy)):
                found = self._look_at(busy[connection])  # type: ignore[index]
                if found is not None:
                    return found

    def _look_at(self, place: int) -> tuple[int, Outcome] | None:
        """Return the outcome that a worker has for us; None if it only said hello, or died and was replaced."""
        worker = self._workers[place]
        if worker is None or worker.job is None:
            return None
        job = worker.job
        try:
            answer = worker.receive()
        except (EOFError, OSError):
            self._replace(place, worker, job)
            return None
        return None if answer is None else (job.index, pickle.loads(answer))  # noqa: S301 - of our own worker

    def _replace(self, place: int, worker: _Worker, job: _Job) -> None:
        self._workers[place] = None
        how = worker.last_words()
        if not worker.ready:
            raise ComputeError(
                f"a worker process did not start ({how}); a script that uses workers needs the line "
                "if __name__ == '__main__'"
            )
        job.lost += 1
        if job.lost == ATTEMPTS:
            raise WorkerLost(f"{job.name}: its worker died {job.lost} times out of {job.lost} ({how})")
        self._tell(f"a worker died over {job.name} ({how}); the item is done again")
        self._give(place, job)

    def _give_up(self) -> None:
        """End the workers that are at work: a computation cannot be called back."""
        for i, worker in enumerate(self._workers):
            if worker is not None and worker.job is not None:
                worker.kill()
                self._workers[i] = None


class _Job:
    """An item on its way through a worker."""

    def __init__(self, index: int, name: str, work: bytes) -> None:
        self.index = index
        self.name = name
        self.work = work
        self.lost = 0  #: workers that died over it


class _Worker:
    """One process, as the executor sees it."""

    def __init__(self, threads: int) -> None:
        context = multiprocessing.get_context("spawn")
        self.connection, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs, threads), daemon=True)
        with _without_interrupts(), _one_thread_of_algebra():
            self._process.start()
        theirs.close()
        self.ready = False  #: it has said hello
        self.job: _Job | None = None

    def take(self, job: _Job) -> None:
        """Begin `job`; of a worker that is dead, :meth:`receive` will tell."""
        self.job = job
        with contextlib.suppress(OSError):
            self.connection.send_bytes(job.work)

    def receive(self) -> bytes | None:
        """Return the pickled outcome of the job; None if the worker said hello. EOFError, OSError: it died."""
        answer = self.connection.recv_bytes()
        if not self.ready:
            self.ready = answer == _HELLO
            return None
        self.job = None
        return answer

    def end(self) -> None:
        """Ask the process to end, and see to it."""
        self.connection.close()
        self._process.join(_PATIENCE_S)
        self.kill()

    def last_words(self) -> str:
        """Return how the process, whose pipe is closed, ended, for people."""
        self._process.join(_PATIENCE_S)  # the pipe closes a little before the exit code is there
        self.kill()
        return _ending(self._process.exitcode)

    def kill(self) -> None:
        """End the process at once."""
        self._process.kill()
        self._process.join()
        self.connection.close()


def _ending(code: int | None) -> str:
    if code is not None and code < 0:
        name = signal.Signals(-code).name if -code in {s.value for s in signal.Signals} else str(-code)
        return f"killed by {name}{', as when memory runs out' if name == 'SIGKILL' else ''}"
    return f"exit code {code}"


@contextlib.contextmanager
def _without_interrupts() -> Iterator[None]:
    """Hold Ctrl-C back meanwhile, also from a process that begins here: the executor alone is to hear of it."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextlib.contextmanager
def _one_thread_of_algebra() -> Iterator[None]:
    """Have a process that begins here load the linear algebra with one thread, unless the user set another number.

    Its own threads beside those of other workers wait for each other: a diagnosis took ten times as long.
    """
    if _ALGEBRA in os.environ:
        yield
        return
    os.environ[_ALGEBRA] = "1"
    try:
        yield
    finally:
        del os.environ[_ALGEBRA]


def _processors() -> int:
    """Return the number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _serve(connection: Connection[Any, Any], threads: int) -> None:
    """Do item after item, in a worker process, until the other end of the pipe is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ[THREADS] = str(threads)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with contextlib.suppress(EOFError, OSError):  # the executor is gone: so are we
        connection.send_bytes(_HELLO)
        while True:
            connection.send_bytes(perform_pickled(connection.recv_bytes()))


def _end_with_parent() -> None:
    """End this process when the one that started it is dead, also in the middle of an item."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
