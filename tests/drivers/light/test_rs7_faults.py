"""Whatever goes wrong on the wire of an RS-7: the driver goes on right or says so, and the light can be made dark."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np
import pytest

from drivers.errors import DeviceError
from drivers.interfaces import Waveform
from drivers.light.rs7 import SpectralLed
from sim_backend.wire.faults import Fault, FaultPlan, Faults
from sim_backend.wire.rs7 import Rs7Firmware
from sim_backend.wire.serial_wire import SerialWire
from sim_backend.world import OpticalBench

if TYPE_CHECKING:
    from collections.abc import Iterator

ON_A_WIRE = [
    Fault.REPLY_LOST,
    Fault.REPLY_LATE,
    Fault.REPLY_CUT,
    Fault.GARBAGE,
    Fault.ALARM,
    Fault.REBOOT,
    Fault.UNPLUGGED,
]
WAVEFORM = Waveform(np.array([0.0, 0.1, 0.2]), np.array([500.0, 1000.0, 0.0]), 0.3)
IMPATIENT_S, PATIENT_S, LASTS_S = 0.12, 20.0, 0.25


@contextmanager
def bench(faults: Faults, **arguments: str) -> Iterator[tuple[OpticalBench, SpectralLed]]:
    world = OpticalBench(lux_per_level=0.05, pixel={}, sensor_seed=5)
    wire = SerialWire(Rs7Firmware(world, **arguments), "rs7", faults)  # type: ignore[arg-type]
    light = SpectralLed(wire.path, clock=world.clock, player="inline", timeout_s=PATIENT_S)
    try:
        yield world, light
    finally:
        light.close()
        wire.close()


def session(world: OpticalBench, light: SpectralLed, *, impatient: bool) -> str:
    """Do what a run does; return at what the driver gave up, or nothing."""
    light._talk.link.timeout_s = IMPATIENT_S if impatient else PATIENT_S
    doing = "connect"
    try:
        light.connect()
        assert world.level == 0.0, doing
        doing = "set_level"
        light.set_level(1000.0)
        assert world.level == 1000.0, doing
        doing = "play"
        light.play(WAVEFORM)
        assert world.level == 0.0, doing
        light.set_level(2000.0)
        doing = "safe_state"
        light.safe_state()
        doing = "close"
        light.close()
    except DeviceError:
        return doing
    return ""


def commands() -> int:
    """Return how many commands a session takes."""
    faults = Faults()
    with bench(faults) as (world, light):
        assert session(world, light, impatient=False) == ""
    return faults.requests


def _used(world: OpticalBench, light: SpectralLed) -> bool:
    """Return whether a session comes to its end; if not, wait until what lasts is over."""
    if not session(world, light, impatient=False):
        return True
    time.sleep(2.0 * LASTS_S)
    return False


def befall(fault: Fault, at: int) -> str:
    """Let a fault befall one command of a session; return what is wrong afterwards."""
    faults = Faults([FaultPlan(fault, at, seconds=LASTS_S)])
    with bench(faults) as (world, light):
        try:
            session(world, light, impatient=True)
        except AssertionError as error:
            return f"{fault} at {at}: went on with the wrong level at {error}"
        light._talk.link.timeout_s = PATIENT_S
        for _ in range(400):  # after some of these the wire is whole again only later
            try:
                if light.connected:
                    light.safe_state()
                else:
                    light.connect()
            except DeviceError:
                pass
            else:
                if light.unsafe is None:
                    break
            time.sleep(0.05)
        if world.level != 0.0 or light.unsafe is not None:
            return f"{fault} at {at}: not dark afterwards: {world.level} {light.unsafe}"
        light.close()
        # On a busy computer a session may give up before the fault has come, and it comes into the next one.
        used = any(_used(world, light) for _ in range(5))
        return f"{fault} at {at}: cannot be used afterwards" if not used else ""


@pytest.mark.parametrize("fault", ON_A_WIRE)
def test_goes_on_right_or_says_so_and_can_be_made_dark(fault: Fault) -> None:
    with ThreadPoolExecutor(16) as several:
        wrong = [problem for problem in several.map(lambda at: befall(fault, at), range(commands())) if problem]
    assert not wrong, "\n".join(wrong)
