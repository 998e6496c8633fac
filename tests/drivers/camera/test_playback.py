"""A recording that is played back is what was recorded."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from drivers.camera.playback import PlaybackCamera
from drivers.errors import ConnectionFailed
from drivers.events.encode import raw_header
from drivers.interfaces import Recording
from protocols.errors import InputError
from protocols.points import Roi
from tests.drivers.camera.evk4_rigs import emulated, read, simulated
from tests.drivers.camera.other_rigs import recorded

if TYPE_CHECKING:
    from pathlib import Path

ROI = Roi(590, 310, 8, 6)


def played(camera: PlaybackCamera) -> None:
    camera.start(Recording())
    camera.stop()


def test_events_are_those_that_were_recorded_in_the_window(tmp_path: Path) -> None:
    recorded(tmp_path / "a.raw", ROI)
    events, triggers = simulated().record(ROI)
    camera = PlaybackCamera(tmp_path / "a.raw")
    camera.connect()
    played(camera)
    found, found_triggers = read(camera)
    np.testing.assert_array_equal(found, events)
    np.testing.assert_array_equal(found_triggers, triggers)
    camera.set_roi(Roi(592, 311, 2, 3))
    played(camera)
    inside = (np.abs(events["x"] - 592.5) < 1) & (np.abs(events["y"] - 312.0) < 2)
    np.testing.assert_array_equal(read(camera)[0], events[inside])


def test_what_the_driver_keeps_can_be_played_back(tmp_path: Path) -> None:
    bench, camera, _ = emulated(raw_folder=tmp_path)
    camera.connect()
    events, _ = bench.record(ROI)
    playback = PlaybackCamera(tmp_path / "recording.raw")
    playback.connect()
    played(playback)
    np.testing.assert_array_equal(read(playback)[0], events)
    assert (playback.width, playback.height) == (1280, 720)
    assert playback.identity()["model"] == "recording recording.raw (EVT3)"


def test_time_begins_with_the_first_step_of_the_stream(tmp_path: Path) -> None:
    words = np.array([0x8010, 0x0007, 0x6005, 0x2809, 0x8011, 0x6006, 0x2809], "<u2")
    (tmp_path / "late.raw").write_bytes(raw_header(640, 480) + words.tobytes())
    camera = PlaybackCamera(tmp_path / "late.raw")
    camera.connect()
    assert (camera.width, camera.height) == (640, 480)
    played(camera)
    assert read(camera)[0]["t"].tolist() == [5, 4096 + 6]


def test_steps_that_are_missing_in_the_file_are_overflows(tmp_path: Path) -> None:
    words = np.array([0x8000, 0x0007, 0x2809, 0x8005, 0x2809, 0x1000], "<u2")
    (tmp_path / "gap.raw").write_bytes(raw_header(640, 480) + words.tobytes())
    camera = PlaybackCamera(tmp_path / "gap.raw")
    camera.connect()
    played(camera)
    quality = camera.quality()
    assert (quality.bytes_received, quality.overflows, quality.decode_errors) == (12, 1, 1)


def test_a_file_that_cannot_be_played_is_said(tmp_path: Path) -> None:
    with pytest.raises(ConnectionFailed, match=r"camera: open the recording: .*missing\.raw"):
        PlaybackCamera(tmp_path / "missing.raw").connect()
    with pytest.raises(InputError, match="0 x 720 pixels"):
        PlaybackCamera(tmp_path / "missing.raw", width=0)
