"""How to build each driver and each simulated device for the tests that all of its kind must pass.

A new class goes into `RIGS`; `test_registry.py` fails until it does.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from drivers.camera.evk4.evk4 import Evk4
from drivers.camera.neuromorphic import NeuromorphicCamera
from drivers.camera.playback import PlaybackCamera
from drivers.clock import RealClock
from drivers.filters.manual import ManualFilter
from drivers.filters.thorlabs_fw import ThorlabsFilterWheel
from drivers.interfaces import Clock, EventCamera, FilterWheel, LightSource, Recording, Waveform
from drivers.light.led_driver import LedDriver
from drivers.light.rs7 import SpectralLed
from drivers.light.scpi_generator import ScpiGenerator
from sim_backend.clock import VirtualClock
from sim_backend.devices.camera import SimulatedCamera
from sim_backend.devices.clock import SimulatedClock
from sim_backend.devices.filter_wheel import SimulatedFilterWheel
from sim_backend.devices.light import SimulatedLightSource
from sim_backend.wire.camera import WiredEvk4
from sim_backend.wire.rs7 import Rs7Firmware
from sim_backend.wire.serial_wire import SerialWire
from sim_backend.world import OpticalBench
from tests.drivers.camera.contract_benches import (
    evk4_bench,
    neuromorphic_bench,
    playback_bench,
    wired_evk4_bench,
)
from tests.drivers.filters.wheel_rigs import operator, thorlabs_on_wire
from tests.drivers.light.led_rigs import led_on_wire
from tests.drivers.light.scpi_support import DIALECT_NAMES, scpi_bench

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from drivers.events.types import EventChunk


@dataclass
class LightRig:
    """A light source, and what can be seen of it from outside."""

    light: LightSource
    clock: Clock
    is_dark: Callable[[], bool]


@dataclass
class WheelRig:
    """A filter wheel, and what can be seen of it from outside."""

    wheel: FilterWheel
    clock: Clock
    transmission: Callable[[], float]  #: of the light path, as it is


@dataclass
class CameraRig:
    """A camera, and something that makes it see events."""

    camera: EventCamera
    flicker: Callable[[], int]  #: steps of the light for 0.5 s that every pixel answers; returns their number
    repeatable: bool  #: whether the same seed gives the same events

    def record(self, seed: int = 1) -> list[EventChunk]:
        """Return a recording of the flicker."""
        self.camera.start(Recording(seed=seed))
        self.flicker()
        self.camera.stop()
        return list(self.camera.chunks())


class StandInBehaviour:
    """Two biases: one for the ON threshold, and one for the dead time."""

    ranges: Mapping[str, tuple[int, int]] = {"bias_diff_on": (-50, 100), "bias_refr": (-20, 235)}

    def settings_at(self, offsets: Mapping[str, int]) -> dict[str, float]:
        return {
            "theta_on": 0.3 * 1.005 ** offsets.get("bias_diff_on", 0),
            "refractory_s": 5e-3 * 0.98 ** offsets.get("bias_refr", 0),
        }


def world() -> OpticalBench:
    return OpticalBench(lux_per_level=0.05, pixel={"noise_rms": 0.03, "theta_off": 0.25}, sensor_seed=5)


def simulated_light(bench: OpticalBench, **arguments: Any) -> SimulatedLightSource:
    return SimulatedLightSource(bench, lowest=20.0, highest=15000.0, unit="cd/m2", **arguments)


def light_rig(**arguments: Any) -> LightRig:
    bench = world()
    return LightRig(simulated_light(bench, **arguments), bench.clock, lambda: bench.lux() == 0.0)


def wheel_rig() -> WheelRig:
    bench = world()
    bench.set_level(1.0)
    wheel = SimulatedFilterWheel(bench, filters={"clear": 0.0, "nd10": 1.0, "nd30": 3.0}, move_s=0.5)
    return WheelRig(wheel, bench.clock, lambda: bench.lux() / 0.05)


def camera_rig() -> CameraRig:
    bench = world()
    light = simulated_light(bench)
    light.connect()
    light.set_level(1000.0)
    steps = Waveform(np.arange(0.0, 0.5, 0.05), np.array([1000.0, 2000.0] * 5), 0.5)

    def flicker() -> int:
        light.play(steps)
        return len(steps.t_s) - 1

    return CameraRig(SimulatedCamera(bench, bias_behaviour=StandInBehaviour()), flicker, repeatable=True)


def rs7_rig() -> LightRig:
    bench = world()
    wire = SerialWire(Rs7Firmware(bench, presets={"dark": 0.0}, settling_s=5e-3), "rs7")
    light = SpectralLed(wire.path, clock=bench.clock, player="inline", timeout_s=5.0)
    return LightRig(light, bench.clock, lambda: bench.lux() == 0.0)


def scpi_rig(dialect: str) -> LightRig:
    bench = scpi_bench(dialect)
    return LightRig(bench.light, bench.clock, bench.is_dark)


def on_bench(bench: Any, *, repeatable: bool) -> CameraRig:
    return CameraRig(bench.camera, bench.flicker, repeatable)


RIGS: dict[type, dict[str, Callable[[], Any]]] = {
    SimulatedLightSource: {
        "device": light_rig,
        "host": lambda: light_rig(timing="host", latency_s=2e-3, settling_s=5e-3, rise_tau_s=1e-4),
    },
    SpectralLed: {"rs7": rs7_rig},
    ScpiGenerator: {name: partial(scpi_rig, name) for name in DIALECT_NAMES},
    LedDriver: {"wire": lambda: LightRig(*led_on_wire())},
    ThorlabsFilterWheel: {"wire": lambda: WheelRig(*thorlabs_on_wire())},
    ManualFilter: {"operator": lambda: WheelRig(*operator())},
    SimulatedFilterWheel: {"wheel": wheel_rig},
    SimulatedCamera: {"camera": camera_rig},
    Evk4: {"emulated": lambda: on_bench(evk4_bench(), repeatable=False)},
    WiredEvk4: {"emulated": lambda: on_bench(wired_evk4_bench(), repeatable=True)},
    PlaybackCamera: {"file": lambda: on_bench(playback_bench(), repeatable=False)},
    NeuromorphicCamera: {"stand-in": lambda: on_bench(neuromorphic_bench(), repeatable=False)},
    RealClock: {"clock": RealClock},
    VirtualClock: {"clock": VirtualClock},
    SimulatedClock: {"clock": lambda: SimulatedClock(world())},
}

#: What a test asks for, and which kind of class that is.
_FIXTURES: dict[str, type] = {
    "light_rig": LightSource,
    "wheel_rig": FilterWheel,
    "camera_rig": EventCamera,
    "clock": Clock,
}


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Run a test that asks for a rig once with each rig of that kind."""
    for fixture, kind in _FIXTURES.items():
        if fixture in metafunc.fixturenames:
            rigs = {
                f"{cls.__name__}-{name}": build
                for cls, variants in RIGS.items()
                if issubclass(cls, kind)
                for name, build in variants.items()
            }
            metafunc.parametrize(fixture, rigs.values(), ids=rigs.keys(), indirect=True)


@pytest.fixture(name="light_rig")
def built_light_rig(request: pytest.FixtureRequest) -> LightRig:
    rig: LightRig = request.param()
    return rig


@pytest.fixture(name="wheel_rig")
def built_wheel_rig(request: pytest.FixtureRequest) -> WheelRig:
    rig: WheelRig = request.param()
    return rig


@pytest.fixture(name="camera_rig")
def built_camera_rig(request: pytest.FixtureRequest) -> CameraRig:
    rig: CameraRig = request.param()
    return rig


@pytest.fixture(name="clock")
def built_clock(request: pytest.FixtureRequest) -> Clock:
    built: Clock = request.param()
    return built


@pytest.fixture(name="rigs")
def all_rigs() -> dict[type, dict[str, Callable[[], Any]]]:
    return RIGS
