"""Executors of two workers: processes of this machine, and a dask cluster."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import pytest

from bench.compute import Executor, Workforce

Opener = Callable[..., Executor]


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
