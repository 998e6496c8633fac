"""A station file to write mistakes into, and drivers that can be told to fail."""

from __future__ import annotations

import copy
import sys
import types
from typing import TYPE_CHECKING, Any

import pytest
import yaml

from drivers.errors import ConnectionFailed
from drivers.interfaces import Device, EventCamera, Filter, FilterWheel, LightSource, Limits

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from drivers.interfaces import PlayedWaveform, Waveform

MODULE = "lab_of_tests"

_STATION = f"""
format: evs-bench-station/1
name: lab
roles:
  light:
    driver: {MODULE}:Lamp
    args: {{}}
  wheel:
    driver: {MODULE}:Wheel
  camera:
    driver: {MODULE}:Camera
  clock:
    driver: drivers.clock:RealClock
sensor: {{name: toy, width: 64, height: 48, pixel_pitch_m: 5.0e-6, quantum_efficiency: 0.5}}
calibration:
  light: {{unit: cd/m2, lux_per_level: 0.5}}
  filters:
    none: {{nd_od: 0.0, transmission: 1.0}}
    grey: {{nd_od: 2.0, transmission: 0.012}}
  bias_map:
    theta_on: {{bias: bias_a, scale: log, calibrated: true, table: [[-10, 0.1], [0, 0.2], [20, 0.8]]}}
    refractory_s: {{bias: bias_b, scale: linear, calibrated: false, table: [[0, 0.01], [100, 0.001]]}}
"""


class Diary:
    """What happened to the devices, in order, and which of them shall fail."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.fail_at: dict[str, Exception] = {}

    def note(self, line: str) -> None:
        self.lines.append(line)
        if line in self.fail_at:
            raise self.fail_at[line]


class Noting(Device):
    """A device that notes in the diary what is done with it."""

    diary = Diary()

    def identity(self) -> dict[str, str]:
        return {"maker": "lab", "model": self.name, "serial": "1", "firmware": "2"}

    def _connect(self) -> None:
        self.diary.note(f"{self.name} connects")

    def _close(self) -> None:
        self.diary.note(f"{self.name} closes")

    def _safe_state(self) -> None:
        self.diary.note(f"{self.name} safe")


class Lamp(Noting, LightSource):
    def __init__(self, *, highest: float = 1000.0, secret: object = None) -> None:
        super().__init__("lamp")
        self.timing, self.edge_time_s, self.settling_s = "device", 0.0, 0.0
        self.limits = Limits(1.0, highest, "cd/m2")
        self.secret = secret

    def level(self) -> float:
        raise NotImplementedError

    def _set_level(self, level: float) -> None:
        raise NotImplementedError

    def _play(self, waveform: Waveform) -> PlayedWaveform:
        raise NotImplementedError


class Wheel(Noting, FilterWheel):
    filters = (Filter("none", 0.0), Filter("grey", 2.0))

    def __init__(self) -> None:
        super().__init__("wheel")

    def selected(self) -> str:
        raise NotImplementedError

    def _select(self, name: str) -> None:
        raise NotImplementedError


class Camera(Noting, EventCamera):
    width, height = 64, 48
    bias_limits = {"bias_a": Limits(-10, 20, "offset"), "bias_b": Limits(0, 100, "offset")}  # noqa: RUF012

    def __init__(self) -> None:
        super().__init__("camera")

    def _never(self, *_: Any) -> Any:
        raise NotImplementedError

    biases: Any = _never
    refractory_s: Any = _never
    temperature_c: Any = _never
    start: Any = _never
    stop: Any = _never
    chunks: Any = _never
    quality: Any = _never
    _set_roi: Any = _never
    _set_biases: Any = _never


@pytest.fixture(name="diary")
def diary_of_devices(monkeypatch: pytest.MonkeyPatch) -> Diary:
    """Install a module with drivers of a lab; the diary says what happens to them."""
    diary = Diary()
    monkeypatch.setattr(Noting, "diary", diary)
    module = types.ModuleType(MODULE)
    vars(module).update({cls.__name__: cls for cls in (Lamp, Wheel, Camera)})
    monkeypatch.setitem(sys.modules, MODULE, module)
    return diary


@pytest.fixture(name="write")
def write_station(tmp_path: Path, diary: Diary) -> Callable[..., Path]:
    """Return a function that writes a station file, with the values at some paths replaced."""
    del diary

    def write(changes: dict[str, Any] | None = None, name: str = "lab.yaml") -> Path:
        data = copy.deepcopy(yaml.safe_load(_STATION))
        for path, value in (changes or {}).items():
            *parents, last = path.split("/")
            at = data
            for part in parents:
                at = at.setdefault(part, {})
            if value is None:
                del at[last]
            else:
                at[last] = value
        file = tmp_path / name
        file.write_text(yaml.safe_dump(data, sort_keys=False), encoding="utf-8")
        return file

    return write


def refused(name: str) -> ConnectionFailed:
    return ConnectionFailed(name, "connect", "nobody answers", "is it switched on?")


@pytest.fixture(name="nobody_answers")
def connection_failed() -> Callable[[str], ConnectionFailed]:
    return refused
