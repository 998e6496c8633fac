"""The driver of the Thorlabs filter wheels, against documented bytes and the emulated unit."""

from __future__ import annotations

import contextlib
import time
from functools import partial
from itertools import permutations
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import ConnectionFailed, DeviceError, DeviceTimeout, UnexpectedAnswer, Unsupported, WrongState
from drivers.filters.thorlabs_fw import ThorlabsFilterWheel, parse_reply, stops_on_the_way
from drivers.transport.trace import Trace
from protocols.errors import InputError
from sim_backend.wire.faults import Fault, FaultPlan
from sim_backend.wire.serial_wire import SerialWire
from sim_backend.wire.thorlabs_fw import ThorlabsFwFirmware
from sim_backend.world import OpticalBench
from tests.drivers.patience import IMPATIENT_S, PATIENT_S, impatient

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

POSITIONS = [("clear", 0.0), ("nd05", 0.5), ("nd10", 1.0), ("nd20", 2.0), ("nd30", 3.0), ("nd40", 4.0)]
FILTERS: dict[str, dict[str, Any]] = {
    name: {"position": n, "nd_od": nd_od} for n, (name, nd_od) in enumerate(POSITIONS, 1)
}
CLEAR_LUX = 50.0
CONNECT = ["*idn?", "pcount?", "sensors=0", "sensors?", "pos?"]
SELECT = ["sensors=0", "sensors?", "pos?", "pos=3", "pos?"]


class Bench:
    """An emulated wheel in a world that is lit, and its driver."""

    def __init__(self, positions: list[tuple[str, float]] = POSITIONS, **arguments: Any) -> None:
        self.world = OpticalBench(lux_per_level=0.05, pixel={"noise_rms": 0.03, "theta_off": 0.25}, sensor_seed=5)
        self.world.set_level(1000.0)
        self.firmware = ThorlabsFwFirmware(self.world, filters=positions)
        self.wire = SerialWire(self.firmware, "wheel")
        wanted = {"filters": FILTERS, "clear": "clear", "timeout_s": PATIENT_S, "move_timeout_s": PATIENT_S}
        self.wheel = ThorlabsFilterWheel(self.wire.path, clock=self.world.clock, **{**wanted, **arguments})

    def brightest_while(self, move: Callable[[], None]) -> float:
        """Return the highest illuminance on the chip while the wheel moves, lux."""
        self.world.clock.sleep(1.0)
        begin_ns = self.world.clock.now_ns
        self.world.forget_before(begin_ns)
        move()
        return float(self.world.light(begin_ns).lux.max())

    def close(self) -> None:
        self.wheel.close()
        self.wire.close()


@pytest.fixture(name="bench")
def connected_bench() -> Iterator[Bench]:
    bench = Bench()
    bench.wheel.connect()
    yield bench
    bench.close()


def test_says_what_it_is(bench: Bench) -> None:
    assert bench.wheel.identity() == {
        "maker": "Thorlabs",
        "model": "FW102C/FW212C Filter Wheel, 6 positions",
        "serial": "not told by the unit",
        "firmware": "1.04",
    }


def test_sends_the_documented_bytes(bench: Bench, tmp_path: Path) -> None:
    trace = Trace(tmp_path / "trace.txt", bench.world.clock)
    bench.wheel.trace_to(trace)
    bench.wheel.select("nd10")
    bench.wheel.trace_to(None)
    trace.close()
    lines = (tmp_path / "trace.txt").read_text().splitlines()
    sent = [line.split("> ", 1)[1] for line in lines if " > b" in line]
    assert sent == [repr(command.encode() + b"\r") for command in SELECT]


def test_the_sensors_are_dark_after_connect_and_after_a_reboot(bench: Bench) -> None:
    assert bench.firmware.settings["sensors"] == 0
    bench.firmware.reboot(lambda _: None)
    assert bench.firmware.settings["sensors"] == 1
    bench.wheel.select(bench.wheel.selected())
    assert bench.firmware.settings["sensors"] == 0


def test_the_clear_position_is_never_in_the_beam_on_the_way(bench: Bench) -> None:
    for start, goal in permutations([name for name, _ in POSITIONS[1:]], 2):
        bench.wheel.select(start)
        brightest = bench.brightest_while(partial(bench.wheel.select, goal))
        assert bench.wheel.selected() == goal
        assert brightest < 0.5 * CLEAR_LUX, (start, goal)
    assert bench.brightest_while(lambda: bench.wheel.select("clear")) == CLEAR_LUX


def test_without_a_clear_position_the_unit_goes_its_own_way() -> None:
    bench = Bench(clear=None)
    bench.wheel.connect()
    bench.wheel.select("nd05")
    assert bench.brightest_while(lambda: bench.wheel.select("nd40")) == CLEAR_LUX
    bench.close()


@given(st.data())
def test_every_way_avoids_the_clear_position_whichever_way_half_a_turn_goes(data: st.DataObject) -> None:
    count = data.draw(st.integers(3, 16))
    position = st.integers(1, count)
    start, goal, clear = data.draw(position), data.draw(position), data.draw(position)
    stops = stops_on_the_way(start, goal, count, clear)
    at = start
    for stop in stops:
        upwards = (stop - at) % count
        if clear not in (start, goal):
            assert upwards * 2 != count
        step = 1 if upwards * 2 < count else -1
        while at != stop:
            at = (at - 1 + step) % count + 1
            assert at != clear or clear in (start, goal)
    assert at == goal
    assert clear in (start, goal) or clear not in stops


def test_way_on_six_positions() -> None:
    assert stops_on_the_way(2, 6, 6, 1) == [4, 6]
    assert stops_on_the_way(2, 5, 6, 1) == [4, 5]
    assert stops_on_the_way(6, 5, 6, 1) == [5]
    assert stops_on_the_way(1, 4, 6, 1) == [4]
    assert stops_on_the_way(2, 12, 12, 1) == [7, 12]


def test_buttons_are_noticed(bench: Bench) -> None:
    bench.wheel.select("nd10")
    bench.firmware.press_button()
    assert bench.wheel.selected() == "nd20"
    bench.wheel.select("nd10")
    assert bench.wheel.selected() == "nd10"


def test_a_position_without_a_filter_is_told() -> None:
    bench = Bench(filters={"clear": {"position": 1, "nd_od": 0.0}})
    bench.wheel.connect()
    bench.firmware.press_button()
    with pytest.raises(WrongState, match=r"position 2 has no filter here; were its buttons pressed\?"):
        bench.wheel.selected()
    bench.close()


def test_a_filter_beyond_the_last_position_is_refused() -> None:
    bench = Bench(filters={"nd30": {"position": 7, "nd_od": 3.0}}, clear=None)
    with pytest.raises(ConnectionFailed, match="use position 7 for filter nd30: it has 6 positions"):
        bench.wheel.connect()
    assert not bench.wheel.connected
    bench.wire.close()


def test_no_port_is_told() -> None:
    bench = Bench()
    bench.wire.close()
    with pytest.raises(ConnectionFailed, match=r"open .*plugged in"):
        bench.wheel.connect()


@pytest.mark.parametrize(
    ("command", "reply", "value"),
    [
        ("pos?", b"pos?\r3\r", "3"),
        ("pos?", b"\0\0pos?\r12\r", "12"),
        ("pos=3", b"pos=3\r", ""),
        ("*idn?", b"*idn?\rTHORLABS FW102C version 1.04\r", "THORLABS FW102C version 1.04"),
    ],
)
def test_documented_replies(command: str, reply: bytes, value: str) -> None:
    assert parse_reply("wheel", command, reply) == value


@pytest.mark.parametrize("code", ["CMD_NOT_DEFINED", "CMD_ARG_INVALID"])
def test_command_errors_are_told(code: str) -> None:
    with pytest.raises(Unsupported, match=f"wheel: send pcount[?]: Command error {code}"):
        parse_reply("wheel", "pcount?", b"pcount?\rCommand error " + code.encode() + b"\n\r")


@pytest.mark.parametrize(
    ("command", "reply"),
    [
        ("pos?", b"pos?\r"),
        ("pos?", b"pos=3\r"),
        ("pos?", b"3\r"),
        ("pos?", b""),
        ("pos=3", b"pos=3\r3\r"),
        ("pos?", b"pos?\r3\r4\r"),
        ("pos?", b"pos?\r\xb3\r"),
    ],
)
def test_other_replies_are_not_taken(command: str, reply: bytes) -> None:
    with pytest.raises(UnexpectedAnswer, match="wheel: send pos"):
        parse_reply("wheel", command, reply)


@given(st.binary(max_size=40))
def test_random_bytes_are_no_answer(reply: bytes) -> None:
    with pytest.raises(DeviceError):
        parse_reply("wheel", "pos?", reply.replace(b"pos?", b""))


def answer_of(bench: Bench, ask: Any, fault: Fault, at: int) -> DeviceError | None:
    """Ask with a fault at one request; return what was raised, which must not take longer than all time-outs."""
    bench.wire.faults.plan(FaultPlan(fault, at=at, seconds=0.08))
    begin_s, raised = time.monotonic(), None
    bench.wheel._move_timeout_s = IMPATIENT_S
    try:
        with impatient(bench.wheel._link):
            ask()
    except DeviceError as error:
        raised = error
    bench.wheel._move_timeout_s = PATIENT_S
    assert time.monotonic() - begin_s < 30.0
    assert str(raised or "filter wheel: ").startswith("filter wheel: ")
    return raised


def wait_for_the_cable(bench: Bench) -> None:
    deadline = time.monotonic() + 60.0
    while not Path(bench.wire.path).exists():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def in_the_end(ask: Callable[[], None]) -> None:
    """Ask until it succeeds: the fault may still be on the wire."""
    for _ in range(20):
        with contextlib.suppress(DeviceError):
            return ask()
    return ask()


FAULTS = [Fault.REPLY_LOST, Fault.REPLY_LATE, Fault.REPLY_CUT, Fault.GARBAGE, Fault.REBOOT, Fault.UNPLUGGED]


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_while_selecting_is_told_or_does_no_harm(fault: Fault) -> None:
    bench = Bench()
    bench.wheel.connect()
    for at in range(len(SELECT)):
        error = answer_of(bench, lambda: bench.wheel.select("nd10"), fault, at)
        assert error is not None or bench.firmware.position == 3
        wait_for_the_cable(bench)
        for name, position in (("nd10", 3), ("nd30", 5)):
            in_the_end(partial(bench.wheel.select, name))
            assert bench.firmware.position == position
            assert bench.firmware.settings["sensors"] == 0
    bench.close()


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_while_connecting_is_told_or_does_no_harm(fault: Fault) -> None:
    bench = Bench()
    for at in range(len(CONNECT)):
        error = answer_of(bench, bench.wheel.connect, fault, at)
        assert bench.wheel.connected == (error is None)
        wait_for_the_cable(bench)
        bench.wheel.close()
        in_the_end(bench.wheel.connect)
        assert bench.firmware.settings["sensors"] == 0
        bench.wheel.close()
    bench.close()


def test_a_question_is_asked_twice_and_then_it_is_told() -> None:
    bench = Bench(timeout_s=1.5)
    bench.wheel.connect()
    bench.wire.faults.plan(FaultPlan(Fault.REPLY_CUT, at=0))
    assert bench.wheel.selected() == "clear"
    bench.wire.faults.plan(FaultPlan(Fault.REPLY_LOST, at=0, times=2))
    with pytest.raises(DeviceTimeout, match=r"filter wheel: send pos\?: nothing within 1.5 s"):
        bench.wheel.selected()
    assert bench.wheel.selected() == "clear"
    bench.close()


@pytest.mark.parametrize(
    ("filters", "clear", "message"),
    [
        ({}, None, "one or more"),
        ({"a": {"position": 0, "nd_od": 0.0}}, None, "whole number from 1"),
        ({"a": {"position": 1.5, "nd_od": 0.0}}, None, "whole number from 1"),
        ({"a": {"position": 1, "nd_od": -1.0}}, None, "0 or more"),
        ({"a": {"position": 1}}, None, "expected position and nd_od"),
        ({"a": {"position": 1, "nd_od": 0.0}, "b": {"position": 1, "nd_od": 1.0}}, None, "another one"),
        ({"a": {"position": 1, "nd_od": 0.0}}, "b", "clear is 'b'; it has a"),
    ],
)
def test_filters_that_make_no_sense_are_refused(
    filters: dict[str, dict[str, float]], clear: str | None, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        Bench(filters=filters, clear=clear)
