"""The LED driver on its emulated wire, for the tests that all light sources must pass."""

from __future__ import annotations

import atexit
from typing import TYPE_CHECKING

from drivers.light.led_driver import LedDriver
from sim_backend.wire.led_driver import LedFirmware
from sim_backend.wire.serial_wire import SerialWire
from sim_backend.world import OpticalBench

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivers.interfaces import Clock


def led_on_wire() -> tuple[LedDriver, Clock, Callable[[], bool]]:
    """Return the driver, the clock of its world, and whether that is dark."""
    world = OpticalBench(lux_per_level=0.05, pixel={"noise_rms": 0.03, "theta_off": 0.25}, sensor_seed=5)
    wire = SerialWire(LedFirmware(world, rise_tau_s=1e-5), "led")
    atexit.register(wire.close)
    light = LedDriver(
        wire.path, clock=world.clock, lowest=20, highest=16000, edge_time_s=2.2e-5, settling_s=1e-4, timeout_s=20.0
    )
    return light, world.clock, lambda: world.lux() == 0.0
