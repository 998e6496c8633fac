"""Independent tasks on several processes."""

from __future__ import annotations

import multiprocessing
from concurrent.futures import ProcessPoolExecutor, as_completed
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

__all__ = ["results_of"]

T = TypeVar("T")
R = TypeVar("R")


def results_of(function: Callable[[T], R], tasks: Sequence[T], workers: int | None) -> Iterator[R]:
    """Yield ``function(task)`` of each task as it gets ready, in any order; what one raises is raised.

    Parameters
    ----------
    function
        Of a module, so that it can be sent to another process.
    workers
        Number of processes, None for one for each processor; with 1 all is done in this one, in order.
    """
    from sim_backend.pixel.engines.reference import processors

    if (workers or processors()) == 1:
        yield from map(function, tasks)
        return
    # Fresh processes: the threads of compiled code do not survive a fork.
    with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn")) as pool:
        futures = [pool.submit(function, task) for task in tasks]
        try:
            for future in as_completed(futures):
                yield future.result()
        finally:
            for future in futures:
                future.cancel()
