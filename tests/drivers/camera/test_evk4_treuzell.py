"""Treuzell frames as published, byte by byte, and answers that are none."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.camera.evk4.treuzell import Property, frame, parse_answer, parse_register
from drivers.errors import ConnectionFailed, DeviceError, DeviceTimeout, UnexpectedAnswer
from drivers.interfaces import Recording
from drivers.transport.trace import Trace
from sim_backend.wire.faults import Fault, FaultPlan, Faults
from tests.drivers.camera.evk4_rigs import emulated

if TYPE_CHECKING:
    from pathlib import Path

READ = Property.DEVICE_REG32
#: Answer: register 0x14 of device 0 reads 0xA0401806.
ANSWER = bytes.fromhex("02010100 0c000000 00000000 14000000 061840a0")


def test_a_question_is_a_property_a_size_and_a_payload() -> None:
    assert frame(0x79, b"") == bytes.fromhex("79000000 00000000")
    payload = struct.pack("<III", 0, 0x14, 1)
    assert frame(READ, payload) == bytes.fromhex("02010100 0c000000 00000000 14000000 01000000")


def test_an_answer_is_taken_apart() -> None:
    payload = parse_answer("camera", "read", ANSWER, READ)
    assert parse_register("camera", "read", payload, 0x14, 1) == (0xA0401806,)


@pytest.mark.parametrize("size", range(len(ANSWER)))
def test_an_answer_that_was_cut_is_no_answer(size: int) -> None:
    with pytest.raises(UnexpectedAnswer, match=rf"camera: read: came {size} bytes"):
        parse_answer("camera", "read", ANSWER[:size], READ)


def test_an_answer_about_another_register_is_refused() -> None:
    payload = parse_answer("camera", "read", ANSWER, READ)
    with pytest.raises(UnexpectedAnswer):
        parse_register("camera", "read", payload, 0x18, 1)


def test_a_refusal_says_why() -> None:
    refusal = bytes.fromhex("02010180 0c000000 00000000 14000000 10000000")
    with pytest.raises(DeviceError, match="refused: error EBUSY"):
        parse_answer("camera", "read", refusal, READ)
    with pytest.raises(DeviceError, match="does not know this"):
        parse_answer("camera", "read", bytes.fromhex("00000080 00000000"), READ)


@given(st.binary(max_size=64), st.sampled_from([*Property, 0x40010102]))
def test_random_bytes_are_no_answer(data: bytes, prop: int) -> None:
    try:
        payload = parse_answer("camera", "ask", data, prop)
    except DeviceError:
        return
    assert data == frame(prop, payload)


@given(st.binary(max_size=32))
def test_random_payloads_are_no_registers(payload: bytes) -> None:
    try:
        values = parse_register("camera", "read", payload, 0x14, 1)
    except UnexpectedAnswer:
        return
    assert payload == struct.pack("<III", 0, 0x14, *values)


@given(st.binary(min_size=1, max_size=40))
def test_random_answers_on_the_wire_are_never_believed(garbage: bytes) -> None:
    _, camera, usb = CONNECTED
    plain = usb._firmware.obey
    usb._firmware.obey = lambda question: garbage  # type: ignore[method-assign]  # noqa: ARG005
    try:
        with pytest.raises(DeviceError):
            camera.temperature_c()
    finally:
        usb._firmware.obey = plain  # type: ignore[method-assign]
    assert camera.temperature_c() == pytest.approx(25.0, abs=0.1)


CONNECTED = emulated()
CONNECTED[1].connect()


@pytest.mark.parametrize(
    ("fault", "error"),
    [
        (Fault.REPLY_LOST, DeviceTimeout),
        (Fault.REPLY_LATE, DeviceTimeout),
        (Fault.REPLY_CUT, UnexpectedAnswer),
        (Fault.GARBAGE, UnexpectedAnswer),
        (Fault.UNPLUGGED, ConnectionFailed),
    ],
)
def test_a_fault_is_named_and_the_next_answer_is_the_right_one(fault: Fault, error: type[DeviceError]) -> None:
    bench, camera, usb = emulated()
    camera.connect()
    for at in range(4):
        bench.world.temperature_c = 20.0 + at
        usb.faults.plan(FaultPlan(fault, at, seconds=0.0 if fault is Fault.UNPLUGGED else 1.5))
        with pytest.raises(error, match=r"camera: (read|write)"):
            camera.temperature_c()
        if fault is Fault.UNPLUGGED:
            camera.close()
            camera.connect()
        assert camera.temperature_c() == pytest.approx(20.0 + at, abs=0.1)


def test_answers_that_come_late_several_times_are_all_thrown_away() -> None:
    bench, camera, usb = emulated()
    camera.connect()
    usb.faults.plan(FaultPlan(Fault.REPLY_LATE, 0, times=4, seconds=3.5))
    for _ in range(3):
        with pytest.raises(DeviceError):
            camera.biases()
    bench.world.temperature_c = 31.0
    while True:
        try:
            found = camera.temperature_c()
        except DeviceError:
            continue
        assert found == pytest.approx(31.0, abs=0.1)
        break


def test_what_was_asked_and_answered_is_in_the_trace(tmp_path: Path) -> None:
    _, camera, _ = emulated()
    trace = Trace(tmp_path / "trace.txt")
    camera.trace_to(trace)
    camera.connect()
    camera.start(Recording())
    camera.stop()
    camera.trace_to(None)
    camera.temperature_c()
    trace.close()
    lines = (tmp_path / "trace.txt").read_text(encoding="utf-8").splitlines()
    assert lines[1].split(" ", 2)[2] == "> b'r\\x00\\x00\\x00\\x00\\x00\\x00\\x00'"  # the serial number is asked for
    sent = [line for line in lines if " > " in line]
    received = [line for line in lines if " < " in line]
    assert len(sent) == len(received) > 700


def test_an_old_firmware_is_refused() -> None:
    _, camera, usb = emulated()
    usb.release = 0x030700
    usb.unplug(0.0)
    with pytest.raises(ConnectionFailed, match=r"release 3\.7\.0; update it to 3\.8\.0"):
        camera.connect()


def test_another_sensor_is_refused() -> None:
    _, camera, usb = emulated()
    usb._firmware.registers.live[0x0014] = lambda _: 0x12345678
    with pytest.raises(ConnectionFailed, match="chip 0x12345678"):
        camera.connect()


def test_a_camera_on_usb_2_is_told(caplog: pytest.LogCaptureFixture) -> None:
    _, camera, usb = emulated()
    usb.speed = 3
    camera.connect()
    assert "USB 2" in caplog.text


def test_the_serial_number_decides() -> None:
    _, camera, _ = emulated(serial="0000ABCD")
    with pytest.raises(ConnectionFailed, match="with serial number 0000ABCD: there is only 00001234"):
        camera.connect()
    _, camera, _ = emulated(serial="00001234")
    camera.connect()
    assert camera.identity()["serial"] == "00001234"


def test_no_camera_is_said() -> None:
    faults = Faults()
    _, camera, usb = emulated(faults)
    usb.unplug(3600.0)
    with pytest.raises(ConnectionFailed, match="04b4:00f5: no such device on USB"):
        camera.connect()
