"""Workers on other machines, through a dask scheduler.

The scheduler knows which worker has which item, and gives the item of a lost one to another, a limited number of
times.
"""

from __future__ import annotations

import functools
import itertools
import logging
import os
import pickle
import uuid
from concurrent.futures import CancelledError
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

from bench.compute.executor import ComputeError, Executor, WorkerLost
from bench.compute.local import THREADS
from bench.compute.same_software import require_same_software, software
from bench.compute.work import Failure, Outcome, perform_pickled

if TYPE_CHECKING:
    from collections.abc import Callable

    from bench.compute.work import Work

__all__ = ["ClusterExecutor"]

_ANSWER_S: Final = 10.0  #: a scheduler that is there answers sooner
_WORKERS_S: Final = 30.0  #: so long is waited for the first worker
_LOOK_S: Final = 5.0  #: so often is looked whether there are workers


class ClusterExecutor(Executor):
    """Workers of a dask cluster: one item for each of their threads at a time.

    Parameters
    ----------
    address
        Of the scheduler, ``tcp://HOST:PORT``.
    setup, tell
        See :class:`~bench.compute.executor.Executor`.

    Raises
    ------
    ComputeError
        The extra `cluster` is not installed, no scheduler answers, or it has no workers.
    """

    def __init__(
        self, address: str, setup: Callable[[], object] | None = None, tell: Callable[[str], None] | None = None
    ) -> None:
        super().__init__(setup, tell)
        same = functools.partial(require_same_software, software())
        self._setup = replace(self._setup, functions=(same, *self._setup.functions))
        try:
            from distributed import Client
        except ImportError:
            raise ComputeError("a cluster needs dask.distributed: install the extra, evs-bench[cluster]") from None
        logging.getLogger("distributed.client").setLevel(logging.CRITICAL)  # what it would tell, we raise
        self._address = address
        self._under_way: dict[Any, tuple[int, str]] = {}  #: index and name, by future
        self._keys = (f"evs-bench-{uuid.uuid4().hex[:8]}-{n}" for n in itertools.count())
        try:
            self._client = Client(address, timeout=_ANSWER_S, set_as_default=False)
        except (OSError, ValueError) as error:
            raise ComputeError(f"cluster {address}: no scheduler answers there ({_first_line(error)})") from None
        try:
            self._client.wait_for_workers(1, timeout=_WORKERS_S)
        except TimeoutError:
            self.close()
            raise ComputeError(
                f"cluster {address}: has no workers; start some with: dask worker {address} --nthreads 1"
            ) from None
        except OSError:
            self.close()
            raise self._scheduler_gone() from None

    def close(self) -> None:
        """Give up what is under way, and leave the cluster, which goes on."""
        self._give_up()
        self._client.close()

    def _room(self) -> int:
        threads: dict[str, int] = self._client.nthreads()  # by worker
        return max(1, sum(threads.values()))

    def _start(self, index: int, name: str, work: Work) -> None:
        future = self._client.submit(_perform, pickle.dumps(work), key=next(self._keys), pure=False)
        self._under_way[future] = index, name

    def _finished(self) -> tuple[int, Outcome]:
        from distributed import KilledWorker

        future = None
        try:
            future = self._next_done()
            index, name = self._under_way.pop(future)
            return index, pickle.loads(future.result())  # noqa: S301 - of our own worker
        except KilledWorker as error:
            raise WorkerLost(
                f"{name}: its worker died time after time, at last {error.last_worker.address}"
            ) from None
        except (OSError, CancelledError):
            raise self._scheduler_gone() from None
        except Exception as error:
            if future is None:
                raise
            return index, Outcome(failure=Failure.of(error))

    def _scheduler_gone(self) -> ComputeError:
        return ComputeError(f"cluster {self._address}: the scheduler is gone")

    def _next_done(self) -> Any:
        """Return a future that is done; tell the operator while there is nobody to wait for."""
        from distributed import wait

        told = False
        while True:
            try:
                with self._client.as_current():
                    done = wait(list(self._under_way), timeout=_LOOK_S, return_when="FIRST_COMPLETED").done
                return next(iter(done))
            except TimeoutError:
                if not told and not self._client.nthreads():
                    self._tell(f"cluster {self._address}: no worker is left; the run goes on when there is one again")
                    told = True

    def _give_up(self) -> None:
        futures, self._under_way = list(self._under_way), {}
        if futures:
            self._client.cancel(futures, force=True)


def _perform(work: bytes) -> bytes:
    """Do an item on a worker, with one thread, as dask counts them, unless the environment says otherwise."""
    os.environ.setdefault(THREADS, "1")
    return perform_pickled(work)


def _first_line(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]
