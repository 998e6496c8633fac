"""What every event camera does, real or simulated."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from drivers.errors import OutOfRange, WrongState
from drivers.events.types import EVENT_DTYPE, TRIGGER_DTYPE
from drivers.interfaces import Recording
from protocols.points import Roi

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    from drivers.events.types import EventChunk
    from drivers.interfaces import EventCamera
    from tests.contract.conftest import CameraRig

WINDOW = Roi(40, 30, 8, 4)


def events_of(chunks: list[EventChunk]) -> npt.NDArray[np.void]:
    return np.concatenate([chunk.events for chunk in chunks])


def triggers_of(chunks: list[EventChunk]) -> npt.NDArray[np.void]:
    return np.concatenate([chunk.triggers for chunk in chunks])


@pytest.fixture(name="seeing")
def camera_that_sees(camera_rig: CameraRig) -> CameraRig:
    """Return a rig whose camera is connected and looks at a small window."""
    camera_rig.camera.connect()
    camera_rig.camera.set_roi(WINDOW)
    return camera_rig


def test_says_what_it_is(camera_rig: CameraRig) -> None:
    camera = camera_rig.camera
    assert camera.width > 0
    assert camera.height > 0
    assert all(limits.lowest <= 0.0 <= limits.highest and limits.unit for limits in camera.bias_limits.values())


def test_biases_are_at_the_factory_codes_after_connect(camera_rig: CameraRig) -> None:
    camera = camera_rig.camera
    camera.connect()
    assert camera.biases() == dict.fromkeys(camera.bias_limits, 0)


def test_biases_are_read_back_and_those_not_named_go_to_0(camera_rig: CameraRig) -> None:
    camera = camera_rig.camera
    camera.connect()
    for bias, limits in camera.bias_limits.items():
        for offset in (int(limits.lowest), int(limits.highest)):
            camera.set_biases({bias: offset})
            assert camera.biases() == {**dict.fromkeys(camera.bias_limits, 0), bias: offset}
    camera.set_biases({})
    assert camera.biases() == dict.fromkeys(camera.bias_limits, 0)


def test_bias_out_of_range_is_refused_and_changes_nothing(camera_rig: CameraRig) -> None:
    camera = camera_rig.camera
    camera.connect()
    bias, limits = next(iter(camera.bias_limits.items()))
    camera.set_biases({bias: int(limits.highest)})
    for bad in (int(limits.highest) + 1, int(limits.lowest) - 1):
        with pytest.raises(OutOfRange, match=f"{bias} to {bad} .*allowed is {limits.lowest:g} to {limits.highest:g}"):
            camera.set_biases({bias: bad})
    with pytest.raises(WrongState, match=f"no such bias; it has .*{bias}"):
        camera.set_biases({"bias_of_nothing": 0})
    assert camera.biases()[bias] == int(limits.highest)


def test_recorded_events_are_in_order_within_window_and_recording(seeing: CameraRig) -> None:
    chunks = seeing.record()
    events = events_of(chunks)
    assert events.dtype == EVENT_DTYPE
    assert np.all(np.diff(events["t"]) >= 0)
    assert events["t"][0] >= 0
    assert events["t"][-1] <= 500_000
    assert set(zip(events["x"].tolist(), events["y"].tolist(), strict=True)) == {
        (x, y) for x in range(WINDOW.x, WINDOW.x + WINDOW.width) for y in range(WINDOW.y, WINDOW.y + WINDOW.height)
    }
    assert set(events["p"].tolist()) == {0, 1}


def test_time_starts_at_0_with_each_recording(seeing: CameraRig) -> None:
    first, second = events_of(seeing.record()), events_of(seeing.record())
    assert abs(int(second["t"][-1]) - int(first["t"][-1])) < 60_000
    assert second["t"][0] < 200_000


def test_triggers_come_in_order_one_for_each_edge(seeing: CameraRig) -> None:
    camera = seeing.camera
    camera.start(Recording(seed=2))
    edges = seeing.flicker()
    camera.stop()
    triggers = triggers_of(list(camera.chunks()))
    assert triggers.dtype == TRIGGER_DTYPE
    assert len(triggers) == edges
    assert np.all(np.diff(triggers["t"]) > 0)
    assert np.all(np.diff(triggers["p"].astype(int)) != 0)


def test_a_trigger_is_never_in_a_later_chunk_than_events_after_it(seeing: CameraRig) -> None:
    chunks = seeing.record()
    for earlier, later in pairwise(chunks):
        if len(earlier.events) and len(later.triggers):
            assert later.triggers["t"][0] >= earlier.events["t"][-1]


def test_same_seed_same_events(seeing: CameraRig) -> None:
    if not seeing.repeatable:
        return
    first, again, other = (events_of(seeing.record(seed)) for seed in (7, 7, 8))
    np.testing.assert_array_equal(first, again)
    assert len(first) != len(other) or np.any(first != other)


@pytest.mark.parametrize(
    "roi", [Roi(-1, 0, 4, 4), Roi(0, -1, 4, 4), Roi(0, 0, 0, 4), Roi(0, 0, 4, 0), Roi(1 << 16, 0, 4, 4)]
)
def test_window_that_does_not_fit_is_refused_and_changes_nothing(seeing: CameraRig, roi: Roi) -> None:
    with pytest.raises(OutOfRange, match=r"set window .*pixel: allowed is"):
        seeing.camera.set_roi(roi)
    events = events_of(seeing.record())
    assert events["x"].min() == WINDOW.x
    assert events["y"].max() == WINDOW.y + WINDOW.height - 1


def test_window_past_the_edge_of_the_sensor_is_refused(camera_rig: CameraRig) -> None:
    camera = camera_rig.camera
    camera.connect()
    with pytest.raises(OutOfRange, match="window width"):
        camera.set_roi(Roi(camera.width - 1, 0, 2, 1))
    with pytest.raises(OutOfRange, match="window height"):
        camera.set_roi(Roi(0, camera.height - 1, 1, 2))


def test_start_and_stop_only_when_it_makes_sense(seeing: CameraRig) -> None:
    camera = seeing.camera
    with pytest.raises(WrongState, match="call start"):
        camera.stop()
    with pytest.raises(WrongState, match="call start"):
        camera.chunks()
    camera.start(Recording())
    with pytest.raises(WrongState, match="a recording is running; call stop"):
        camera.start(Recording())
    camera.stop()


def test_safe_state_ends_a_recording_and_the_next_one_is_sound(seeing: CameraRig) -> None:
    camera = seeing.camera
    camera.start(Recording(seed=3))
    seeing.flicker()
    camera.safe_state()
    camera.safe_state()
    events = events_of(seeing.record(seed=3))
    assert len(events) > WINDOW.pixels


def test_recording_can_be_read_after_the_settings_changed(seeing: CameraRig) -> None:
    camera = seeing.camera
    camera.start(Recording(seed=4))
    seeing.flicker()
    camera.stop()
    camera.set_roi(Roi(0, 0, 2, 2))
    assert events_of(list(camera.chunks()))["x"].min() == WINDOW.x


def test_read_backs_are_numbers(camera_rig: CameraRig) -> None:
    camera = camera_rig.camera
    camera.connect()
    refractory_s, temperature_c = camera.refractory_s(), camera.temperature_c()
    assert math.isnan(refractory_s) or 0.0 <= refractory_s < 10.0
    assert math.isnan(temperature_c) or -50.0 < temperature_c < 150.0


def test_quality_of_a_sound_recording(seeing: CameraRig) -> None:
    seeing.record()
    quality = seeing.camera.quality()
    assert (quality.decode_errors, quality.dropped_buffers, quality.overflows, quality.gaps_s) == (0, 0, 0, ())


_NEED_A_CONNECTION: dict[str, Callable[[EventCamera], Any]] = {
    "set_roi": lambda camera: camera.set_roi(WINDOW),
    "set_biases": lambda camera: camera.set_biases({}),
    "biases": lambda camera: camera.biases(),
    "refractory_s": lambda camera: camera.refractory_s(),
    "temperature_c": lambda camera: camera.temperature_c(),
    "start": lambda camera: camera.start(Recording()),
    "stop": lambda camera: camera.stop(),
    "chunks": lambda camera: camera.chunks(),
    "quality": lambda camera: camera.quality(),
}


@pytest.mark.parametrize("ask", _NEED_A_CONNECTION.values(), ids=_NEED_A_CONNECTION.keys())
def test_needs_a_connection(camera_rig: CameraRig, ask: Callable[[EventCamera], Any]) -> None:
    with pytest.raises(WrongState, match="not connected; call connect"):
        ask(camera_rig.camera)
