"""Running a protocol on a station: look it over, take its points into a run folder, take them again.

To look a protocol over takes little; what takes points is loaded when its name is first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from bench.run.check import CheckReport, Finding, check

if TYPE_CHECKING:
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

_HOME = {
    "Progress": "bench.run.progress",
    "RunResult": "bench.run.runner",
    "StopFlag": "bench.run.stop",
    "Task": "bench.run.runner",
    "assume_done": "bench.run.runner",
    "rerun": "bench.run.protocol_run",
    "resume": "bench.run.resuming",
    "run_protocol": "bench.run.protocol_run",
    "take_run": "bench.run.runner",
}


def __getattr__(name: str) -> Any:
    """Load a public name from the module that defines it."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)
