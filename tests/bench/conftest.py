"""A dask cluster on this machine, for all tests that need one."""

from __future__ import annotations

import logging
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from collections.abc import Iterator

# Workers get this path, and import what the tests give them to do from it.
sys.path[:0] = [str(Path(__file__).parent / "compute"), str(Path(__file__).parent / "run")]


@pytest.fixture(scope="session")
def cluster_address() -> Iterator[str]:
    """Return the address of a dask cluster of two workers on this machine."""
    import dask
    from distributed import LocalCluster

    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": ":0", "silence_logs": logging.CRITICAL}
    # Over one item two workers may be lost; dask's default is three.
    with dask.config.set({"distributed.scheduler.allowed-failures": 2}), LocalCluster(**options) as cluster:
        yield cluster.scheduler_address
