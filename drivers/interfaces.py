"""The three kinds of instrument, and the clock: what the runner knows of the hardware.

Each kind is an abstract class whose public methods check limits and state and then call a private hook, so that a
real driver and a simulated device validate alike. A constructor only stores its arguments; :meth:`Device.connect`
talks. After `connect()` the light is off, or `connect()` has raised. `safe_state()` can be called at any time, any
number of times, and never raises; what it could not do stands in `unsafe`. A value out of range raises
:class:`~drivers.errors.OutOfRange`; nothing is clipped.
"""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np

from drivers.clock import Clock
from drivers.errors import DeviceError, OutOfRange, Unsupported, WrongState

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    import numpy.typing as npt

    from drivers.events.types import EventChunk
    from drivers.transport.trace import Trace
    from protocols.points import Ambient, Roi

_log = logging.getLogger("evs_bench.devices")

__all__ = [
    "Clock",
    "Device",
    "EventCamera",
    "Filter",
    "FilterWheel",
    "LightSource",
    "Limits",
    "PlayedWaveform",
    "Recording",
    "RecordingQuality",
    "Waveform",
    "World",
]


class World(ABC):  # noqa: B024 - it declares, and asks for nothing
    """What simulated devices share. In a station file `$world.name` stands for what it calls `name`."""

    def open(self) -> None:  # noqa: B027 - most worlds have nothing beside themselves
        """Start what it runs beside itself, before the devices connect; harmless if that runs."""

    def close(self) -> None:  # noqa: B027
        """End what it runs beside itself, after the devices were closed; harmless if nothing runs."""


@dataclass(frozen=True, slots=True)
class Limits:
    """A closed range and its unit."""

    lowest: float
    highest: float
    unit: str

    def require(self, device: str, quantity: str, value: float) -> None:
        """Raise :class:`OutOfRange` unless `value` is a number within the limits."""
        if not self.lowest <= value <= self.highest:
            raise OutOfRange(device, quantity, value, self.lowest, self.highest, self.unit)


class Device(ABC):
    """What all instruments have in common.

    Parameters
    ----------
    name
        What the operator calls it; it stands first in every error message.

    Attributes
    ----------
    unsafe
        Why the last :meth:`safe_state` failed, for the operator; None if it did not.
    """

    #: What the operator is told when :meth:`safe_state` fails: what did not happen, and what to do.
    unsafe_text: ClassVar[tuple[str, str]] = ("could not be brought to its safe state", "see to it by hand")

    def __init__(self, name: str) -> None:
        self.name = name
        self.connected = False
        self.unsafe: DeviceError | None = None

    def connect(self) -> None:
        """Open the device and bring it to its safe state; where that fails, let go of it and raise DeviceError."""
        self.unsafe = None
        self._connect()
        self.connected = True
        self.safe_state()
        self._require_safe()

    def close(self) -> None:
        """Bring the device to its safe state and let go of it; harmless if it is not connected."""
        self.safe_state()
        if self.connected:
            self.connected = False
            self._close()

    def safe_state(self) -> None:
        """Bring the device to its safe state: idempotent, never raises; a failure stands in `unsafe`."""
        if self.connected:
            try:
                self._safe_state()
            except Exception as error:  # noqa: BLE001 - never raises is the contract; the log and `unsafe` have it
                what, advice = self.unsafe_text
                self.unsafe = DeviceError(self.name, what, str(error) or type(error).__name__, advice)
                self.unsafe.__cause__ = error
                _log.exception("%s", self.unsafe)
            else:
                self.unsafe = None

    def trace_to(self, trace: Trace | None) -> None:  # noqa: B027 - a device without a wire has nothing to trace
        """Write every byte that goes over the device's link into `trace` from now on; None: no more."""

    def _require_safe(self) -> None:
        """Let go of the device, and raise, if it could not be brought to its safe state."""
        if self.unsafe is not None:
            self.connected = False
            try:
                self._close()
            except Exception:  # noqa: BLE001 - that the device is not safe matters more; the log has this
                _log.exception("%s: could not be closed", self.name)
            raise self.unsafe

    def require_connected(self, asked: str) -> None:
        """Raise :class:`WrongState` unless the device is connected."""
        if not self.connected:
            raise WrongState(self.name, asked, "not connected", "call connect() first")

    @abstractmethod
    def identity(self) -> dict[str, str]:
        """Return maker, model, serial number and firmware version, as the device tells them."""

    @abstractmethod
    def _connect(self) -> None: ...

    @abstractmethod
    def _close(self) -> None: ...

    @abstractmethod
    def _safe_state(self) -> None: ...


@dataclass(frozen=True, slots=True)
class Waveform:
    """Levels of a light source over time, in the unit of the source."""

    t_s: npt.NDArray[np.float64]  #: (m,) s; ascending, the first is 0
    level: npt.NDArray[np.float64]  #: (m,) from that time to the next
    duration_s: float  #: the last level is held until then, s


@dataclass(frozen=True, slots=True)
class PlayedWaveform:
    """When the edges of a waveform came, in seconds of the source's clock since the waveform began.

    A source that is timed on the device knows `t_s` exactly; one that is timed by the host also says when it wrote
    each request, when the device acknowledged it and when the light had settled (None where it does not know).
    """

    t_s: npt.NDArray[np.float64]  #: (m,)
    t_written_s: npt.NDArray[np.float64] | None = None
    t_acknowledged_s: npt.NDArray[np.float64] | None = None
    t_settled_s: npt.NDArray[np.float64] | None = None
    #: When it put edges on its trigger output, where these are not the edges of the light: begin and end of a burst.
    trigger_t_s: npt.NDArray[np.float64] | None = None


class LightSource(Device):
    """A source of light whose level can be set and stepped.

    Subclasses set `timing`, `limits`, `edge_time_s` and `settling_s` in their constructor.
    """

    unsafe_text = ("could not be made dark", "switch it off by hand")
    timing: Literal["host", "device"]  #: who times the edges of a waveform
    limits: Limits  #: lowest and highest level that is lit, in the unit of the source; 0 (dark) is always allowed
    edge_time_s: float  #: 10 % to 90 % of a step, s
    settling_s: float  #: from a step until the light is stable, s
    level_is_measured: ClassVar[bool] = False  #: whether :meth:`level` measures the light, or knows what was asked
    level_step: float = 0.0  #: between two levels that it can be set to, in the unit of `limits`; 0: any level

    def nearest(self, level: float) -> float:
        """Return the level nearest to `level` that the source can be set to."""
        return level if self.level_step == 0.0 else round(level / self.level_step) * self.level_step

    def set_level(self, level: float) -> None:
        """Go to `level` (unit of `limits`), or the nearest one that the source can be set to; 0 is dark."""
        self.require_connected(f"set level to {level:g} {self.limits.unit}")
        self._require_level(level)
        self._set_level(self.nearest(level))

    def play(self, waveform: Waveform) -> PlayedWaveform:
        """Play `waveform`, each level the nearest that the source can be set to, and return when it is over."""
        self.require_connected("play a waveform")
        for level in np.unique(waveform.level):
            self._require_level(float(level))
        reason = self.why_not(waveform)
        if reason:
            raise Unsupported(self.name, "play a waveform", reason)
        if self.level_step:
            levels = np.array([self.nearest(float(level)) for level in waveform.level])
            waveform = Waveform(waveform.t_s, levels, waveform.duration_s)
        return self._play(waveform)

    def why_not(self, waveform: Waveform) -> str:  # noqa: ARG002 - a source that can time anything does not look
        """Return why the source cannot time a waveform, for people; empty if it can. It need not be connected."""
        return ""

    def _require_level(self, level: float) -> None:
        if level != 0.0:
            self.limits.require(self.name, "level", level)

    @abstractmethod
    def level(self) -> float:
        """Return the level as read back from the device."""

    @abstractmethod
    def _set_level(self, level: float) -> None: ...

    @abstractmethod
    def _play(self, waveform: Waveform) -> PlayedWaveform: ...


@dataclass(frozen=True, slots=True)
class Filter:
    """One position of a filter wheel."""

    name: str
    nd_od: float  #: nominal optical density; 0 for the clear position


class FilterWheel(Device):
    """A wheel (or a person) that puts one of several ND filters into the light path."""

    filters: tuple[Filter, ...]

    def select(self, name: str) -> None:
        """Put the filter `name` in, and return when it has arrived."""
        self.require_connected(f"select filter {name}")
        names = [f.name for f in self.filters]
        if name not in names:
            raise WrongState(self.name, f"select filter {name!r}", "no such filter", f"it has {', '.join(names)}")
        self._select(name)

    @abstractmethod
    def selected(self) -> str:
        """Return the name of the filter that is in, as read back from the device."""

    @abstractmethod
    def _select(self, name: str) -> None: ...


@dataclass(frozen=True, slots=True)
class Recording:
    """What a camera is told when a recording starts."""

    label: str = ""
    duration_s: float | None = None  #: expected length, for buffers and deadlines; None if open
    seed: int = 0  #: for devices that draw random numbers; a real camera has no use for it
    ambient: Ambient = "open"  #: what surrounds the sensor during the recording; a real camera has no use for it


@dataclass(frozen=True, slots=True)
class RecordingQuality:
    """What is known about the completeness of the last recording."""

    bytes_received: int = 0
    decode_errors: int = 0
    dropped_buffers: int = 0
    overflows: int = 0
    gaps_s: tuple[tuple[float, float], ...] = field(default=())  #: start and stop, s


class EventCamera(Device):
    """An event camera. Its time axis starts at 0 with each :meth:`start`.

    Subclasses set `width`, `height` and `bias_limits` in their constructor.
    """

    width: int
    height: int
    bias_limits: Mapping[str, Limits]  #: allowed offset from the factory code, by bias name

    def set_roi(self, roi: Roi) -> None:
        """Enable the pixels of the window `roi` and no others."""
        self.require_connected(f"set the window to {roi}")
        limits = (
            ("window x", roi.x, Limits(0, self.width - 1, "pixel")),
            ("window y", roi.y, Limits(0, self.height - 1, "pixel")),
            ("window width", roi.width, Limits(1, self.width - roi.x, "pixel")),
            ("window height", roi.height, Limits(1, self.height - roi.y, "pixel")),
        )
        for quantity, value, limit in limits:
            limit.require(self.name, quantity, value)
        self._set_roi(roi)

    def set_biases(self, offsets: Mapping[str, int]) -> None:
        """Set biases as offsets from the factory codes; those not named go back to offset 0."""
        self.require_connected("set biases")
        for bias, offset in offsets.items():
            if bias not in self.bias_limits:
                known = ", ".join(self.bias_limits)
                raise WrongState(self.name, f"set {bias}", "no such bias", f"it has {known}")
            self.bias_limits[bias].require(self.name, bias, offset)
        self._set_biases({name: int(offsets.get(name, 0)) for name in self.bias_limits})

    @abstractmethod
    def biases(self) -> dict[str, int]:
        """Return all bias offsets as read back from the device."""

    @abstractmethod
    def refractory_s(self) -> float:
        """Return the dead time as the device measures it, s; NaN if it cannot."""

    @abstractmethod
    def temperature_c(self) -> float:
        """Return the temperature of the sensor, degrees Celsius; NaN if it cannot."""

    @abstractmethod
    def start(self, recording: Recording) -> None:
        """Start a recording; time is 0 now."""

    @abstractmethod
    def stop(self) -> None:
        """Stop the recording; what was recorded can still be read."""

    @abstractmethod
    def chunks(self) -> Iterator[EventChunk]:
        """Yield what was recorded since :meth:`start`, in order, until the end of the recording."""

    @abstractmethod
    def quality(self) -> RecordingQuality:
        """Return what is known about the completeness of the last recording."""

    @abstractmethod
    def _set_roi(self, roi: Roi) -> None: ...

    @abstractmethod
    def _set_biases(self, offsets: Mapping[str, int]) -> None: ...
