"""Executors of every kind: this process, two processes, a dask cluster of two workers."""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from bench.compute import Executor, Workforce

sys.path.insert(0, str(Path(__file__).parent))  # workers get this path, and import worker_functions from it

Opener = Callable[..., Executor]


@pytest.fixture(scope="session")
def cluster_address() -> Iterator[str]:
    """Return the address of a dask cluster of two workers on this machine."""
    import dask
    from distributed import LocalCluster

    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None, "silence_logs": logging.CRITICAL}
    # Over one item two workers may be lost; dask's default is three.
    with dask.config.set({"distributed.scheduler.allowed-failures": 2}), LocalCluster(**options) as cluster:
        yield cluster.scheduler_address


@pytest.fixture(params=["processes", pytest.param("cluster", marks=pytest.mark.slow)])
def workforce(request: pytest.FixtureRequest) -> Workforce:
    """Return two workers, on this machine and on a cluster."""
    if request.param == "processes":
        return Workforce(workers=2)
    return Workforce(cluster=request.getfixturevalue("cluster_address"))


@pytest.fixture
def open_executor(workforce: Workforce) -> Iterator[Opener]:
    """Return a maker of executors; they are closed at the end."""
    opened: list[Executor] = []

    def make(setup: Callable[[], None] | None = None, tell: Callable[[str], None] | None = None) -> Executor:
        opened.append(replace(workforce, setup=setup).open(tell))
        return opened[-1]

    yield make
    for executor in opened:
        executor.close()
