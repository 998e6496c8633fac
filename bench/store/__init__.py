"""The run folder: written by the runner and the importer, read by everything else.

The format is ``evs-bench-run/1``. :class:`~bench.store.run.Run` reads one, :class:`~bench.store.writer.RunWriter`
writes one.
"""

from __future__ import annotations

from bench.store.data import PointData, RunHeader, Sensor
from bench.store.errors import RunError
from bench.store.run import Run
from bench.store.writer import RunWriter

__all__ = ["PointData", "Run", "RunError", "RunHeader", "RunWriter", "Sensor"]
