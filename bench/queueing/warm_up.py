"""Waiting until a camera is warm: a time, or until its temperature stands still."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Callable

    from bench.queueing.schema import WarmUpSection
    from bench.run.stop import StopFlag
    from bench.station import Station

__all__ = ["WarmedUp", "warm_up"]

_LOOK_EVERY_S: Final = 10.0
_WINDOW_S: Final = 60.0
_TICK_S: Final = 1e-3  #: too short to wait for
_SLICE_S: Final = 1.0  #: of waiting, between two looks at the operator's wish to stop


@dataclass(frozen=True, slots=True)
class WarmedUp:
    """How a warm-up went."""

    waited_s: float
    temperature_c: float  #: at its end; NaN if the camera cannot tell
    steady: bool | None  #: whether the temperature stood still; None where that was not asked
    stopped: bool = False  #: by the operator

    def text(self) -> str:
        """Return it for people."""
        known = math.isfinite(self.temperature_c)
        at = f", the sensor is at {self.temperature_c:.1f} degC" if known else ""
        if self.steady is False:
            why = "its temperature does not stand still" if known else "the camera does not tell its temperature"
            at += f"; {why}, and the longest wait is over"
        return f"warmed up for {self.waited_s / 60.0:.1f} min{at}"


def warm_up(station: Station, wanted: WarmUpSection, stop: StopFlag, tell: Callable[[str], None]) -> WarmedUp:
    """Connect `station`, wait as `wanted`, and close it again; the light is dark meanwhile.

    Raises
    ------
    DeviceError
        If a device fails.
    """
    bound = "at most " if wanted.until_degc_per_minute is not None else ""
    tell(f"warming up for {bound}{wanted.longest_s / 60.0:.1f} min")
    with station:
        station.connect()
        return _Waiting(station, stop).wait(wanted)


class _Waiting:
    """Waits on the clock of a connected station, and reads the temperature meanwhile."""

    def __init__(self, station: Station, stop: StopFlag) -> None:
        self._station = station
        self._stop = stop
        self._begin_s = station.clock.now()
        self._readings: list[tuple[float, float]] = []

    def wait(self, wanted: WarmUpSection) -> WarmedUp:
        limit = wanted.until_degc_per_minute
        steady = None if limit is None else False
        while not self._stop.requested and wanted.longest_s - self._passed_s() > _TICK_S:
            self._read()
            if limit is not None and self._is_steady(limit):
                steady = True
                break
            self._sleep(min(_LOOK_EVERY_S, wanted.longest_s - self._passed_s()))
        self._read()
        return WarmedUp(self._passed_s(), self._readings[-1][1], steady, self._stop.requested)

    def _passed_s(self) -> float:
        return self._station.clock.now() - self._begin_s

    def _read(self) -> None:
        from bench.station.station import naming

        with naming(self._station.camera, "tell its temperature"):
            self._readings.append((self._passed_s(), self._station.camera.temperature_c()))

    def _is_steady(self, limit: float) -> bool:
        """Return whether the temperature moved by less than `limit` within the last minute."""
        now_s = self._readings[-1][0]
        if now_s < _WINDOW_S:
            return False
        window = [value for t_s, value in self._readings if t_s >= now_s - _WINDOW_S - _SLICE_S]
        return all(map(math.isfinite, window)) and max(window) - min(window) < limit

    def _sleep(self, seconds: float) -> None:
        """Sleep in slices, so that a wish to stop is seen soon."""
        end_s = self._passed_s() + seconds
        while (left_s := end_s - self._passed_s()) > _TICK_S and not self._stop.requested:
            self._station.clock.sleep(min(left_s, _SLICE_S))
