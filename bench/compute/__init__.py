"""Doing many independent things at once, by processes on this machine or on several."""

from __future__ import annotations

from bench.compute.executor import ComputeError, Executor, ItemFailed, WorkerLost
from bench.compute.workforce import Workforce

__all__ = ["ComputeError", "Executor", "ItemFailed", "WorkerLost", "Workforce"]
