"""Speed of the EVK4 driver: events per second from an emulated USB into memory, and on to decoded events.

    python benchmarks/evk4_stream.py [millions of events]

The stream is that of benchmarks/decode.py: half singles, half vectors, about 2.7 bytes an event. The emulated camera
hands it out as fast as the driver asks, in transfers of 128 KiB. Reading and decoding follow each other, as they do
in a run, and each is timed; the best of several rounds is told. Nothing may be dropped, or the figure means nothing:
the pool has room for all of it, since no camera is as fast as this one.
"""

from __future__ import annotations

import platform
import sys
import time
from typing import TYPE_CHECKING, Final

import numpy as np

from benchmarks.decode import make_stream
from drivers.camera.evk4.evk4 import Evk4
from drivers.interfaces import Recording
from sim_backend.wire.evk4_usb import Evk4Usb
from sim_backend.world import OpticalBench

if TYPE_CHECKING:
    from collections.abc import Mapping

GOAL_PER_S: Final = 20e6
ROUNDS: Final = 5


class NoBiases:
    """A sensor whose biases do nothing."""

    ranges: Mapping[str, tuple[int, int]] = {}

    def settings_at(self, offsets: Mapping[str, int]) -> dict[str, float]:  # noqa: ARG002
        """Return no setting."""
        return {}


def record(camera: Evk4, usb: Evk4Usb, world: OpticalBench, stream: bytes, duration_s: float) -> tuple[float, float]:
    """Return how long a recording took to be read, and to be decoded, s."""
    usb.replay(stream)
    begin = time.perf_counter()
    camera.start(Recording())
    world.clock.sleep(duration_s)
    camera.stop()
    read = time.perf_counter()
    n_events = sum(len(chunk.events) for chunk in camera.chunks())
    decoded = time.perf_counter()
    quality = camera.quality()
    if (quality.decode_errors, quality.dropped_buffers, quality.overflows, quality.gaps_s) != (0, 0, 0, ()):
        sys.exit(f"events were lost: {quality}, {n_events} events came")
    return read - begin, decoded - read


def main() -> None:
    """Measure, and print."""
    n = int(float(sys.argv[1]) * 1e6) if len(sys.argv) > 1 else 20_000_000
    stream, events, _ = make_stream(n)
    duration_s = float(events["t"][-1]) / 1e6
    world = OpticalBench(lux_per_level=0.05, pixel={}, sensor_seed=1)
    usb = Evk4Usb(world, bias_behaviour=NoBiases())
    camera = Evk4(clock=world.clock, backend=usb, transfers=4096)
    camera.connect()
    times = np.array([record(camera, usb, world, stream, duration_s) for _ in range(ROUNDS + 1)][1:])
    camera.close()
    read_s, decode_s = times.min(axis=0)
    both_s = times.sum(axis=1).min()
    print(f"{platform.machine()}, Python {platform.python_version()}, {n / 1e6:g} million events, ", end="")
    print(f"{len(stream) / n:.2f} bytes an event")
    print(f"read    {n / read_s / 1e6:8.1f} million events/s")
    print(f"decode  {n / decode_s / 1e6:8.1f} million events/s")
    print(f"both    {n / both_s / 1e6:8.1f} million events/s, goal {GOAL_PER_S / 1e6:g}")


if __name__ == "__main__":
    main()
