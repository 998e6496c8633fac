"""Simulated cameras that kill their process, or fail, when a certain recording is read; for tests of workers."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from drivers.events.types import EventChunk
from drivers.interfaces import Recording
from sim_backend.devices.camera import SimulatedCamera


class DyingCamera(SimulatedCamera):
    """Dies in the middle of the recording with the label `fatal`.

    Parameters
    ----------
    fatal
        Label of the recording.
    marker
        File that says that it happened: it happens once. None: it happens each time.
    """

    def __init__(self, world: Any, *, fatal: str, marker: str | None = None, **more: Any) -> None:
        super().__init__(world, **more)
        self._fatal, self._label = fatal, ""
        self._marker = None if marker is None else Path(marker)

    def start(self, recording: Recording) -> None:
        super().start(recording)
        self._label = recording.label

    def chunks(self) -> Iterator[EventChunk]:
        for chunk in super().chunks():
            yield chunk
            if self._label == self._fatal:
                self._end()

    def _end(self) -> None:
        if self._marker is None or not self._marker.exists():
            if self._marker is not None:
                self._marker.touch()
            os.kill(os.getpid(), signal.SIGKILL)


class FailingCamera(DyingCamera):
    """Fails in the middle of the recording with the label `fatal`, as a driver does."""

    def _end(self) -> None:
        raise OSError(5, "Input/output error")
