"""A recording on disk, played back as an event camera: what was recorded comes again with each start and stop."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from drivers.errors import ConnectionFailed, WrongState
from drivers.events.raw import open_recording
from drivers.events.types import EventChunk
from drivers.interfaces import EventCamera, Limits, RecordingQuality
from protocols.errors import InputError
from protocols.points import Roi

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from drivers.events import raw
    from drivers.interfaces import Recording

__all__ = ["PlaybackCamera"]

_STEP_US: Final = 4096  # of TIME_HIGH
_TIME_HIGH: Final = 0x8
_LOOKED_AT: Final = 1 << 20  # bytes in which an EVT3 stream says its time, if it ever does
#: A recording does not say what its biases were, and they cannot be set: all are at 0.
_BIASES: Final = ("bias_fo", "bias_hpf", "bias_diff_on", "bias_diff", "bias_diff_off", "bias_refr")


class PlaybackCamera(EventCamera):
    """A camera that always sees the same.

    The window is cut out of what was recorded. Time 0 is the first TIME_HIGH of an EVT3 stream, the first event or
    trigger of another one.

    Parameters
    ----------
    path
        The recording, see :func:`drivers.events.raw.open_recording`.
    width, height
        Size of the sensor, pixels, where the file does not say it.
    name
        What the operator calls it.
    """

    def __init__(self, path: str | Path, *, width: int = 1280, height: int = 720, name: str = "camera") -> None:
        super().__init__(name)
        if min(width, height) < 1:
            raise InputError(f"{name}: the sensor is {width} x {height} pixels; expected 1 or more each")
        self.width = width
        self.height = height
        self.bias_limits = dict.fromkeys(_BIASES, Limits(0, 0, "offset"))
        self._path = Path(path)
        self._file: raw.Recording | None = None
        self._roi = Roi(0, 0, width, height)
        self._running = False
        self._taken: Roi | None = None  # window of the last recording
        self._read = False  # whether the file was read to its end, so that its faults are known

    def identity(self) -> dict[str, str]:
        """Return maker, model, serial number and firmware version, as far as the file tells."""
        self.require_connected("identify itself")
        fields = self._opened().header.fields
        return {
            "maker": fields.get("camera_integrator_name") or "not told",
            "model": f"recording {self._path.name} ({self._opened().format})",
            "serial": fields.get("serial_number") or "not told",
            "firmware": fields.get("firmware_version") or "not told",
        }

    def biases(self) -> dict[str, int]:
        """Return offsets of 0: those of the recording are not known."""
        self.require_connected("read the biases")
        return dict.fromkeys(self.bias_limits, 0)

    def refractory_s(self) -> float:
        """Return NaN: a recording cannot be asked."""
        self.require_connected("measure the dead time")
        return math.nan

    def temperature_c(self) -> float:
        """Return NaN: a recording cannot be asked."""
        self.require_connected("read the temperature")
        return math.nan

    def start(self, recording: Recording) -> None:  # noqa: ARG002 - it plays what it has
        """Begin; the recording does not know how long it takes, and is there when it is stopped."""
        self.require_connected("start a recording")
        self._require_idle("start a recording")
        self._taken, self._running, self._read = None, True, False

    def stop(self) -> None:
        """End: all that was recorded can be read."""
        self.require_connected("stop the recording")
        if not self._running:
            raise WrongState(self.name, "stop the recording", "no recording is running", "call start() first")
        self._running = False
        self._taken = self._roi

    def chunks(self) -> Iterator[EventChunk]:
        """Yield the recording, as far as it is in the window."""
        self.require_connected("read the recording")
        self._require_idle("read the recording")
        if self._taken is None:
            raise WrongState(self.name, "read the recording", "nothing was recorded", "call start() and stop() first")
        return self._played(self._opened(), self._taken)

    def quality(self) -> RecordingQuality:
        """Return what is known about the completeness of the file; it is read to its end for that, if need be."""
        self.require_connected("judge the recording")
        file = self._opened()
        if not self._read:
            for _ in file.chunks():
                """Only the counts are of interest."""
            self._read = True
        broken = file.violations
        jumps = broken.get("time_high_gap", 0)
        size = self._path.stat().st_size - file.header.data_offset
        return RecordingQuality(bytes_received=size, decode_errors=sum(broken.values()) - jumps, overflows=jumps)

    def _connect(self) -> None:
        try:
            file = open_recording(self._path)
            if file.width is None or file.height is None:
                file = open_recording(self._path, width=self.width, height=self.height)
        except InputError as error:
            raise ConnectionFailed(self.name, "open the recording", str(error), "is it the right file?") from error
        self._file = file
        self.width, self.height = file.width or self.width, file.height or self.height
        self._roi = Roi(0, 0, self.width, self.height)
        self._taken, self._running, self._read = None, False, False

    def _close(self) -> None:
        self._file, self._taken, self._running = None, None, False

    def _safe_state(self) -> None:
        if self._running:
            self.stop()

    def _set_roi(self, roi: Roi) -> None:
        self._require_idle("set the window")
        self._roi = roi

    def _set_biases(self, offsets: Mapping[str, int]) -> None:  # noqa: ARG002 - all are 0, or they were refused
        self._require_idle("set biases")

    def _played(self, file: raw.Recording, roi: Roi) -> Iterator[EventChunk]:
        origin_us = self._first_step_us(file)
        for chunk in file.chunks():
            events, triggers = chunk.events, chunk.triggers
            if origin_us is None:
                origin_us = min(int(array["t"][0]) for array in (events, triggers) if len(array))
            x, y = events["x"].astype(np.int64) - roi.x, events["y"].astype(np.int64) - roi.y
            events = events[(x >= 0) & (x < roi.width) & (y >= 0) & (y < roi.height)]
            triggers = triggers.copy()
            events["t"] -= origin_us
            triggers["t"] -= origin_us
            yield EventChunk(events, triggers)
        self._read = True

    def _first_step_us(self, file: raw.Recording) -> int | None:
        """Return the time that an EVT3 stream says first, us; None for another format."""
        if not file.format.startswith("EVT3"):
            return None
        with self._path.open("rb") as stream:
            stream.seek(file.header.data_offset)
            head = stream.read(_LOOKED_AT)
        words = np.frombuffer(head, "<u2", len(head) // 2)
        steps = words[words >> 12 == _TIME_HIGH]
        return int(steps[0] & 0xFFF) * _STEP_US if len(steps) else None

    def _opened(self) -> raw.Recording:
        if self._file is None:
            raise WrongState(self.name, "read the recording", "it is not open", "call connect() first")
        return self._file

    def _require_idle(self, asked: str) -> None:
        if self._running:
            raise WrongState(self.name, asked, "a recording is running", "call stop() first")
