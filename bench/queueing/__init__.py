"""A queue of runs: one after the other through the night, with reference runs between them, and resumable."""

from __future__ import annotations

from bench.queueing.checking import PlannedRun, check_queue
from bench.queueing.loading import LoadedQueue, load_queue
from bench.queueing.plan import QueuedRun
from bench.queueing.running import QueueResult, RunOutcome, resume_queue, run_queue
from bench.queueing.taking import QueueCrew

__all__ = [
    "LoadedQueue",
    "PlannedRun",
    "QueueCrew",
    "QueueResult",
    "QueuedRun",
    "RunOutcome",
    "check_queue",
    "load_queue",
    "resume_queue",
    "run_queue",
]
