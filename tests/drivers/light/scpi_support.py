"""An emulated function generator on a network socket, and the driver that talks to it."""

from __future__ import annotations

import weakref
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from drivers.interfaces import Waveform
from drivers.light.scpi_generator import ScpiGenerator
from protocols.waveforms import reset_test_edges, square_edges
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


def pulses(
    cycles: int = 3,
    base: float = 2.0,
    reset: float = 4.0,
    test: float = 2.5,
    gap_s: float = 0.04,
    test_s: float = 0.04,
) -> Waveform:
    """Return reset and test pulses as protocols make them."""
    made = reset_test_edges(
        baseline_lux=base, reset_lux=reset, test_lux=test, gap_s=gap_s, reset_s=0.03, test_s=test_s, cycles=cycles
    )
    return Waveform(made.t_s, made.lux, made.duration_s)


def with_unequal_gaps(waveform: Waveform, unit_s: float = 0.01) -> Waveform:
    """Return a waveform behind four edges, no two of whose distances are alike."""
    low, high = waveform.level[0], waveform.level[1]
    edges_s = 0.1 + unit_s * np.array([0.0, 1.0, 4.0, 6.0])
    shift_s = float(edges_s[-1]) + 0.1
    return Waveform(
        np.concatenate([[0.0], edges_s, waveform.t_s[1:] + shift_s]),
        np.concatenate([[low], [high, low, high, low], waveform.level[1:]]),
        waveform.duration_s + shift_s,
    )
