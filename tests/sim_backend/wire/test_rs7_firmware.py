"""The emulated RS-7 answers byte for byte as the manual of the instrument says."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocols.errors import InputError
from sim_backend.wire.rs7 import Rs7Firmware
from sim_backend.world import OpticalBench


class Unit:
    """A firmware without a wire."""

    def __init__(self, **arguments: Any) -> None:
        self.world = OpticalBench(lux_per_level=0.05, pixel={}, sensor_seed=5)
        self.firmware = Rs7Firmware(self.world, **arguments)

    def say(self, sent: bytes) -> bytes:
        answer = bytearray()
        for request in self.firmware.requests_in(bytearray(sent)):
            self.firmware.obey(request, answer.extend)
        return bytes(answer)


@pytest.fixture(name="unit")
def unit_in_cd_m2() -> Unit:
    unit = Unit()
    assert unit.say(b"UNI 1\r") == b"\r\nOk\r\n"
    return unit


@pytest.mark.parametrize(
    ("sent", "answered"),
    [
        (b"USN\r", b"\r\nHX2855\r\n"),
        (b"VER\r", b"\r\n1.12\r\n"),
        (b"POT\r", b"\r\n0D 02:09:28.736\r\n"),
        (b"CTY\r", b"\r\nR\r\n"),
        (b"ATF\r", b"\r\nNONE\r\n"),
        (b"ATF *\r", b"\r\n\r\n"),
        (b"FBK\r", b"\r\n1\r\n"),
        (b"fbk0\r", b"\r\nOk\r\n"),
        (b"STP\r", b"\r\n0.25\r\n"),
        (b"SLM\r", b"\r\n90\r\n"),
        (b"PRE\r", b"\r\n0\r\n"),
        (b"PRE *\r", b"\r\n0,POWER ON\r\n\r\n"),
        (b"PRE 5\r", b"\r\n?17 - No such preset\r\n"),
        (b"IRR\r", b"\r\n0\r\n"),
        (b"ALA\r", b"\r\n\r\n"),
        (b"OCL\r", b"\r\n\r\n"),
        (b"WLR 380,920\r", b"\r\nOk\r\n"),
        (b"wlr380 920\r", b"\r\nOk\r\n"),
        (b"WLR 300,920\r", b"\r\n?02 - Argument out of range\r\n"),
        (b"WLR 400\r", b"\r\n?01 - Missing argument\r\n"),
        (b"XYZ\r", b"\r\n?03 - Unknown command\r\n"),
        (b"UNI 3\r", b"\r\n?02 - Argument out of range\r\n"),
        (b"OUT x\r", b"\r\n?02 - Argument out of range\r\n"),
        (b"OUT -1\r", b"\r\n?02 - Argument out of range\r\n"),
        (b"OUT 19.9\r", b"\r\n?20 - Level too low for optical feedback\r\n"),
        (b"OUT 15001\r", b"\r\n?24 - Level over-ranges optical feedback\r\n"),
        (b"SCP 65,1\r", b"\r\n?02 - Argument out of range\r\n"),
        (b"SCP 3,95\r", b"\r\n?10 - Soft power limit exceeded\r\n"),
        (b"\r", b"\r\n"),
    ],
)
def test_answers(unit: Unit, sent: bytes, answered: bytes) -> None:
    assert unit.say(sent) == answered
    assert unit.world.level == 1000.0


def test_levels(unit: Unit) -> None:
    assert unit.say(b"OUT\r") == b"\r\n1000\r\n"
    assert unit.say(b"out 2000.5\r") == b"\r\nOk\r\n"
    assert unit.world.level == 2000.5
    assert unit.say(b"OUTA\r") == b"\r\n2000.5\r\n"
    assert unit.say(b"PRE\r") == b"\r\nNONE\r\n"
    assert unit.say(b"OUT,0\r") == b"\r\nOk\r\n"
    assert unit.world.lux() == 0.0
    assert unit.say(b"OUTC 500\r") == b"\r\nOk\r\n"
    assert unit.world.level == 500.0


def test_a_level_takes_its_latency_and_settles() -> None:
    unit = Unit(latency_s=2e-3, settling_s=0.05, photodiode=True)
    unit.say(b"UNI 1\rOUT 2000\rOUT 2000\rOUT 500\r")
    edges = unit.world.triggers(1, 1 << 60)
    assert [(edge.time_ns, edge.rising) for edge in edges] == [(2_000_000, True), (106_000_000, False)]
    assert unit.world.clock.now_ns == 156_000_000


def test_the_acknowledgement_comes_before_anything_else() -> None:
    unit = Unit()
    seen: list[tuple[bytes, int]] = []
    for sent in (b"UNI 1", b"OUT 2000"):
        unit.firmware.obey(sent, lambda data: seen.append((data, unit.world.clock.now_ns)))
    assert seen == [(b"\r\n", 0), (b"Ok\r\n", 0), (b"\r\n", 0), (b"Ok\r\n", 52_000_000)]


def test_without_feedback_low_levels_are_allowed(unit: Unit) -> None:
    assert unit.say(b"FBK 0\rOUT 5\r") == b"\r\nOk\r\n" * 2
    assert unit.world.level == 5.0
    assert unit.say(b"OUT 20000\r") == b"\r\n?10 - Soft power limit exceeded\r\n"


def test_scp_0_0_wipes_the_spectrum_and_out_0_does_not(unit: Unit) -> None:
    assert unit.say(b"OUT 0\rOUT 100\r") == b"\r\nOk\r\n" * 2
    assert unit.say(b"SCP 0,0\r") == b"\r\nOk\r\n"
    assert unit.world.level == 0.0
    assert unit.say(b"SCP\r") == b"\r\n\r\n"
    assert unit.say(b"OUT 100\r") == b"\r\n?16 - Output spectrum is zero\r\n"
    assert unit.say(b"PRE 0\rOUT 100\r") == b"\r\nOk\r\n" * 2
    assert unit.world.level == 100.0


def test_channels(unit: Unit) -> None:
    assert unit.say(b"SCP 0 0 7 32\rSCP\rSCP 7\rSCP 8\r") == b"\r\nOk\r\n\r\n7,32\r\n\r\n\r\n32\r\n\r\n0\r\n"
    assert unit.world.level == pytest.approx(15000.0 * 0.32 / 64)


def test_units() -> None:
    unit = Unit()
    assert unit.say(b"UNI 0\rOUT\r") == b"\r\nOk\r\n\r\n400\r\n"  # 1000 cd/m2 at 250 lm/W, in uW/cm2/sr
    assert unit.say(b"UNI 2\rOUT 10\r") == b"\r\nOk\r\n" * 2
    assert unit.world.level == pytest.approx(1500.0)


def test_ctrl_a_repeats_the_last_command(unit: Unit) -> None:
    unit.say(b"PRE N\r")
    assert unit.say(b"VER\r\x01\x01") == b"\r\n1.12\r\n" * 3


def test_a_line_feed_after_the_cr_is_tolerated_and_commands_may_come_in_pieces(unit: Unit) -> None:
    assert unit.say(b"VER\r\nUSN\r\n") == b"\r\n1.12\r\n\r\nHX2855\r\n"
    buffer = bytearray(b"VE")
    assert unit.firmware.requests_in(buffer) == []
    buffer += b"R\rUS"
    assert unit.firmware.requests_in(buffer) == [b"VER"]
    assert buffer == b"US"


def test_too_long_a_command_is_an_overflow(unit: Unit) -> None:
    assert unit.say(b"TSP " + b"1," * 5000) == b"\r\n?04 - Input buffer overflow\r\n"
    assert unit.say(b"TSP " + b"1," * 5000 + b"\r") == b"\r\n?04 - Input buffer overflow\r\n"


def test_spectrum_in_columns_and_in_a_row(unit: Unit) -> None:
    rows = unit.say(b"WLR 360,1100\rSTM 1\rOSP\r").removeprefix(b"\r\nOk\r\n" * 2).split(b"\r\n")
    assert rows[0] == b""
    assert rows[-2:] == [b"", b""]
    assert len(rows[1:-2]) == 741
    assert sum(map(float, rows[1:-2])) == pytest.approx(400.0, rel=1e-3)  # uW/cm2/sr
    assert len(unit.say(b"WLR 500,509\rSTM 0\rOSP\r").split(b",")) == 10


def test_attenuator() -> None:
    unit = Unit(attenuator="OD3")
    assert unit.say(b"ATF\r") == b"\r\n1,OD3\r\n"
    assert unit.say(b"ATF *\r") == b"\r\n1,OD3\r\n\r\n"
    assert unit.say(b"ATF 0\rATF\r") == b"\r\nOk\r\n\r\nNONE\r\n"


def test_alarms_are_sent_unasked_unless_that_is_off(unit: Unit) -> None:
    assert unit.firmware.alarm() == b"?A5 - LED temperature off by more than 1 C\r\n"
    assert unit.say(b"VER\r") == b"?A5 - LED temperature off by more than 1 C\r\n\r\n1.12\r\n"
    unit.say(b"ASA 0\r")
    assert unit.say(b"VER\r") == b"\r\n1.12\r\n"
    assert unit.say(b"ALA\r") == b"\r\n?A5 - LED temperature off by more than 1 C\r\n\r\n"
    assert unit.say(b"ALAC\rALA\r") == b"\r\nOk\r\n\r\n\r\n"


def test_in_a_fault_nothing_else_is_obeyed_until_it_is_cleared(unit: Unit) -> None:
    unit.firmware.in_fault = True
    assert unit.say(b"OUT 2000\r") == b"\r\n?F1 - Fault\r\n"
    assert unit.say(b"XYZ\r") == b"\r\n?F1 - Fault\r\n"
    assert unit.say(b"ICK\rCFC\rOUT 2000\r") == b"\r\nOk\r\n" * 3
    assert unit.world.level == 2000.0


def test_after_a_power_failure_it_is_lit_with_preset_0_and_has_forgotten_its_settings(unit: Unit) -> None:
    unit.say(b"OUT 0\rFBK 0\r")
    said = bytearray()
    unit.firmware.reboot(said.extend)
    assert said.startswith(b"SpectralLED RS-7")
    assert unit.world.level == 1000.0
    assert unit.say(b"POT\rUNI\rFBK\r") == b"\r\n0D 00:00:00.000\r\n\r\n0\r\n\r\n1\r\n"


def test_rst_restarts_it_with_a_banner(unit: Unit) -> None:
    unit.say(b"OUT 0\r")
    assert unit.say(b"RST\r") == b"\r\nSpectralLED RS-7-1\r\nFirmware Version 1.12\r\nOk\r\n"
    assert unit.world.level == 1000.0


def test_a_dark_preset_0() -> None:
    unit = Unit(presets={"dark": 0.0, "day": 3000.0})
    assert unit.world.level == 0.0
    assert unit.say(b"UNI 1\rPRE *\r") == b"\r\nOk\r\n\r\n0,dark\r\n1,day\r\n\r\n"
    assert unit.say(b"PRE N\r") == b"\r\nOk\r\n"
    assert unit.world.level == 3000.0


def test_errors_that_are_put_in(unit: Unit) -> None:
    unit.firmware.next_errors = ["18", "20"]
    assert unit.say(b"OUT 2000\r") == b"\r\n?18 - Output failed to settle within 0.5 s\r\n"
    assert unit.world.level == 2000.0
    assert unit.say(b"OUT 3000\r") == b"\r\n?20 - Level too low for optical feedback\r\n"
    assert unit.world.level == 2000.0


@given(st.binary(max_size=40))
def test_every_command_is_acknowledged_whatever_it_is(sent: bytes) -> None:
    unit = Unit()
    requests = unit.firmware.requests_in(bytearray(sent + b"\r"))
    for request in requests:
        pieces: list[bytes] = []
        unit.firmware.obey(request, pieces.append)
        assert pieces[0] == b"\r\n"


@pytest.mark.parametrize("wrong", [{"latency_s": -1.0}, {"settling_s": float("nan")}, {"alarm_code": "A42"}])
def test_wrong_arguments(wrong: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=next(iter(wrong))):
        Unit(**wrong)
