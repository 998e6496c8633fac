"""The filter wheels, one on its emulated wire and one a person, for the tests that all filter wheels must pass."""

from __future__ import annotations

import atexit
from typing import TYPE_CHECKING

from drivers.filters.manual import ManualFilter
from drivers.filters.thorlabs_fw import ThorlabsFilterWheel
from sim_backend.wire.serial_wire import SerialWire
from sim_backend.wire.thorlabs_fw import ThorlabsFwFirmware
from sim_backend.world import OpticalBench

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivers.interfaces import Clock

LUX_PER_LEVEL = 0.05
FILTERS = {"clear": 0.0, "nd05": 0.5, "nd10": 1.0, "nd20": 2.0, "nd30": 3.0, "nd40": 4.0}


def lit_world() -> OpticalBench:
    world = OpticalBench(lux_per_level=LUX_PER_LEVEL, pixel={"noise_rms": 0.03, "theta_off": 0.25}, sensor_seed=5)
    world.set_level(1.0)
    return world


def thorlabs_on_wire() -> tuple[ThorlabsFilterWheel, Clock, Callable[[], float]]:
    """Return the driver, the clock of its world, and the transmission of the light path there."""
    world = lit_world()
    wire = SerialWire(ThorlabsFwFirmware(world, filters=list(FILTERS.items())), "wheel")
    atexit.register(wire.close)
    filters = {name: {"position": n, "nd_od": nd_od} for n, (name, nd_od) in enumerate(FILTERS.items(), 1)}
    wheel = ThorlabsFilterWheel(wire.path, filters=filters, clock=world.clock, clear="clear", timeout_s=20.0)
    return wheel, world.clock, lambda: world.lux() / LUX_PER_LEVEL


def operator() -> tuple[ManualFilter, Clock, Callable[[], float]]:
    """Return filters that a swift operator changes in a world, its clock, and the transmission of its light path."""
    world = lit_world()

    def change(request: str) -> None:
        name = request.partition("put filter ")[2].partition(" ")[0]
        world.clock.sleep(3.0)
        world.set_filter(name, FILTERS[name])

    return ManualFilter(FILTERS, ask=change), world.clock, lambda: world.lux() / LUX_PER_LEVEL
