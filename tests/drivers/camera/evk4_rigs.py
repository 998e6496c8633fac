"""An EVK4 on an emulated USB, for tests."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from drivers.interfaces import Recording, Waveform
from sim_backend.devices.camera import SimulatedCamera
from sim_backend.devices.light import SimulatedLightSource
from sim_backend.wire.camera import WiredEvk4
from sim_backend.wire.evk4_usb import Evk4Usb
from sim_backend.world import OpticalBench

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy.typing as npt

    from drivers.interfaces import EventCamera
    from protocols.points import Roi
    from sim_backend.wire.faults import Faults


class Behaviour:
    """Three biases: both thresholds, and the dead time."""

    ranges: Mapping[str, tuple[int, int]] = {
        "bias_diff_on": (-85, 140),
        "bias_diff_off": (-35, 190),
        "bias_refr": (-20, 235),
    }

    def settings_at(self, offsets: Mapping[str, int]) -> dict[str, float]:
        return {
            "theta_on": 0.3 * 1.005 ** offsets.get("bias_diff_on", 0),
            "theta_off": 0.25 * 1.005 ** offsets.get("bias_diff_off", 0),
            "refractory_s": 5e-3 * 0.98 ** offsets.get("bias_refr", 0),
        }


@dataclass
class Bench:
    """A world with a lamp, and a camera that looks at it."""

    world: OpticalBench
    light: SimulatedLightSource
    camera: EventCamera

    def flicker(self, duration_s: float = 0.5) -> int:
        """Let the light step; return the number of steps."""
        t_s = np.arange(0.0, duration_s, 0.05)
        self.light.play(Waveform(t_s, np.array([1000.0, 2000.0] * len(t_s))[: len(t_s)], duration_s))
        return len(t_s) - 1

    def record(
        self, roi: Roi, seed: int = 1, biases: Mapping[str, int] | None = None
    ) -> tuple[npt.NDArray[np.void], npt.NDArray[np.void]]:
        """Return events and triggers of a flicker."""
        self.camera.set_roi(roi)
        self.camera.set_biases(biases or {})
        self.camera.start(Recording(seed=seed))
        self.flicker()
        self.camera.stop()
        return read(self.camera)


def read(camera: EventCamera) -> tuple[npt.NDArray[np.void], npt.NDArray[np.void]]:
    """Return events and triggers of the last recording."""
    chunks = list(camera.chunks())
    if not chunks:
        from drivers.events.types import empty_events, empty_triggers

        return empty_events(), empty_triggers()
    return np.concatenate([c.events for c in chunks]), np.concatenate([c.triggers for c in chunks])


def lit_world() -> tuple[OpticalBench, SimulatedLightSource]:
    world = OpticalBench(lux_per_level=0.05, pixel={"noise_rms": 0.03, "theta_off": 0.25}, sensor_seed=5)
    light = SimulatedLightSource(world, lowest=20.0, highest=15000.0, unit="cd/m2")
    light.connect()
    light.set_level(1000.0)
    return world, light


def emulated(faults: Faults | None = None, seed: int = 0, **arguments: Any) -> tuple[Bench, WiredEvk4, Evk4Usb]:
    """Return an emulated EVK4 that is not connected yet."""
    world, light = lit_world()
    usb = Evk4Usb(world, bias_behaviour=Behaviour(), faults=faults, seed=seed)
    camera = WiredEvk4(clock=world.clock, backend=usb, **arguments)
    return Bench(world, light, camera), camera, usb


def simulated() -> Bench:
    """Return the same world with a simulated camera, connected."""
    world, light = lit_world()
    camera = SimulatedCamera(world, bias_behaviour=Behaviour())
    camera.connect()
    return Bench(world, light, camera)
