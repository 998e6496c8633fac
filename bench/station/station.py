"""A bench that can be connected: its devices, its clock and what is known of them."""

from __future__ import annotations

import atexit
import contextlib
import logging
import time
from typing import TYPE_CHECKING, Any, Final, Self

from bench.station.tracing import current_trace
from drivers.errors import ConnectionFailed, DeviceError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from types import TracebackType

    from bench.station.calibration import Calibration
    from bench.store.data import Sensor
    from drivers.interfaces import Clock, Device, EventCamera, FilterWheel, LightSource, World

__all__ = ["DevicesFailed", "Station", "naming"]

_log = logging.getLogger("evs_bench.station")

#: Between trials to reach a device that is gone, s; of real time.
_PATIENCE_S: Final = (0.3, 0.7, 1.0, 2.0)


class DevicesFailed(ConnectionFailed):
    """Devices of a station that could not be connected, or be brought to their safe state, one line each.

    Parameters
    ----------
    station
        Name of the station.
    failures
        What went wrong with each of them.

    Attributes
    ----------
    lines
        The failures as text, each once.
    """

    def __init__(self, station: str, failures: Sequence[BaseException]) -> None:
        self.failures = tuple(failures)
        self.lines = tuple(dict.fromkeys(line for failure in failures for line in _lines(failure)))
        super().__init__(station, "connect", "\n".join(self.lines))
        self.args = ("\n".join(self.lines),)


def _lines(error: BaseException) -> tuple[str, ...]:
    if isinstance(error, DevicesFailed):
        return error.lines
    return (" ".join(str(error).split()) or type(error).__name__,)


@contextlib.contextmanager
def naming(device: Device, asked: str) -> Iterator[None]:
    """Turn an OSError or ValueError of a driver into a DeviceError that says which device, and what it was asked."""
    try:
        yield
    except (OSError, ValueError) as error:
        raise DeviceError(device.name, asked, str(error) or type(error).__name__) from error


class Station:
    """The devices of a bench, and what is known of them. :func:`bench.station.load_station` makes one.

    As a context manager it closes itself, whatever happens. Once connected, the devices are also brought to their
    safe state when the interpreter exits.
    """

    def __init__(
        self,
        *,
        name: str,
        light: LightSource,
        wheel: FilterWheel,
        camera: EventCamera,
        clock: Clock,
        calibration: Calibration,
        sensor: Sensor,
        plan: Mapping[str, Any],
        blind: bool = False,
        world: World | None = None,
    ) -> None:
        self.name = name
        self.light = light
        self.wheel = wheel
        self.camera = camera
        self.clock = clock
        self.world = world
        self.calibration = calibration
        self.sensor = sensor
        self.blind = blind  #: whether a run keeps nothing of it but its name
        self._plan = dict(plan)
        self._identities: dict[str, dict[str, str]] = {}

    @property
    def devices(self) -> dict[str, Device]:
        """The devices by role, in the order in which they are connected."""
        return {"light": self.light, "wheel": self.wheel, "camera": self.camera}

    @property
    def resolved(self) -> dict[str, Any]:
        """The station in full: the keys of a station file, and `identities` once it was connected.

        :func:`bench.station.station_from` makes a station of it again.
        """
        return {**self._plan, **({"identities": self._identities} if self._identities else {})}

    @property
    def recorded(self) -> dict[str, Any]:
        """The station as it goes into a run: in full, or of a blind one its name alone."""
        return {"name": self.name} if self.blind else self.resolved

    def connect(self) -> None:
        """Connect all devices and bring them to their safe state.

        Raises
        ------
        DevicesFailed
            One or more could not be connected; those that could are closed again.
        """
        failures: list[DeviceError] = []
        atexit.register(self.safe_state)
        try:
            for role in self.devices:
                try:
                    self._connect(role)
                except DeviceError as error:
                    failures.append(error)
            if failures:
                raise DevicesFailed(self.name, failures)
            self._identities = {role: _identity(device) for role, device in self.devices.items()}
        except BaseException:
            self.close()
            raise

    def connect_one(self, role: str) -> dict[str, str]:
        """Connect the device of one role, and return its identity; :meth:`close` closes it.

        Raises
        ------
        DevicesFailed
            It could not be connected.
        """
        try:
            self._connect(role)
            return _identity(self.devices[role])
        except DeviceError as error:
            raise DevicesFailed(self.name, [error]) from error

    def _connect(self, role: str) -> None:
        if self.world is not None:
            self.world.open()
        device = self.devices[role]
        device.trace_to(current_trace())
        with naming(device, "connect"):
            device.connect()

    def safe_state(self) -> None:
        """Bring all devices to their safe state: idempotent, never raises; see :attr:`unsafe`."""
        for device in self.devices.values():
            device.safe_state()

    @property
    def unsafe(self) -> tuple[DeviceError, ...]:
        """What the operator must know of devices that could not be brought to their safe state."""
        return tuple(device.unsafe for device in self.devices.values() if device.unsafe is not None)

    def close(self) -> None:
        """Bring all devices to their safe state, then close them, the last first; never raises.

        A device that is not there is waited for a little: its cable may be put in again.
        """
        self.safe_state()
        for pause_s in _PATIENCE_S:
            if not any(isinstance(error.__cause__, ConnectionFailed) for error in self.unsafe):
                break
            time.sleep(pause_s)
            self.safe_state()
        for device in reversed(self.devices.values()):
            try:
                device.close()
            except Exception:  # noqa: BLE001 - the others must still be closed; the log has it
                _log.exception("%s: could not be closed", device.name)
        if self.world is not None:
            self.world.close()
        atexit.unregister(self.safe_state)

    def identities(self) -> dict[str, dict[str, str]]:
        """Return the identity of each device by role, as they told it when they were connected; empty before."""
        return {role: dict(identity) for role, identity in self._identities.items()}

    def reachable(self, lux: float, filter_name: str) -> bool:
        """Return whether the source can give `lux` on the chip behind a filter."""
        return self.calibration.reachable(lux, filter_name)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _identity(device: Device) -> dict[str, str]:
    with naming(device, "identify itself"):
        return device.identity()
