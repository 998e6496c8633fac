"""A recording to play back, and a stand-in for the package neuromorphic-drivers, for tests."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from drivers.events.encode import Evt3Encoder, raw_header
from drivers.interfaces import Recording
from protocols.points import Roi
from sim_backend.devices.camera import SimulatedCamera
from tests.drivers.camera.evk4_rigs import Behaviour, lit_world, simulated

if TYPE_CHECKING:
    from pathlib import Path

    from sim_backend.world import OpticalBench


def recorded(path: Path, roi: Roi, seed: int = 1) -> None:
    """Leave a RAW file with a flicker in `roi`."""
    bench = simulated()
    bench.record(roi, seed)
    encoder = Evt3Encoder(1280, 720)
    words = b"".join(encoder.feed(chunk.events, chunk.triggers) for chunk in bench.camera.chunks())
    path.write_bytes(raw_header(1280, 720) + words)


@dataclass
class Biases:
    """As the package has it, in the fields that matter."""

    fo: int = 0
    hpf: int = 0
    diff_on: int = 0
    diff: int = 0
    diff_off: int = 0
    refr: int = 0


@dataclass
class Configuration:
    """As the package has it, in the fields that matter."""

    biases: Biases = field(default_factory=Biases)
    x_mask: tuple[int, ...] = (0,) * 20
    y_mask: tuple[int, ...] = (0,) * 12
    enable_external_trigger: bool = True
    enable_output: bool = True


class Device:
    """A camera of the package, on a simulated one."""

    def __init__(self, world: OpticalBench, configuration: Configuration) -> None:
        self._camera = SimulatedCamera(world, bias_behaviour=Behaviour())
        self._camera.connect()
        self._world = world
        self._configuration = configuration
        self.packets: list[bytes] = []
        self.dropped = 0
        self.broken = False

    def __enter__(self) -> Device:
        return self

    def __exit__(self, *exception: object) -> None:
        pass

    def __next__(self) -> tuple[Any, bytes | None]:
        if self.broken:
            raise RuntimeError("Disconnected")
        packet = self.packets.pop(0) if self.packets else None
        if packet is None:
            time.sleep(1e-3)
        ring = None if packet is None else SimpleNamespace(dropped_packets=self.dropped)
        return SimpleNamespace(ring=ring), packet

    def serial(self) -> str:
        return "0000ABCD"

    def temperature_celsius(self) -> float:
        return self._world.temperature_c

    def biases_bounds(self) -> Any:
        bounds = SimpleNamespace(minimum=-20, maximum=180)
        return SimpleNamespace(fo=bounds, hpf=bounds, diff_on=bounds, diff=bounds, diff_off=bounds, refr=bounds)

    def clear_backlog(self, until: int) -> None:
        del self.packets[until:]

    def update_configuration(self, configuration: Configuration) -> None:
        was, self._configuration = self._configuration.enable_output, configuration
        if configuration.enable_output and not was:
            offsets = {f"bias_{name}": value for name, value in vars(configuration.biases).items()}
            self._camera.set_biases({name: o for name, o in offsets.items() if name in Behaviour.ranges})
            self._camera.set_roi(window(configuration))
            self._camera.start(Recording(seed=1))
        elif was and not configuration.enable_output:
            self._camera.stop()
            encoder = Evt3Encoder(1280, 720)
            self.packets += [encoder.feed(c.events, c.triggers) for c in self._camera.chunks()]


def window(configuration: Configuration) -> Roi:
    """Return the window that the masks leave."""
    lines = []
    for mask, size in ((configuration.x_mask, 1280), (configuration.y_mask, 720)):
        bits = np.unpackbits(np.array(mask, "<u8").view(np.uint8), bitorder="little")[:size]
        lines.append(np.flatnonzero(bits == 0))
    x, y = lines
    return Roi(int(x[0]), int(y[0]), len(x), len(y))


class Library:
    """What is used of the package."""

    prophesee_evk4 = SimpleNamespace(Configuration=Configuration, Biases=Biases)

    def __init__(self, world: OpticalBench) -> None:
        self._world = world
        self.device: Device | None = None

    def open(self, configuration: Configuration, iterator_timeout: float, raw: bool, serial: str | None) -> Device:
        assert raw
        if serial not in (None, "0000ABCD"):
            raise RuntimeError("device not found")
        self.device = Device(self._world, configuration)
        return self.device


def library() -> tuple[Library, Any, Any]:
    """Return the stand-in, the world and its lamp."""
    world, light = lit_world()
    return Library(world), world, light
