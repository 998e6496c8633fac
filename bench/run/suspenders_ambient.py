"""Light of the room on the sensor: seen by how many events there are while the source is dark."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from bench.station.station import naming
from drivers.errors import DeviceError
from drivers.interfaces import Recording

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    import numpy.typing as npt

    from bench.station import Station
    from drivers.interfaces import Clock
    from protocols.points import Roi
    from protocols.suspend import Ambient

__all__ = ["AmbientLight", "DarkRecording", "chance_of_more"]

#: Probability below which more events than allowed are no chance, and above which they may be, once a run waits.
_SURE: Final = 1e-4
_SURE_NO_MORE: Final = 0.05
_POINT_FILES: Final = "points/*.h5"


class AmbientLight:
    """The rate of events in the dark, against that at the beginning of the run.

    Counts are compared as counts: with few events in the dark, even five times as many may be chance. Before a run
    that waited goes on, the events must be no more than chance makes of the rate that is allowed.

    Parameters
    ----------
    ambient
        How often to look, and how much more is allowed.
    clock
        Of the station.
    folder
        Of the run: its points are counted.
    dark_rate
        Takes a recording in the dark, and returns its events, and pixels times seconds.
    """

    name = "ambient"

    def __init__(
        self, ambient: Ambient, clock: Clock, folder: Path, dark_rate: Callable[[], tuple[int, float]]
    ) -> None:
        self._ambient = ambient
        self._clock = clock
        self._folder = folder
        self._dark_rate = dark_rate
        self._reference: tuple[int, float] | None = None
        self._looked_at = (0.0, 0)  # time and number of points when it was looked at last
        self._waiting = False

    def why(self) -> str | None:
        """Return that light of the room reaches the sensor; looked at when it is time, and while the run waits."""
        try:
            return self._too_bright()
        except DeviceError as error:
            self._waiting = True
            return f"no recording in the dark: {' '.join(str(error).split())}"

    def _too_bright(self) -> str | None:
        if self._reference is None:
            self._reference = self._dark_rate()
            self._note_time()
            self._waiting = False
            return None
        if not (self._waiting or self._is_due()):
            return None
        now = self._dark_rate()
        self._note_time()
        chance = chance_of_more(self._reference, now, self._ambient.at_most_factor)
        self._waiting = chance < (_SURE_NO_MORE if self._waiting else _SURE)
        return self._text(now) if self._waiting else None

    def _is_due(self) -> bool:
        time_s, points = self._looked_at
        if self._ambient.every_s is not None:
            return self._clock.now() - time_s >= self._ambient.every_s
        return self._points() - points >= (self._ambient.every_points or 1)

    def _note_time(self) -> None:
        self._looked_at = (self._clock.now(), self._points())

    def _points(self) -> int:
        return sum(1 for _ in self._folder.glob(_POINT_FILES))

    def _text(self, now: tuple[int, float]) -> str:
        events, pixel_s = self._reference or (0, 1.0)
        return (
            f"light of the room: {now[0] / now[1]:.3g} events/s per pixel in the dark ({now[0]} events), "
            f"{events / pixel_s:.3g} at the beginning ({events} events), at most {self._ambient.at_most_factor:g} "
            "times that is wanted; is a door or the shroud open?"
        )


def chance_of_more(reference: tuple[int, float], now: tuple[int, float], factor: float) -> float:
    """Return how likely so many events are if their rate is `factor` times that of the reference.

    Both are events, and pixels times seconds. Given the sum of two Poisson counts, each is binomial (J. Przyborowski
    and H. Wilenski, 1940), so that the rate itself need not be known.
    """
    from scipy.special import bdtrc

    total = reference[0] + now[0]
    if now[0] == 0:
        return 1.0
    share = factor * now[1] / (factor * now[1] + reference[1])
    return float(bdtrc(now[0] - 1, total, share))


class DarkRecording:
    """Takes a short recording with the source dark, always at the same settings, and counts its events.

    It leaves window, biases and light as it needs them: whoever believes to know them has to set them again.

    Parameters
    ----------
    station
        Connected.
    roi
        The window.
    biases
        Offsets from the factory codes.
    duration_s
        Length of the recording, s.
    settle_s
        From the light going out until the recording, s.
    """

    def __init__(
        self, station: Station, roi: Roi, biases: dict[str, int], duration_s: float = 2.0, settle_s: float = 1.0
    ) -> None:
        self._station = station
        self._roi = roi
        self._biases = biases
        self._duration_s = duration_s
        self._settle_s = settle_s
        self._number = 0

    def __call__(self) -> tuple[int, float]:
        """Return the events in the window, and pixels times seconds.

        Raises
        ------
        DeviceError
            A device failed.
        """
        station, roi = self._station, self._roi
        with naming(station.light, "go dark"):
            station.light.set_level(0.0)
        with naming(station.camera, "take a recording in the dark"):
            station.camera.set_roi(roi)
            station.camera.set_biases(self._biases)
            station.clock.sleep(self._settle_s)
            self._number += 1
            station.camera.start(Recording("dark", self._duration_s, self._number))
            station.clock.sleep(self._duration_s)
            station.camera.stop()
            events = sum(self._inside(chunk.events) for chunk in station.camera.chunks())
        return events, self._duration_s * roi.pixels

    def _inside(self, events: npt.NDArray[np.void]) -> int:
        roi = self._roi
        column, row = events["x"].astype(np.int64) - roi.x, events["y"].astype(np.int64) - roi.y
        return int(((column >= 0) & (column < roi.width) & (row >= 0) & (row < roi.height)).sum())
