"""The emulated Thorlabs wheel sends the bytes that the unit is documented to send."""

from __future__ import annotations

import pytest

from sim_backend.wire.thorlabs_fw import ThorlabsFwFirmware
from sim_backend.world import OpticalBench


@pytest.fixture(name="firmware")
def firmware_of_six() -> ThorlabsFwFirmware:
    bench = OpticalBench(lux_per_level=0.05, pixel={"noise_rms": 0.03, "theta_off": 0.25}, sensor_seed=5)
    bench.set_level(1000.0)
    return ThorlabsFwFirmware(bench, filters=[(f"nd{n}0", float(n)) for n in range(6)], step_s=0.5)


def talk(firmware: ThorlabsFwFirmware, data: bytes) -> bytes:
    buffer, sent = bytearray(data), bytearray()
    for request in firmware.requests_in(buffer):
        firmware.obey(request, sent.extend)
    return bytes(sent)


@pytest.mark.parametrize(
    ("asked", "answered"),
    [
        (b"*idn?\r", b"*idn?\rTHORLABS FW102C/FW212C Filter Wheel version 1.04\r> "),
        (b"pos?\r", b"pos?\r1\r> "),
        (b"pcount?\r", b"pcount?\r6\r> "),
        (b"pos=3\r", b"pos=3\r> "),
        (b"sensors=0\rsensors?\r", b"sensors=0\r> sensors?\r0\r> "),
        (b"\r", b"\rCommand error CMD_NOT_DEFINED\n\r> "),
        (b"POS?\r", b"POS?\rCommand error CMD_NOT_DEFINED\n\r> "),
        (b"pos=7\r", b"pos=7\rCommand error CMD_ARG_INVALID\n\r> "),
        (b"pos=\r", b"pos=\rCommand error CMD_ARG_INVALID\n\r> "),
        (b"pos", b""),
    ],
)
def test_talks_as_documented(firmware: ThorlabsFwFirmware, asked: bytes, answered: bytes) -> None:
    assert talk(firmware, asked) == answered


def test_passes_the_positions_one_by_one_the_shorter_way(firmware: ThorlabsFwFirmware) -> None:
    bench = firmware._world
    bench.clock.sleep(1.0)
    begin_ns = bench.clock.now_ns
    talk(firmware, b"pos=5\r")
    history = bench.light(begin_ns)
    assert history.t_s.tolist() == [0.0, 0.5, 1.0]
    assert history.lux == pytest.approx([50.0, 50.0 * 1e-5, 50.0 * 1e-4])
    assert talk(firmware, b"pos?\r") == b"pos?\r5\r> "


def test_what_was_not_saved_is_lost_with_the_power(firmware: ThorlabsFwFirmware) -> None:
    sent = bytearray()
    talk(firmware, b"speed=0\rsave\rsensors=0\r")
    firmware.reboot(sent.extend)
    assert bytes(sent) == b"\0\0"
    assert talk(firmware, b"speed?\rsensors?\r") == b"speed?\r0\r> sensors?\r1\r> "


def test_a_button_turns_it(firmware: ThorlabsFwFirmware) -> None:
    firmware.press_button()
    assert talk(firmware, b"pos?\r") == b"pos?\r2\r> "
