"""The camera through neuromorphic-drivers, on a stand-in for that package."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.camera.neuromorphic import NeuromorphicCamera
from drivers.errors import ConnectionFailed
from drivers.interfaces import Recording
from protocols.points import Roi
from tests.drivers.camera.evk4_rigs import Bench, simulated
from tests.drivers.camera.other_rigs import Library, library

ROI = Roi(590, 310, 8, 6)


def bench() -> tuple[Bench, NeuromorphicCamera, Library]:
    package, world, light = library()
    camera = NeuromorphicCamera(clock=world.clock, library=package)
    return Bench(world, light, camera), camera, package


def test_events_are_those_of_the_camera() -> None:
    other, camera, _ = bench()
    camera.connect()
    biases = {"bias_diff_on": 30, "bias_refr": 100}
    events, triggers = other.record(ROI, 1, biases)
    expected_events, expected_triggers = simulated().record(ROI, 1, biases)
    np.testing.assert_array_equal(events, expected_events)
    np.testing.assert_array_equal(triggers, expected_triggers)
    assert camera.biases()["bias_refr"] == 100
    assert camera.bias_limits["bias_refr"].highest == 180  # what the camera has, below what is recommended
    assert camera.temperature_c() == 25.0
    camera.close()


def test_packets_that_were_dropped_are_counted_and_are_a_gap() -> None:
    other, camera, package = bench()
    camera.connect()
    assert package.device is not None
    package.device.dropped = 3
    other.record(ROI)
    quality = camera.quality()
    assert quality.dropped_buffers >= 3
    assert quality.gaps_s
    camera.close()


def test_a_stream_that_breaks_off_is_said() -> None:
    _, camera, package = bench()
    camera.connect()
    assert package.device is not None
    camera.start(Recording())
    package.device.broken = True
    with pytest.raises(ConnectionFailed, match="the stream broke off: Disconnected"):
        camera.stop()
    camera.close()


def test_a_camera_that_is_not_there_is_said() -> None:
    package, world, _ = library()
    camera = NeuromorphicCamera(clock=world.clock, library=package, serial="00000001")
    with pytest.raises(ConnectionFailed, match="open it: device not found"):
        camera.connect()


def test_another_version_of_the_package_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("drivers.camera.neuromorphic.version", lambda _: "0.17.0")
    _, world, _ = library()
    with pytest.raises(ConnectionFailed, match=r"it is 0\.17\.0; pip install neuromorphic-drivers==0\.18\.2"):
        NeuromorphicCamera(clock=world.clock).connect()
