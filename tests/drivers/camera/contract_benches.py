"""One bench for each camera driver, for the tests that all cameras must pass."""

from __future__ import annotations

import atexit
import functools
import shutil
import tempfile
from pathlib import Path

from drivers.camera.evk4.evk4 import Evk4
from drivers.camera.neuromorphic import NeuromorphicCamera
from drivers.camera.playback import PlaybackCamera
from protocols.points import Roi
from sim_backend.wire.evk4_usb import Evk4Usb
from tests.drivers.camera.evk4_rigs import Behaviour, Bench, emulated, lit_world
from tests.drivers.camera.other_rigs import library, recorded

#: The window at which the tests look.
WINDOW = Roi(40, 30, 8, 4)


def evk4_bench() -> Bench:
    """Return a bench with the driver as it is used on a real camera."""
    world, light = lit_world()
    usb = Evk4Usb(world, bias_behaviour=Behaviour())
    return Bench(world, light, Evk4(clock=world.clock, backend=usb))


def wired_evk4_bench() -> Bench:
    """Return a bench whose emulated camera is told the seeds."""
    return emulated()[0]


def neuromorphic_bench() -> Bench:
    """Return a bench with a stand-in for the package."""
    package, world, light = library()
    return Bench(world, light, NeuromorphicCamera(clock=world.clock, library=package))


def playback_bench() -> Bench:
    """Return a bench whose camera plays back a flicker, whatever the light does."""
    world, light = lit_world()
    return Bench(world, light, PlaybackCamera(_flicker_file()))


@functools.cache
def _flicker_file() -> Path:
    folder = Path(tempfile.mkdtemp(prefix="evs-bench-test-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    recorded(folder / "flicker.raw", WINDOW)
    return folder / "flicker.raw"
