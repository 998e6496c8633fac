"""An emulated function generator on a network socket, and the driver that talks to it."""

from __future__ import annotations

import weakref
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from drivers.interfaces import Waveform
from drivers.light.scpi_generator import ScpiGenerator
from protocols.waveforms import square_edges
from sim_backend.wire.faults import Faults
from sim_backend.wire.scpi import ScpiWire
from sim_backend.wire.scpi_makers import emulated_generator
from sim_backend.world import OpticalBench

if TYPE_CHECKING:
    from drivers.light.scpi_talk import ScpiTalk
    from sim_backend.clock import VirtualClock
    from sim_backend.wire.scpi_generator import EmulatedGenerator

DIALECT_NAMES = ("rigol", "siglent", "keysight")


@dataclass
class ScpiBench:
    """A driver, and all that is behind it."""

    light: ScpiGenerator
    world: OpticalBench
    wire: ScpiWire
    firmware: EmulatedGenerator

    @property
    def clock(self) -> VirtualClock:
        """Clock of the world."""
        return self.world.clock

    def is_dark(self) -> bool:
        """Return whether no light is on the chip."""
        return self.world.lux() == 0.0


def scpi_bench(
    dialect: str, *, wired_to: Any = "high_z", faults: Faults | None = None, **arguments: Any
) -> ScpiBench:
    """Return a driver and its generator; both let go of their sockets when the driver is gone."""
    world = OpticalBench(lux_per_level=0.05, pixel={"noise_rms": 0.03, "theta_off": 0.25}, sensor_seed=5)
    firmware = emulated_generator(world, dialect, wired_to=wired_to)
    wire = ScpiWire(firmware, faults or Faults())
    chosen = {"dialect": dialect, "clock": world.clock, "lowest": 0.5, "highest": 8.0, **arguments}
    light = ScpiGenerator(wire.address, **chosen)
    weakref.finalize(light, _let_go, light._talk, wire)
    return ScpiBench(light, world, wire, firmware)


def _let_go(talk: ScpiTalk, wire: ScpiWire) -> None:
    talk.close()
    wire.close()


def square(
    cycles: int = 5, period_s: float = 0.1, duty: float = 0.25, low: float = 2.0, high: float = 2.5
) -> Waveform:
    """Return a square wave as protocols make it."""
    made = square_edges(
        period_s=period_s,
        duty=duty,
        low_lux=low,
        high_lux=high,
        cycles=cycles,
        first_edge_s=(1.0 - duty) * period_s,
    )
    return Waveform(made.t_s, made.lux, made.duration_s)
