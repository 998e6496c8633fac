"""Reaching the devices again after one failed: close all, connect all, and make sure that they are the same ones."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from bench.run.differences import differences
from bench.run.recorder import Recorder
from bench.station.station import DevicesFailed
from drivers.errors import ConnectionFailed, DeviceError

if TYPE_CHECKING:
    from bench.run.deadline import Watchdog
    from bench.station import Station
    from protocols.points import Roi
    from protocols.policy import Reconnect

__all__ = ["OtherDevices", "Rig"]

_log = logging.getLogger("evs_bench.run")


class OtherDevices(ConnectionFailed):
    """The devices that answer are not those that the run was begun with."""


class Rig:
    """A connected station, and what is believed of its settings.

    Parameters
    ----------
    station
        Connected.
    roi
        The run's window.
    reconnect
        How often it is tried to reach the devices again.
    watchdog
        What cuts a step short that hangs.
    """

    def __init__(self, station: Station, roi: Roi, reconnect: Reconnect, watchdog: Watchdog) -> None:
        self.station = station
        self.recorder = Recorder(station, roi)
        self._roi = roi
        self._policy = reconnect
        self._watchdog = watchdog
        self._begun = station.identities()

    def forget(self) -> None:
        """Believe nothing of the settings any more: all are set again before the next point."""
        self.recorder = Recorder(self.station, self._roi)

    def reconnect(self) -> None:
        """Close all devices, and reach them again.

        Raises
        ------
        DevicesFailed
            They could not be reached; also says which could not be brought to their safe state.
        OtherDevices
            They are not the ones that the run was begun with.
        """
        self.forget()
        unsafe: dict[str, DeviceError] = {}
        for number in range(1, self._policy.attempts + 1):
            self.station.close()
            unsafe |= {error.device: error for error in self.station.unsafe}
            try:
                with self._watchdog.step("reconnect", 0.0):
                    self.station.connect()
            except DeviceError as error:
                _log.warning("reconnecting, attempt %d of %d: %s", number, self._policy.attempts, error)
                if number == self._policy.attempts:
                    raise DevicesFailed(self.station.name, (error, *unsafe.values())) from error
                self.station.clock.sleep(self._policy.wait_s)
            else:
                self._require_same()
                _log.info("reconnected, attempt %d of %d", number, self._policy.attempts)
                return

    def _require_same(self) -> None:
        found = differences(self._begun, self.station.identities())
        if found:
            raise OtherDevices(
                f"station {self.station.name}", "reconnect", "; ".join(found), "put back what the run was begun with"
            )
