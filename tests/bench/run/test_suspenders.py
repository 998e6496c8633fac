"""What keeps a run from measuring, and when it goes on."""

from __future__ import annotations

import math
import shutil
from collections import namedtuple
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from bench.run.suspenders import problems_with, suspenders_of
from bench.run.suspenders_ambient import AmbientLight, DarkRecording, chance_of_more
from bench.run.suspenders_bench import DiskRoom, SensorTemperature, SteadyLight, TransferErrors
from bench.station import Station
from drivers.errors import ConnectionFailed
from drivers.interfaces import Clock, EventCamera, LightSource, Limits, RecordingQuality
from protocols import InputError
from protocols.points import Roi
from protocols.suspend import Ambient, LightSettled, Suspend, TemperatureRange, UsbErrors
from sim_backend.devices.light import SimulatedLightSource

StationMaker = Callable[..., Station]
_Usage = namedtuple("_Usage", "total used free")


class _Clock:
    def __init__(self) -> None:
        self.time_s = 0.0

    def now(self) -> float:
        return self.time_s

    def sleep(self, seconds: float) -> None:
        self.time_s += seconds


class _Camera:
    name = "camera"

    def __init__(self) -> None:
        self.temperature = 25.0
        self.now = RecordingQuality()
        self.gone = False

    def temperature_c(self) -> float:
        self._answer()
        return self.temperature

    def quality(self) -> RecordingQuality:
        self._answer()
        return self.now

    def _answer(self) -> None:
        if self.gone:
            raise ConnectionFailed(self.name, "read it", "no answer", "is the cable in?")


class _Light:
    """A source that measures its light: it wanders by `drift` of its level with each reading."""

    name = "lamp"
    limits = Limits(1.0, 100.0, "%")

    def __init__(self) -> None:
        self.set_to = 0.0
        self.drift = 0.0
        self.readings = 0

    def level(self) -> float:
        self.readings += 1
        return self.set_to * (1.0 + self.drift * self.readings)

    def set_level(self, level: float) -> None:
        self.set_to = level


def _temperature(camera: _Camera, low: float | None, high: float | None) -> SensorTemperature:
    return SensorTemperature(cast("EventCamera", camera), low, high)


def test_a_warm_sensor_must_be_well_inside_again() -> None:
    camera = _Camera()
    suspender = _temperature(camera, 20.0, 40.0)
    told = []
    for temperature in (40.0, 40.1, 39.9, 39.1, 39.0, 39.9, 40.0, 19.9, 20.9, 21.0):
        camera.temperature = temperature
        told.append(suspender.why())
    assert [why is not None for why in told] == [False, True, True, True, False, False, False, True, True, False]
    assert told[1] == "the sensor has 40.1 C, at most 40.0 C is wanted"
    assert told[2] == "the sensor has 39.9 C, at most 39.0 C is wanted"
    assert told[7] == "the sensor has 19.9 C, at least 20.0 C is wanted"


def test_one_limit_has_half_a_degree_of_margin() -> None:
    camera = _Camera()
    suspender = _temperature(camera, None, 40.0)
    camera.temperature = 41.0
    assert suspender.why() is not None
    camera.temperature = 39.6
    assert suspender.why() is not None
    camera.temperature = 39.5
    assert suspender.why() is None


def test_a_temperature_that_is_not_told_keeps_nobody_waiting(caplog: pytest.LogCaptureFixture) -> None:
    camera = _Camera()
    camera.temperature = math.nan
    suspender = _temperature(camera, 20.0, 40.0)
    with caplog.at_level("WARNING"):
        assert suspender.why() is None
        assert suspender.why() is None
    assert [record.message for record in caplog.records] == [
        "camera does not tell its temperature: suspend.temperature_c does nothing"
    ]


def test_a_camera_that_does_not_answer_keeps_the_run_waiting() -> None:
    camera, clock = _Camera(), _Clock()
    temperature = _temperature(camera, 20.0, 40.0)
    errors = TransferErrors(cast("EventCamera", camera), clock, 3, 60.0)
    camera.gone = True
    assert "no answer" in str(temperature.why())
    assert "no answer" in str(errors.why())
    camera.gone = False
    assert temperature.why() is None
    assert errors.why() is None


def test_room_on_the_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    free_mib = iter([201.0, 199.0, 205.0, 211.0])
    asked = []

    def usage(path: Path) -> _Usage:
        asked.append(Path(path))
        return _Usage(0, 0, int(next(free_mib) * (1 << 20)))

    monkeypatch.setattr(shutil, "disk_usage", usage)
    suspender = DiskRoom(tmp_path / "not" / "yet", 200.0)
    told = [suspender.why() for _ in range(4)]
    assert [why is not None for why in told] == [False, True, True, False]
    assert told[1] == f"the disk of {tmp_path} has 199 MiB free, 200 MiB are wanted"
    assert set(asked) == {tmp_path}


def test_transfer_errors_are_counted_once_and_forgotten() -> None:
    camera, clock = _Camera(), _Clock()
    suspender = TransferErrors(cast("EventCamera", camera), clock, 4, 60.0)
    camera.now = RecordingQuality(bytes_received=10, decode_errors=1, dropped_buffers=2, overflows=1)
    assert suspender.why() is None  # as many as are let pass
    assert suspender.why() is None  # the same recording again
    clock.time_s = 30.0
    camera.now = RecordingQuality(bytes_received=11, decode_errors=3)
    assert suspender.why() == "camera: 7 transfer errors within 60 s, at most 4 are wanted"
    clock.time_s = 61.0  # the first four are over, three are more than half of what is let pass
    assert suspender.why() == "camera: 3 transfer errors within 60 s, at most 2 are wanted"
    clock.time_s = 91.0
    assert suspender.why() is None


def _steady(light: _Light, clock: Clock) -> SteadyLight:
    return SteadyLight(cast("LightSource", light), clock, 0.01, 4.0)


def test_a_light_that_wanders_is_waited_for_and_lit_meanwhile() -> None:
    light, clock = _Light(), _Clock()
    suspender = _steady(light, clock)
    assert suspender.why() is None  # dark: nothing to look at
    light.set_to, light.drift = 50.0, 0.01
    why = suspender.why()
    assert why is not None
    assert "% within 4 s" in why
    assert clock.time_s == 4.0
    light.set_to = 0.0  # the run waits, and made it dark
    assert suspender.why() is not None
    assert light.set_to == pytest.approx(50.0, rel=0.1)
    light.drift = 0.0
    assert suspender.why() is None
    light.set_to = 0.0
    assert suspender.why() is None
    assert light.set_to == 0.0  # and it is left alone again


def test_only_a_light_that_is_measured_can_be_waited_for(make_station: StationMaker, tmp_path: Path) -> None:
    suspend = Suspend(light_settled=LightSettled(within=0.01, within_s=1.0))
    station = make_station()
    assert len(problems_with(suspend, station)) == 1
    with pytest.raises(InputError, match=r"suspend\.light_settled: .* does not measure its light"):
        suspenders_of(suspend, station, tmp_path)

    class Measuring(SimulatedLightSource):
        level_is_measured = True

    station = make_station(light=Measuring)
    assert problems_with(suspend, station) == ()
    assert [one.name for one in suspenders_of(suspend, station, tmp_path)] == ["disk_free_mib", "light_settled"]


def test_all_conditions_are_there_that_are_asked_for(make_station: StationMaker, tmp_path: Path) -> None:
    suspend = Suspend(
        temperature_c=TemperatureRange(low=0, high=60),
        ambient=Ambient(every_points=1),
        usb_errors=UsbErrors(at_most=1, per_s=10),
    )
    station = make_station()
    found = suspenders_of(suspend, station, tmp_path, lambda: (0, 1.0))
    assert [one.name for one in found] == ["disk_free_mib", "temperature_c", "usb_errors", "ambient"]
    with station:
        station.connect()
        assert [one.why() for one in found] == [None] * 4
    assert suspenders_of(Suspend(disk_free_mib=None), station, tmp_path) == ()
    with pytest.raises(InputError, match=r"suspend\.ambient"):
        suspenders_of(suspend, station, tmp_path)


def test_events_in_the_dark_are_compared_as_counts() -> None:
    assert chance_of_more((0, 100.0), (0, 100.0), 3.0) == 1.0
    assert chance_of_more((0, 100.0), (3, 100.0), 3.0) == pytest.approx(0.75**3)
    assert chance_of_more((2, 100.0), (10, 100.0), 3.0) > 0.3  # five times as many, and still chance
    assert chance_of_more((200, 100.0), (1000, 100.0), 3.0) < 1e-6
    assert chance_of_more((200, 100.0), (1000, 200.0), 3.0) > 0.5
    rng = np.random.default_rng(5)
    chances = [chance_of_more((int(a), 1.0), (int(b), 1.0), 3.0) for a, b in rng.poisson((20, 60), (2000, 2))]
    assert np.mean(np.array(chances) < 0.05) < 0.06  # what is allowed is no alarm


def _ambient(folder: Path, answers: list[tuple[int, float]], clock: Clock, **keys: Any) -> AmbientLight:
    return AmbientLight(Ambient.model_validate(keys), clock, folder, lambda: answers.pop(0))


def test_light_of_the_room_is_looked_for_after_some_points(tmp_path: Path) -> None:
    answers = [(100, 50.0), (120, 50.0), (900, 50.0), (420, 50.0), (110, 50.0)]
    suspender = _ambient(tmp_path, answers, _Clock(), every_points=2)
    (tmp_path / "points").mkdir()
    told = [suspender.why(), suspender.why()]
    assert len(answers) == 4  # the reference, and nothing since no point was taken
    for number in range(4):
        (tmp_path / "points" / f"{number:06d}.h5").touch()
        told.append(suspender.why())
    assert told == [None] * 5 + [
        "light of the room: 18 events/s per pixel in the dark (900 events), 2 at the beginning (100 events), at most "
        "3 times that is wanted; is a door or the shroud open?"
    ]
    assert suspender.why() is not None  # looked at again while the run waits: 4.2 times may not go on
    assert suspender.why() is None
    assert not answers


def test_light_of_the_room_is_looked_for_after_some_time(tmp_path: Path) -> None:
    clock = _Clock()
    answers = [(10, 50.0), (10, 50.0)]
    suspender = _ambient(tmp_path, answers, clock, every_s=60.0)
    assert suspender.why() is None
    clock.time_s = 59.0
    assert suspender.why() is None
    assert len(answers) == 1
    clock.time_s = 60.0
    assert suspender.why() is None
    assert not answers


def test_no_recording_in_the_dark_is_tried_again(tmp_path: Path) -> None:
    failures = [ConnectionFailed("camera", "start", "no answer")]

    def dark_rate() -> tuple[int, float]:
        if failures:
            raise failures.pop()
        return 10, 50.0

    suspender = AmbientLight(Ambient(every_points=1), _Clock(), tmp_path, dark_rate)
    assert "no answer" in str(suspender.why())
    assert suspender.why() is None


def test_a_recording_in_the_dark_sees_the_light_of_the_room(make_station: StationMaker) -> None:
    station = make_station(noise_rms=0.08)
    with station:
        station.connect()
        station.light.set_level(50.0)
        dark = DarkRecording(station, Roi(10, 20, 4, 3), {}, duration_s=3.0)
        events, pixel_s = dark()
        assert pixel_s == 36.0
        assert events > 0
        assert station.light.level() == 0.0
