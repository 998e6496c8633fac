"""A simulated event camera: the pixels of the world, seen through biases, a window and a trigger input."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, Literal, Protocol

import numpy as np

from drivers.errors import WrongState
from drivers.events.types import TRIGGER_DTYPE, EventChunk, empty_events
from drivers.interfaces import EventCamera, Limits, RecordingQuality
from protocols.errors import InputError
from protocols.points import Roi
from sim_backend.clock import NS_PER_S
from sim_backend.devices.identity import simulated_identity

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    import numpy.typing as npt

    from drivers.interfaces import Recording
    from protocols.points import Ambient
    from sim_backend.pixel.engines import Engine
    from sim_backend.pixel.light import LightHistory
    from sim_backend.pixel.model import PixelModel
    from sim_backend.world import OpticalBench, TriggerEdge

__all__ = ["BIAS_RANGES", "BiasBehaviour", "SimulatedCamera"]

#: Recommended offsets from the factory codes of an EVK4 (IMX636), by bias, as OpenEB 5.1.1 enforces them.
BIAS_RANGES: Final[dict[str, tuple[int, int]]] = {
    "bias_fo": (-35, 55),
    "bias_hpf": (0, 120),
    "bias_diff_on": (-85, 140),
    "bias_diff": (-25, 23),
    "bias_diff_off": (-35, 190),
    "bias_refr": (-20, 235),
}

_OFFSET: Final = "offset"  # unit of a bias
_NS_PER_US: Final = 1000
_TRIGGER_CHANNEL: Final = 0

#: Which parameter of the pixel model is meant by which setting of the sensor.
_PARAMETERS: Final = {
    "theta_on": "theta_on",
    "theta_off": "theta_off",
    "refractory_s": "refractory_s",
    "bandwidth_hz": "corner_hz",
}


class BiasBehaviour(Protocol):
    """What the biases of the sensor do."""

    @property
    def ranges(self) -> Mapping[str, tuple[int, int]]:
        """Lowest and highest offset at which the behaviour is known, by bias; no other bias does anything."""

    def settings_at(self, offsets: Mapping[str, int]) -> Mapping[str, float]:
        """Return theta_on, theta_off (ln), refractory_s and bandwidth_hz, as far as biases rule them."""


@dataclass(frozen=True, slots=True)
class _Take:
    """A recording: all that its events depend on."""

    model: PixelModel
    roi: Roi
    sensor_seed: int
    seed: int
    light: LightHistory
    triggers: npt.NDArray[np.void]  #: (n,) of TRIGGER_DTYPE
    duration_s: float
    ambient: Ambient


@dataclass(frozen=True, slots=True)
class _Started:
    """A recording that is running."""

    start_ns: int
    seed: int
    ambient: Ambient


class SimulatedCamera(EventCamera):
    """A camera that records what the world's pixels do.

    The events are computed while :meth:`chunks` is read, stretch by stretch, from the light that the world remembers:
    a long recording needs no more memory than a short one. All random numbers of a recording come from its seed, so
    the same seed gives the same events. Window and biases cannot be changed while a recording runs.

    A bias that `bias_behaviour` does not know does nothing in this sensor; its limits are 0 to 0, so that nobody
    believes otherwise.

    Parameters
    ----------
    world
        The world whose light it sees.
    bias_behaviour
        What the biases do; settings that no bias rules are those of the world's pixel.
    width, height
        Size of the sensor, pixels.
    dt_s
        Sample of the simulation, s.
    step
        Low-pass of the pixel over a sample: "exact", or "euler" as in the published simulation.
    engine
        "reference" goes through every sample; "fast" goes from event to event: the same distribution of events in a
        small part of the time, for the exact step only. None: "fast" if the step is exact.
    name
        What the operator calls it.
    """

    def __init__(
        self,
        world: OpticalBench,
        *,
        bias_behaviour: BiasBehaviour,
        width: int = 1280,
        height: int = 720,
        dt_s: float = 1e-5,
        step: Literal["exact", "euler"] = "exact",
        engine: Literal["fast", "reference"] | None = None,
        name: str = "camera",
    ) -> None:
        super().__init__(name)
        if min(width, height) < 1:
            raise InputError(f"{name}: the sensor is {width} x {height} pixels; expected 1 or more each")
        if not 0.0 < dt_s <= 1e-3:
            raise InputError(f"{name}: dt_s is {dt_s}; expected more than 0 and at most 1e-3 s")
        if step not in ("exact", "euler"):
            raise InputError(f"{name}: step is {step!r}; expected exact or euler")
        self._world = world
        self._behaviour = bias_behaviour
        self._engine = _engine(name, engine, step, dt_s)
        self.width = width
        self.height = height
        self.bias_limits = _limits(bias_behaviour)
        self._biases = dict.fromkeys(self.bias_limits, 0)
        self._roi = Roi(0, 0, width, height)
        self._running: _Started | None = None
        self._take: _Take | None = None

    def identity(self) -> dict[str, str]:
        """Return maker, model, serial number and firmware version."""
        self.require_connected("identify itself")
        model = f"simulated event camera, {self.width} x {self.height}"
        return simulated_identity(model, f"sensor seed {self._world.sensor_seed}")

    def biases(self) -> dict[str, int]:
        """Return all bias offsets."""
        self.require_connected("read the biases")
        return dict(self._biases)

    def refractory_s(self) -> float:
        """Return the dead time that the biases give, s; of the sensor as a whole, not of single pixels."""
        self.require_connected("measure the dead time")
        return self._model().refractory_s

    def temperature_c(self) -> float:
        """Return the temperature of the sensor, degrees Celsius."""
        self.require_connected("read the temperature")
        return self._world.temperature_c

    def start(self, recording: Recording) -> None:
        """Start a recording; time is 0 now, and the pixels have settled to the light of now."""
        self.require_connected("start a recording")
        self._require_idle("start a recording")
        now_ns = self._world.clock.now_ns
        self._world.set_ambient(recording.ambient)
        self._world.forget_before(now_ns)
        self._take = None
        self._running = _Started(now_ns, recording.seed, recording.ambient)

    def stop(self) -> None:
        """Stop the recording; what was recorded can still be read."""
        self.require_connected("stop the recording")
        if self._running is None:
            raise WrongState(self.name, "stop the recording", "no recording is running", "call start() first")
        begin_ns, end_ns = self._running.start_ns, self._world.clock.now_ns
        self._take = _Take(
            model=self._model(),
            roi=self._roi,
            sensor_seed=self._world.sensor_seed,
            seed=self._running.seed,
            light=self._world.light(begin_ns),
            triggers=_triggers(self._world.triggers(begin_ns, end_ns), begin_ns),
            duration_s=(end_ns - begin_ns) / NS_PER_S,
            ambient=self._running.ambient,
        )
        self._running = None

    def chunks(self) -> Iterator[EventChunk]:
        """Yield the last recording, in order of time; it must have been stopped. It can be read again."""
        self.require_connected("read the recording")
        self._require_idle("read the recording")
        if self._take is None:
            raise WrongState(self.name, "read the recording", "nothing was recorded", "call start() and stop() first")
        return _chunks(self._take, self._engine)

    def quality(self) -> RecordingQuality:
        """Return what is known about the completeness of the last recording: nothing is lost behind the sensor."""
        self.require_connected("judge the recording")
        return RecordingQuality()

    def _connect(self) -> None:
        self._biases = dict.fromkeys(self.bias_limits, 0)
        self._roi = Roi(0, 0, self.width, self.height)

    def _close(self) -> None:
        self._take = None

    def _safe_state(self) -> None:
        if self._running is not None:
            self.stop()

    def _set_roi(self, roi: Roi) -> None:
        self._require_idle("set the window")
        self._roi = roi

    def _set_biases(self, offsets: Mapping[str, int]) -> None:
        self._require_idle("set biases")
        self._biases = dict(offsets)

    def _model(self) -> PixelModel:
        """Return the world's pixel as the biases make it."""
        settings = self._behaviour.settings_at(self._biases)
        changes: dict[str, Any] = {_PARAMETERS[name]: value for name, value in settings.items()}
        return replace(self._world.pixel, **changes)

    def _require_idle(self, asked: str) -> None:
        if self._running is not None:
            raise WrongState(self.name, asked, "a recording is running", "call stop() first")


def _limits(behaviour: BiasBehaviour) -> dict[str, Limits]:
    """Return the range of each bias: the camera's, as far as it is known what the bias does there."""
    limits = {}
    for bias, (lowest, highest) in BIAS_RANGES.items():
        known = behaviour.ranges.get(bias, (0, 0))
        limits[bias] = Limits(max(lowest, known[0]), min(highest, known[1]), _OFFSET)
    unknown = [bias for bias in behaviour.ranges if bias not in BIAS_RANGES]
    if unknown:
        raise InputError(f"the camera has no {', '.join(unknown)}; it has {', '.join(BIAS_RANGES)}")
    return limits


def _triggers(edges: list[TriggerEdge], begin_ns: int) -> npt.NDArray[np.void]:
    """Return trigger edges on the time axis of a recording that began at `begin_ns`."""
    found = np.zeros(len(edges), TRIGGER_DTYPE)
    found["t"] = [round((edge.time_ns - begin_ns) / _NS_PER_US) for edge in edges]
    found["p"] = [edge.rising for edge in edges]
    found["id"] = _TRIGGER_CHANNEL
    return found


def _engine(name: str, engine: str | None, step: Literal["exact", "euler"], dt_s: float) -> Engine:
    """Return the engine of this name."""
    from sim_backend.pixel.engines import FastEngine, ReferenceEngine

    if engine not in (None, "fast", "reference"):
        raise InputError(f"{name}: engine is {engine!r}; expected fast or reference")
    if engine == "fast" and step == "euler":
        raise InputError(
            f"{name}: the fast engine knows the exact step only; expected step exact, or engine reference"
        )
    if engine == "reference" or step == "euler":
        return ReferenceEngine(dt_s=dt_s, step=step)
    return FastEngine(dt_s=dt_s)


def _chunks(take: _Take, engine: Engine) -> Iterator[EventChunk]:
    """Yield the events as the engine finds them; each trigger comes with the first events that are not before it."""
    from sim_backend.pixel.chain import build_chain

    chain = build_chain(take.model, take.roi, take.sensor_seed)
    if take.ambient != "open":  # a shroud and a cap keep out what does not come from the source
        chain = replace(chain, stray_lux=0.0)
    sent = 0
    for events in engine.events(chain, take.light, take.duration_s, take.seed):
        if len(events) == 0:
            continue
        due = int(np.searchsorted(take.triggers["t"], events["t"][-1], side="right"))
        yield EventChunk(events, take.triggers[sent:due])
        sent = due
    if sent < len(take.triggers):
        yield EventChunk(empty_events(), take.triggers[sent:])
