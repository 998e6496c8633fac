"""Simulated cameras that kill their process, or fail, when a certain recording is read; for tests of workers."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from drivers.events.types import EVENT_DTYPE, EventChunk, empty_triggers
from sim_backend.devices.camera import SimulatedCamera

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivers.interfaces import Recording


class QuickCamera(SimulatedCamera):
    """A camera whose events are noise from the seed of the recording: nothing to compile, nothing to wait for."""

    def start(self, recording: Recording) -> None:
        super().start(recording)
        self._seed, self._label = recording.seed, recording.label

    def chunks(self) -> Iterator[EventChunk]:
        rng = np.random.default_rng(self._seed)
        events = np.empty(20_000, EVENT_DTYPE)
        events["t"] = np.sort(rng.integers(0, 250_000, len(events)))
        events["x"], events["y"] = rng.integers(10, 14, len(events)), rng.integers(20, 23, len(events))
        events["p"] = rng.integers(0, 2, len(events))
        yield EventChunk(events, empty_triggers())


class DyingCamera(SimulatedCamera):
    """Dies in the middle of the recording with the label `fatal`, once.

    Parameters
    ----------
    fatal
        Label of the recording.
    marker
        File that says that it happened.
    """

    def __init__(self, world: Any, *, fatal: str, marker: str, **more: Any) -> None:
        super().__init__(world, **more)
        self._fatal, self._marker, self._label = fatal, Path(marker), ""

    def start(self, recording: Recording) -> None:
        super().start(recording)
        self._label = recording.label

    def chunks(self) -> Iterator[EventChunk]:
        for chunk in super().chunks():
            yield chunk
            if self._label == self._fatal and not self._marker.exists():
                self._marker.touch()
                os.kill(os.getpid(), signal.SIGKILL)


class DeadlyCamera(QuickCamera):
    """Dies each time that point 1 is read."""

    def chunks(self) -> Iterator[EventChunk]:
        yield from super().chunks()
        if self._label == "on 1":
            self.end()

    def end(self) -> None:
        """Die."""
        os.kill(os.getpid(), signal.SIGKILL)


class FailingCamera(DeadlyCamera):
    """Fails when point 1 is read, as a driver does."""

    def end(self) -> None:
        """Fail."""
        raise OSError(5, "Input/output error")
