"""Who computes, as the operator says it: this process, some processes, or a cluster."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from bench.compute.executor import Executor

__all__ = ["Workforce"]


@dataclass(frozen=True, slots=True)
class Workforce:
    """Processes on this machine, or the workers of a dask cluster. Results are the same for all."""

    workers: int = 1  #: processes on this machine; 1 is this process
    cluster: str | None = None  #: address of a dask scheduler, instead
    setup: Callable[[], object] | None = None
    """What each worker does once before its first item, e.g. loading a user's own effects; it is pickled."""

    @property
    def alone(self) -> bool:
        """Whether this process does it all."""
        return self.cluster is None and self.workers == 1

    def open(self, tell: Callable[[str], None] | None = None) -> Executor:
        """Return the executor; close it, or use it as a context manager.

        Parameters
        ----------
        tell
            Called with a line for the operator when a worker was lost.

        Raises
        ------
        ComputeError
            The cluster does not answer or has no workers, or the number of workers is below 1.
        """
        if self.cluster is not None:
            from bench.compute.cluster import ClusterExecutor

            return ClusterExecutor(self.cluster, self.setup, tell)
        from bench.compute.local import InProcess, LocalExecutor

        return InProcess(self.setup, tell) if self.workers == 1 else LocalExecutor(self.workers, self.setup, tell)
