"""Running a protocol on a station: look it over, take its points into a run folder, take them again."""

from __future__ import annotations

from bench.run.check import CheckReport, Finding, check
from bench.run.progress import Progress
from bench.run.protocol_run import rerun, run_protocol
from bench.run.resuming import resume
from bench.run.runner import RunResult, Task, assume_done, take_run
from bench.run.stop import StopFlag

__all__ = [
    "CheckReport",
    "Finding",
    "Progress",
    "RunResult",
    "StopFlag",
    "Task",
    "assume_done",
    "check",
    "rerun",
    "resume",
    "run_protocol",
    "take_run",
]
