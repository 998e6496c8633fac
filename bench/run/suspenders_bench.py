"""Conditions of the bench: room on the disk, temperature, steadiness of the light, errors of the transfer."""

from __future__ import annotations

import logging
import math
import shutil
from collections import deque
from typing import TYPE_CHECKING, Final

from drivers.errors import DeviceError

if TYPE_CHECKING:
    from pathlib import Path

    from drivers.interfaces import Clock, EventCamera, LightSource, RecordingQuality

__all__ = ["DiskRoom", "SensorTemperature", "SteadyLight", "TransferErrors"]

_log = logging.getLogger("evs_bench.run")
_MIB: Final = 1 << 20
_MARGIN: Final = 0.05  #: of a limit, or of a range, by which a value must be right again
_MARGIN_C: Final = 0.5  #: where a range has one end
_READINGS: Final = 5  #: of the light
_STEADY_AGAIN: Final = 0.8  #: of the limit that makes a run wait


def _words(error: DeviceError) -> str:
    return " ".join(str(error).split())


class DiskRoom:
    """Room on the disk of the run folder.

    Parameters
    ----------
    folder
        Of the run, or where it will be.
    free_mib
        What must be free, MiB; 5 % more before a run that waited goes on.
    """

    name = "disk_free_mib"

    def __init__(self, folder: Path, free_mib: float) -> None:
        self._folder = folder
        self._free_mib = free_mib
        self._waiting = False

    def why(self) -> str | None:
        """Return that there is too little room."""
        wanted = self._free_mib * (1.0 + _MARGIN if self._waiting else 1.0)
        folder = next(
            place for place in (self._folder.absolute(), *self._folder.absolute().parents) if place.exists()
        )
        free = shutil.disk_usage(folder).free / _MIB
        self._waiting = free < wanted
        return f"the disk of {folder} has {free:.0f} MiB free, {wanted:.0f} MiB are wanted" if self._waiting else None


class SensorTemperature:
    """The temperature of the sensor. One that the camera does not tell keeps nobody from measuring.

    Parameters
    ----------
    camera
        Whose sensor it is.
    low, high
        Limits, degrees Celsius; before a run that waited goes on, the temperature must be inside by 5 % of the range,
        or by 0.5 degrees where it has one end.
    """

    name = "temperature_c"

    def __init__(self, camera: EventCamera, low: float | None, high: float | None) -> None:
        self._camera = camera
        self._low = -math.inf if low is None else low
        self._high = math.inf if high is None else high
        width = self._high - self._low
        self._margin = _MARGIN * width if math.isfinite(width) else _MARGIN_C
        self._waiting = False
        self._told = False

    def why(self) -> str | None:
        """Return that the sensor is too cold or too warm."""
        try:
            now = self._camera.temperature_c()
        except DeviceError as error:
            return f"the temperature cannot be read: {_words(error)}"
        if math.isnan(now):
            self._tell_once()
            return None
        margin = self._margin if self._waiting else 0.0
        self._waiting = not self._low + margin <= now <= self._high - margin
        if not self._waiting:
            return None
        cold = now < self._low + margin
        limit = self._low + margin if cold else self._high - margin
        return f"the sensor has {now:.1f} C, at {'least' if cold else 'most'} {limit:.1f} C is wanted"

    def _tell_once(self) -> None:
        if not self._told:
            self._told = True
            _log.warning("%s does not tell its temperature: suspend.temperature_c does nothing", self._camera.name)


class SteadyLight:
    """The light of a source that measures it, at the level that it is left at.

    A run that waits makes the light dark. A source that is not steady because it is cold would stay so: as long as
    this is what the run waits for, it is lit again, at its last level.

    Parameters
    ----------
    light
        Measures its level.
    clock
        Of the station.
    within
        Largest difference of the readings, as a share of the largest; before a run that waited goes on, 0.8 of that.
    within_s
        Over so long a time, s.
    """

    name = "light_settled"

    def __init__(self, light: LightSource, clock: Clock, within: float, within_s: float) -> None:
        self._light = light
        self._clock = clock
        self._within = within
        self._within_s = within_s
        self._lit: float | None = None  # the level at which it was not steady, while the run waits

    def why(self) -> str | None:
        """Return that the light is not steady; without light there is nothing to look at."""
        try:
            return self._not_steady()
        except DeviceError as error:
            return f"the light cannot be read: {_words(error)}"

    def _not_steady(self) -> str | None:
        level = self._light.level()
        if self._lit is not None and level == 0.0:
            self._light.set_level(self._lit)
            level = self._lit
        if level == 0.0:
            return None
        readings = []
        for number in range(_READINGS):
            if number:
                self._clock.sleep(self._within_s / (_READINGS - 1))
            readings.append(self._light.level())
        change = (max(readings) - min(readings)) / max(*readings, 1e-12)
        limit = self._within * (_STEADY_AGAIN if self._lit is not None else 1.0)
        if change <= limit:
            self._lit = None
            return None
        if self._lit is None:
            self._lit = min(max(level, self._light.limits.lowest), self._light.limits.highest)
        return (
            f"the light is not steady: {min(readings):.5g} to {max(readings):.5g} {self._light.limits.unit} within "
            f"{self._within_s:g} s, {100.0 * change:.2g} %, at most {100.0 * limit:.2g} % is wanted"
        )


class TransferErrors:
    """Errors of the transfer from the camera, in the recordings of the last while.

    Parameters
    ----------
    camera
        Counts them for each recording.
    clock
        Of the station.
    at_most
        So many are let pass; before a run that waited goes on, there must be half as many.
    per_s
        In so long a time, s.
    """

    name = "usb_errors"

    def __init__(self, camera: EventCamera, clock: Clock, at_most: int, per_s: float) -> None:
        self._camera = camera
        self._clock = clock
        self._at_most = at_most
        self._per_s = per_s
        self._seen: deque[tuple[float, int]] = deque()
        self._last: RecordingQuality | None = None
        self._waiting = False

    def why(self) -> str | None:
        """Return that there were too many errors."""
        now_s = self._clock.now()
        try:
            self._look(now_s)
        except DeviceError as error:
            return f"the transfer errors cannot be read: {_words(error)}"
        while self._seen and self._seen[0][0] <= now_s - self._per_s:
            self._seen.popleft()
        errors = sum(count for _, count in self._seen)
        limit = self._at_most // 2 if self._waiting else self._at_most
        self._waiting = errors > limit
        if not self._waiting:
            return None
        return f"{self._camera.name}: {errors} transfer errors within {self._per_s:g} s, at most {limit} are wanted"

    def _look(self, now_s: float) -> None:
        """Count the errors of the last recording, unless they were counted before."""
        quality = self._camera.quality()
        if quality == self._last:
            return
        self._last = quality
        errors = quality.decode_errors + quality.dropped_buffers + quality.overflows
        if errors:
            self._seen.append((now_s, errors))
