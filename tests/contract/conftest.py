"""How to build each driver and each simulated device for the tests that all of its kind must pass.

A new class goes into `RIGS`; `test_registry.py` fails until it does.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from drivers.clock import RealClock
from drivers.interfaces import Clock, EventCamera, FilterWheel, LightSource, Recording, Waveform
from sim_backend.clock import VirtualClock
from sim_backend.devices.camera import SimulatedCamera
from sim_backend.devices.clock import SimulatedClock
from sim_backend.devices.filter_wheel import SimulatedFilterWheel
from sim_backend.devices.light import SimulatedLightSource
from sim_backend.world import OpticalBench

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


RIGS: dict[type, dict[str, Callable[[], Any]]] = {
    SimulatedLightSource: {
        "device": light_rig,
        "host": lambda: light_rig(timing="host", latency_s=2e-3, settling_s=5e-3, rise_tau_s=1e-4),
    },
    SimulatedFilterWheel: {"wheel": wheel_rig},
    SimulatedCamera: {"camera": camera_rig},
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
