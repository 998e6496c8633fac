"""The driver of the RS-7, on an emulated unit."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from drivers.errors import ConnectionFailed, DeviceError, DeviceTimeout, UnexpectedAnswer, WrongState
from drivers.interfaces import Waveform
from drivers.light.rs7 import SpectralLed
from drivers.transport.trace import Trace
from protocols.errors import InputError
from sim_backend.wire.faults import Fault, FaultPlan
from sim_backend.wire.rs7 import Rs7Firmware
from sim_backend.wire.serial_wire import SerialWire
from sim_backend.world import OpticalBench

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


class Bench:
    """A unit, its world, and what the driver says to it."""

    def __init__(self, **arguments: Any) -> None:
        self.world = OpticalBench(lux_per_level=0.05, pixel={}, sensor_seed=5)
        self.firmware = Rs7Firmware(self.world, **arguments)
        self.wire = SerialWire(self.firmware, "rs7")

    def light(self, **arguments: Any) -> SpectralLed:
        given = {"clock": self.world.clock, "player": "inline", "timeout_s": 20.0, **arguments}
        return SpectralLed(self.wire.path, **given)


@contextmanager
def unit(**arguments: Any) -> Iterator[Bench]:
    bench = Bench(**arguments)
    try:
        yield bench
    finally:
        bench.wire.close()


def said(trace: Path) -> list[str]:
    """Return the commands that a trace has."""
    lines = [line.split(" ", 3) for line in trace.read_text().splitlines()[1:]]
    return [line[3][2:-3] for line in lines if line[2] == ">"]


def test_connect_asks_who_it_is_sets_it_up_and_makes_it_dark(tmp_path: Path) -> None:
    with unit() as bench:
        light = bench.light(settle_percent=1.0)
        trace = Trace(tmp_path / "trace.txt")
        light.trace_to(trace)
        assert bench.world.level == 1000.0
        light.connect()
        assert bench.world.level == 0.0
        assert light.level() == 0.0
        assert light.identity() == {
            "maker": "Gamma Scientific",
            "model": "SpectralLED RS-7",
            "serial": "HX2855",
            "firmware": "1.12",
            "calibration": "2018-05-04,9D3C11F0",
            "calibration data": "9D3C11F0",
            "attenuator": "none",
        }
        trace.close()
        light.close()
    commands = said(tmp_path / "trace.txt")
    assert commands[:2] == ["ASA 0", "OUT 0"]
    assert {"UNI 1", "IRR 0", "FBK 1", "STP 1", "POT"} <= set(commands)
    assert not any(command.startswith("SCP") for command in commands)


def test_level_is_what_the_photodiode_measures() -> None:
    with unit() as bench:
        light = bench.light()
        light.connect()
        light.set_level(123.456)
        assert bench.world.level == pytest.approx(123.456)
        assert light.level() == pytest.approx(123.456)
        light.close()
        assert bench.world.level == 0.0


def test_light_that_is_off_and_measures_light_is_told() -> None:
    with unit() as bench:
        light = bench.light()
        light.connect()
        light._require_dark(1.9)
        with pytest.raises(DeviceError, match=r"off, and its photodiode measures 2\.1 cd/m2; does light of the room"):
            light._require_dark(2.1)
        light.close()


def test_spectrum_is_that_of_the_light() -> None:
    with unit() as bench:
        light = bench.light()
        light.connect()
        light.set_level(1000.0)
        spectrum = light.spectrum()
        assert spectrum.unit == "uW/cm2/nm/sr"
        assert np.sum(spectrum.density) == pytest.approx(400.0, rel=1e-3)
        assert spectrum.wavelength_nm[np.argmax(spectrum.density)] == 550.0
        light.close()


@pytest.mark.parametrize(("spectrum", "number"), [("day", "1"), (" DAY ", "1"), (1, "1"), ("dark", "0")])
def test_a_spectrum_is_loaded_and_the_light_is_dark_all_the_same(
    spectrum: str | int, number: str, tmp_path: Path
) -> None:
    with unit(presets={"dark": 0.0, "day": 3000.0}) as bench:
        light = bench.light(spectrum=spectrum)
        trace = Trace(tmp_path / "trace.txt")
        light.trace_to(trace)
        light.connect()
        assert bench.world.level == 0.0
        light.close()
        trace.close()
        assert f"PRE {number}" in said(tmp_path / "trace.txt")


@pytest.mark.parametrize(
    ("spectrum", "why"), [("night", "'night': no such preset; it has dark, day"), (7, r"\?17 - No such preset")]
)
def test_an_unknown_spectrum_is_refused(spectrum: str | int, why: str) -> None:
    with unit(presets={"dark": 0.0, "day": 3000.0}) as bench:
        light = bench.light(spectrum=spectrum)
        with pytest.raises(WrongState, match=why):
            light.connect()
        assert not light.connected
        assert bench.world.level == 0.0


def test_an_attenuator_is_refused_or_recorded() -> None:
    with unit(attenuator="OD3") as bench:
        with pytest.raises(WrongState, match=r"1,OD3 is active, and the levels include it; switch it off \(ATF 0\)"):
            bench.light().connect()
        assert bench.world.level == 0.0
        light = bench.light(attenuator="recorded")
        light.connect()
        assert light.identity()["attenuator"] == "1,OD3"
        light.close()


@pytest.mark.parametrize(
    ("calibration", "arguments", "spectral", "refused"),
    [
        ("R", {"unit": "lux", "working_distance_mm": 200.0}, "uW/cm2/nm", ""),
        ("R", {"unit": "lux"}, "", "no working distance is known; give working_distance_mm"),
        ("I", {"unit": "lux"}, "uW/cm2/nm", ""),
        ("I", {"unit": "cd/m2"}, "", "it is calibrated for irradiance; use lux"),
        ("R", {"unit": "%", "lowest": 1.0, "highest": 100.0}, "uW/cm2/nm/sr", ""),
        ("R", {"unit": "uW/cm2/sr", "lowest": 10.0, "highest": 1000.0}, "uW/cm2/nm/sr", ""),
    ],
)
def test_units(calibration: str, arguments: dict[str, Any], spectral: str, refused: str) -> None:
    with unit(calibration=calibration) as bench:
        light = bench.light(**arguments)
        if refused:
            with pytest.raises(WrongState, match=refused):
                light.connect()
            return
        light.connect()
        light.set_level(50.0)
        assert light.level() == pytest.approx(50.0)
        assert light.spectrum().unit == spectral
        light.close()


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        ({"unit": "nits"}, "unit is 'nits'; expected cd/m2, lux"),
        ({"player": "thread"}, "player is 'thread'"),
        ({"lowest": 0.0}, "limits are 0.0 to 15000.0 cd/m2"),
        ({"timeout_s": 0.0}, "timeout_s is 0.0"),
        ({"attenuator": "ignore"}, "attenuator is 'ignore'"),
        ({"working_distance_mm": 100.0}, "which does not depend on it"),
        ({"unit": "lux", "working_distance_mm": -1.0}, "working_distance_mm is -1.0"),
        ({"settle_percent": 0.0}, "settle_percent is 0.0"),
        ({"spectrum": -1}, "spectrum is -1"),
    ],
)
def test_wrong_arguments(arguments: dict[str, Any], why: str) -> None:
    with pytest.raises(InputError, match=why):
        SpectralLed("/dev/null", **{"clock": None, **arguments})


def test_nothing_there() -> None:
    with unit() as bench:
        path = bench.wire.path
        clock = bench.world.clock
    with pytest.raises(ConnectionFailed, match=f"^light source: open {path}: .*is it plugged in"):
        SpectralLed(path, clock=clock).connect()


def test_a_refused_level_changes_nothing() -> None:
    with unit(full_cd_m2=5000.0) as bench:
        light = bench.light()
        light.connect()
        light.set_level(100.0)
        with pytest.raises(
            WrongState, match=r"^light source: OUT 6000: \?24 - .*; choose a lower level, or no feedback"
        ):
            light.set_level(6000.0)
        assert bench.world.level == 100.0
        assert light.level() == 100.0
        light.close()


def test_a_level_whose_answer_was_lost_is_read_back() -> None:
    with unit() as bench:
        light = bench.light()
        light.connect()
        light._talk.link.timeout_s = 0.5
        bench.wire.faults.plan(FaultPlan(Fault.REPLY_LOST, 2))  # POT, ALA, OUT
        light.set_level(100.0)
        light._talk.link.timeout_s = 20.0
        assert light.level() == 100.0
        light.close()


def test_a_level_that_is_not_there_after_its_answer_was_lost_makes_it_dark_and_raises() -> None:
    with unit() as bench:
        light = bench.light()
        light.connect()
        light.set_level(100.0)
        light._talk.link.timeout_s = 0.5
        bench.firmware.next_errors = ["10"]
        bench.wire.faults.plan(FaultPlan(Fault.REPLY_LOST, 2))
        with pytest.raises(DeviceTimeout, match="OUT 200"):
            light.set_level(200.0)
        assert bench.world.level == 0.0
        light._talk.link.timeout_s = 20.0
        light.close()


def lose_power(bench: Bench) -> None:
    bench.firmware.reboot(bytearray().extend)


def test_a_power_failure_is_noticed_makes_it_dark_and_lasts_until_connect() -> None:
    with unit() as bench:
        light = bench.light()
        light.connect()
        light.set_level(100.0)
        lose_power(bench)
        assert bench.world.level == 1000.0
        for _ in range(2):
            with pytest.raises(
                DeviceError, match=r"set level to 100 cd/m2: the power failed: .* connect to it again"
            ):
                light.set_level(100.0)
            assert bench.world.level == 0.0
        light.close()
        light.connect()
        light.set_level(100.0)
        light.close()


def test_a_power_failure_is_noticed_even_if_the_unit_has_been_on_for_longer_since_than_before() -> None:
    with unit(on_for_s=10.0) as bench:
        light = bench.light()
        light.connect()
        bench.world.clock.sleep(100.0)
        lose_power(bench)
        bench.world.clock.sleep(50.0)
        with pytest.raises(DeviceError, match="the power failed: it has been on for 50 s only"):
            light.play(Waveform(np.zeros(1), np.array([100.0]), 0.1))
        light.close()


def test_a_power_failure_during_a_waveform_is_noticed_at_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    with unit() as bench:
        light = bench.light()
        light.connect()

        def fail_and_come_back(*_: object) -> bytes:
            lose_power(bench)
            return b"Ok\r\n"

        monkeypatch.setattr(bench.firmware, "_go_to", fail_and_come_back)
        waveform = Waveform(np.array([0.0]), np.array([100.0]), 0.1)
        with pytest.raises(DeviceError, match="play a waveform: the power failed"):
            light.play(waveform)
        monkeypatch.undo()
        light.close()
        assert bench.world.level == 0.0


@pytest.mark.parametrize("code", ["A3", "A6", "A7"])
def test_an_alarm_that_the_light_is_wrong_stops_the_run_dark(code: str) -> None:
    with unit(alarm_code=code) as bench:
        light = bench.light()
        light.connect()
        light.set_level(100.0)
        bench.firmware.alarm()
        with pytest.raises(DeviceError, match=rf"set level to 200 cd/m2: \?{code} - .*; stop the run"):
            light.set_level(200.0)
        assert bench.world.level == 0.0
        assert [alarm.code for alarm in light.alarms] == [code]
        light.close()


def test_other_alarms_are_written_down() -> None:
    with unit(alarm_code="A5") as bench:
        light = bench.light()
        light.connect()
        bench.firmware.alarm()
        light.set_level(100.0)
        light.set_level(200.0)
        assert [alarm.code for alarm in light.alarms] == ["A5"]
        light.close()


def test_a_fault_of_the_unit_stops_the_run_and_is_not_dark() -> None:
    with unit() as bench:
        light = bench.light()
        light.connect()
        light.set_level(100.0)
        bench.firmware.in_fault = True
        with pytest.raises(DeviceError, match=r"\?F1 - Fault; stop the run"):
            light.set_level(200.0)
        light.safe_state()
        assert "could not be made dark" in str(light.unsafe)
        bench.firmware.in_fault = False
        light.close()
        assert bench.world.level == 0.0


def test_a_unit_without_a_spectrum_is_dark_but_cannot_be_lit() -> None:
    with unit(presets={}) as bench:
        light = bench.light()
        light.connect()
        assert light.level() == 0.0
        with pytest.raises(WrongState, match=r"OUT 100: \?16 - .*; load a preset: give the driver a spectrum"):
            light.set_level(100.0)
        light.close()


def test_a_setting_that_is_not_taken_is_told() -> None:
    with unit() as bench:
        bench.firmware._commands["UNI"] = lambda arguments: b"Ok\r\n" if arguments else b"0\r\n"
        with pytest.raises(UnexpectedAnswer, match="UNI 1: it reads back as 0"):
            bench.light().connect()
