"""The driver of the LED driver, against the emulated device."""

from __future__ import annotations

import ast
import contextlib
import logging
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from drivers.errors import ConnectionFailed, DataLost, DeviceError, DeviceTimeout, OutOfRange, Unsupported, WrongState
from drivers.light.led_driver import LedDriver
from drivers.light.led_protocol import encode_line
from drivers.transport.trace import Trace
from protocols.errors import InputError
from sim_backend.devices.light import SimulatedLightSource
from sim_backend.wire.faults import Fault, FaultPlan
from sim_backend.wire.led_driver import LedFirmware
from sim_backend.wire.serial_wire import SerialWire
from sim_backend.world import OpticalBench
from tests.drivers.light.led_waveforms import waveform
from tests.drivers.patience import PATIENT_S, impatient

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from drivers.interfaces import Waveform


class Bench:
    """An emulated device in a world, and its driver."""

    def __init__(self, *, firmware: dict[str, Any] | None = None, **arguments: Any) -> None:
        self.world = new_world()
        self.firmware = LedFirmware(self.world, **(firmware or {}))
        self.wire = SerialWire(self.firmware, "led")
        wanted = {"lowest": 20, "edge_time_s": 2e-5, "settling_s": 1e-3, "timeout_s": PATIENT_S}
        self.light = LedDriver(self.wire.path, clock=self.world.clock, **{**wanted, **arguments})

    def close(self) -> None:
        self.light.close()
        self.wire.close()

    def wait_for_the_cable(self) -> None:
        deadline = time.monotonic() + 60.0
        while not Path(self.wire.path).exists():
            assert time.monotonic() < deadline
            time.sleep(0.01)


def new_world() -> OpticalBench:
    return OpticalBench(lux_per_level=0.05, pixel={"noise_rms": 0.03, "theta_off": 0.25}, sensor_seed=5)


@pytest.fixture(name="bench")
def connected_bench() -> Iterator[Bench]:
    bench = Bench()
    bench.light.connect()
    yield bench
    bench.close()


def square(cycles: int = 3, half_us: int = 100) -> Waveform:
    times = [n * half_us for n in range(2 * cycles + 1)]
    return waveform(times, [20, *([60, 20] * cycles)], times[-1] + half_us)


def reset_test(cycles: int) -> Waveform:
    times = [0, *(n * 150_000 + at for n in range(cycles) for at in (50_000, 70_000, 120_000, 150_000))]
    return waveform(times, [100, *([400, 100, 73, 100] * cycles)], times[-1] + 50_000)


def test_says_what_it_is(bench: Bench) -> None:
    assert bench.light.identity() == {
        "maker": "EVS bench",
        "model": "LED driver, protocol 1, 16 bit",
        "serial": "emulated",
        "firmware": "1.0",
    }


def test_sends_the_documented_bytes(bench: Bench, tmp_path: Path) -> None:
    bench.light._number = 6
    trace = Trace(tmp_path / "trace.txt", bench.world.clock)
    bench.light.trace_to(trace)
    bench.light.set_level(1000.4)
    bench.light.play(square(cycles=3))
    bench.light.safe_state()
    bench.light.trace_to(None)
    trace.close()
    text = (tmp_path / "trace.txt").read_text()
    sent = [line.split(" > ")[1] for line in text.splitlines() if " > b" in line]
    assert sent == [
        repr(b"7 level 1000*56B3\n"),
        repr(b"8 square 20 60 200 100 3 100*1F0F\n"),
        repr(b"9 play 6 700*2802\n"),
        repr(b"10 dark*BB94\n"),
    ]
    received = b"".join(ast.literal_eval(line.split(" < ")[1]) for line in text.splitlines() if " < b" in line)
    assert received == b"7 ok 1000*2770\n8 ok 4*B2FD\n9 ok*1B41\n9 done 6 0*E0B8\n10 ok 0*E109\n"


@pytest.mark.parametrize(
    "played",
    [
        square(cycles=5),
        reset_test(40),
        waveform([0, 35, 90, 1000], [300, 20, 20, 0], 1500),
        waveform([0], [300], 1500),
        waveform([0, 500, 1000], [0, 40, 65535], 1000),
    ],
)
def test_the_light_is_that_of_the_simulated_source_edge_for_edge(played: Waveform) -> None:
    bench, world = Bench(), new_world()
    simulated = SimulatedLightSource(world, lowest=20.0, highest=65535.0, unit="count", level_step=1.0)
    found = []
    for light, its in ((bench.light, bench.world), (simulated, world)):
        light.connect()
        light.set_level(50.0)
        its.clock.sleep(0.25)
        begin_ns = its.clock.now_ns
        result = light.play(played)
        its.clock.sleep(0.25)
        history = its.light(begin_ns)
        found.append((history.t_s, history.lux, its.triggers(0, its.clock.now_ns), its.clock.now_ns, result.t_s))
    (t_s, lux, triggers, now_ns, played_s), (t_s2, lux2, triggers2, now_ns2, played_s2) = found
    np.testing.assert_array_equal(t_s, t_s2)
    np.testing.assert_array_equal(lux, lux2)
    assert triggers == triggers2
    assert len(triggers) == len(played.t_s) - 1
    assert now_ns == now_ns2
    np.testing.assert_allclose(played_s, played_s2, rtol=1e-15)
    bench.close()


def test_times_are_returned_as_played(bench: Bench) -> None:
    times = bench.light.play(waveform([0, 100.4, 250.6], [20, 60, 20], 400)).t_s
    assert times.tolist() == [0.0, 1e-4, 2.51e-4]


def test_thousands_of_cycles_and_a_long_list_are_played(bench: Bench) -> None:
    assert len(bench.light.play(reset_test(3000)).t_s) == 12001
    rng = np.random.default_rng(2)
    t_us = np.cumsum(rng.integers(20, 3000, 4000))
    irregular = waveform([0, *t_us.tolist()], [20, *([60, 20] * 2000)], int(t_us[-1]))
    np.testing.assert_allclose(bench.light.play(irregular).t_s, irregular.t_s, atol=1e-12)


def test_what_does_not_fit_is_known_before_it_is_connected() -> None:
    rng = np.random.default_rng(2)
    t_us = np.cumsum(rng.integers(20, 3000, 5000))
    irregular = waveform([0, *t_us.tolist()], [20, *([60, 20] * 2500)], int(t_us[-1]))
    bench = Bench(firmware={"max_edges": 64})
    assert "room for 4096" in bench.light.why_not(irregular)
    assert bench.light.why_not(square()) == ""
    bench.light.connect()
    assert "room for 64" in bench.light.why_not(irregular)
    with pytest.raises(
        Unsupported, match=r"light source: play a waveform: its 5000 edges do not repeat .* room for 64"
    ):
        bench.light.play(irregular)
    with pytest.raises(Unsupported, match="two edges are 10 us apart at 0 s; 20 us is the least"):
        bench.light.play(square(half_us=10))
    bench.close()


def test_a_dac_with_fewer_bits_is_noticed() -> None:
    bench = Bench(firmware={"dac_bits": 12})
    with pytest.raises(
        ConnectionFailed, match="use levels up to 65535: its DAC has 12 bits; highest is 4095 at most"
    ):
        bench.light.connect()
    bench.close()
    bench = Bench(firmware={"dac_bits": 12}, highest=4095)
    bench.light.connect()
    bench.light.set_level(4095.0)
    with pytest.raises(OutOfRange):
        bench.light.set_level(4096.0)
    bench.close()


def test_another_protocol_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench()
    answer = "ok evs-led protocol=2 firmware=2.0 serial=1 tick_us=1 dac_bits=16 max_edges=8 shortest_us=20"
    monkeypatch.setattr(bench.firmware, "_obeyed", lambda *_: answer)
    with pytest.raises(ConnectionFailed, match=r"say hello: protocol 2; expected 1; load the sketch"):
        bench.light.connect()
    bench.close()


def test_what_the_device_refuses_is_told(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench.firmware, "_dac_bits", 8)
    with pytest.raises(Unsupported, match="light source: set level to 300 count: 4 out of range"):
        bench.light.set_level(300.0)


def answer_to_play(bench: Bench, monkeypatch: pytest.MonkeyPatch, answer: str) -> None:
    def play(number: str, edges: int, duration_us: int, *, send: Callable[[bytes], None]) -> None:
        send(encode_line(f"{number} {answer}"))

    monkeypatch.setattr(bench.firmware, "_play", play)


def test_a_waveform_that_was_cut_short_is_told(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    answer_to_play(bench, monkeypatch, "done 2 0")
    with pytest.raises(DataLost, match=r"play 6 edges in 0.0007 s: it stopped after 2"):
        bench.light.play(square())


def test_an_edge_that_came_late_is_logged(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    answer_to_play(bench, monkeypatch, "done 6 250")
    with caplog.at_level(logging.WARNING):
        bench.light.play(square())
    assert "light source: play 6 edges in 0.0007 s: an edge came 250 us late" in caplog.text


def test_a_restart_in_between_is_told_once(bench: Bench) -> None:
    bench.light.set_level(1000.0)
    bench.firmware.reboot(bench.wire._send)
    with pytest.raises(ConnectionFailed, match="light source: read the level: it has just started anew, and is dark"):
        bench.light.level()
    assert bench.light.level() == 0.0


def test_the_watchdog_is_set_and_what_it_did_is_told() -> None:
    bench = Bench(watchdog_s=2.0)
    bench.light.connect()
    bench.light.set_level(1000.0)
    bench.world.clock.sleep(1.0)
    assert bench.light.level() == 1000.0
    bench.world.clock.sleep(2.5)
    with pytest.raises(WrongState, match="its watchdog has made it dark; choose a longer watchdog_s"):
        bench.light.level()
    assert bench.light.level() == 0.0
    bench.firmware.reboot(bench.wire._send)
    bench.light.safe_state()
    bench.light.set_level(1000.0)
    assert bench.firmware._watchdog_ms == 2000
    bench.close()


class BootsWhenOpened(LedFirmware):
    """A board that is reset by opening the port: the first requests are lost, then it says that it has started."""

    lost = 2

    def obey(self, request: bytes, send: Callable[[bytes], None]) -> None:
        self.lost -= 1
        if self.lost == 0:
            self.reboot(send)
        elif self.lost < 0:
            super().obey(request, send)


def test_a_board_that_boots_when_the_port_is_opened_is_waited_for() -> None:
    bench = Bench(timeout_s=1.5)
    bench.wire.firmware = BootsWhenOpened(bench.world)
    bench.light.connect()
    bench.light.set_level(100.0)
    assert bench.world.lux() == 5.0
    bench.close()


def test_a_port_where_nobody_answers_is_told() -> None:
    bench = Bench(timeout_s=0.05)
    bench.wire.faults.plan(FaultPlan(Fault.REPLY_LOST, at=0, times=100))
    with pytest.raises(DeviceTimeout, match=r"light source: say hello: nothing within 0.05 s"):
        bench.light.connect()
    bench.close()
    with pytest.raises(ConnectionFailed, match=r"light source: open .*plugged in"):
        bench.light.connect()


FAULTS = [
    Fault.REPLY_LOST,
    Fault.REPLY_LATE,
    Fault.REPLY_CUT,
    Fault.GARBAGE,
    Fault.ALARM,
    Fault.REBOOT,
    Fault.UNPLUGGED,
]
IRREGULAR = waveform([0, *np.cumsum(np.arange(30, 50)).tolist()], [20, *([60, 20] * 10)], 1000)

#: What is asked, how many requests it is, and what the light is at when it has succeeded.
ASKED: dict[str, tuple[Callable[[LedDriver], object], int, float]] = {
    "connect": (lambda light: light.connect(), 3, 0.0),
    "set_level": (lambda light: light.set_level(1000.0), 1, 50.0),
    "play": (lambda light: light.play(IRREGULAR), 4, 1.0),
    "safe_state": (lambda light: light.safe_state(), 1, 0.0),
}


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("asked", ASKED)
def test_a_fault_is_told_or_does_no_harm_and_the_light_can_be_made_dark(asked: str, fault: Fault) -> None:
    ask, requests, lux = ASKED[asked]
    bench = Bench()
    for at in range(requests):
        if asked == "connect":
            bench.light.close()
        elif not bench.light.connected:
            in_the_end(bench.light.connect)
        before = bench.wire.faults.requests
        bench.wire.faults.plan(FaultPlan(fault, at=at, seconds=0.08))
        begin_s, error = time.monotonic(), None
        try:
            with impatient(bench.light._link):
                ask(bench.light)
        except DeviceError as raised:
            error = raised
        assert time.monotonic() - begin_s < 30.0
        assert str(error or "light source: ").startswith("light source: ")
        assert error is not None or fault is Fault.ALARM or bench.world.lux() == lux or bench.light.unsafe
        assert bench.wire.faults.requests > before + at
        bench.wait_for_the_cable()
        if not bench.light.connected:
            in_the_end(bench.light.connect)
        in_the_end(lambda: be_dark(bench))
        assert bench.world.lux() == 0.0
    bench.close()


def be_dark(bench: Bench) -> None:
    bench.light.safe_state()
    if bench.light.unsafe:
        raise bench.light.unsafe


def in_the_end(ask: Callable[[], None]) -> None:
    """Ask until it succeeds: the fault may still be on the wire."""
    for _ in range(20):
        with contextlib.suppress(DeviceError):
            return ask()
    return ask()


@pytest.mark.parametrize("fault", [Fault.REPLY_LOST, Fault.REPLY_CUT])
@pytest.mark.parametrize("at", [1, 3])
def test_an_answer_that_did_not_come_is_asked_for_again_and_nothing_is_played_twice(fault: Fault, at: int) -> None:
    bench = Bench(timeout_s=1.5)
    bench.light.connect()
    bench.wire.faults.plan(FaultPlan(fault, at=at))
    begin_ns = bench.world.clock.now_ns
    bench.light.play(IRREGULAR)
    assert len(bench.world.triggers(begin_ns, bench.world.clock.now_ns + 1)) == 20
    assert bench.world.clock.now_ns == begin_ns + 1_000_000
    bench.close()


@pytest.mark.parametrize(
    "arguments",
    [{"lowest": 0}, {"lowest": 100, "highest": 50}, {"highest": 70000}, {"edge_time_s": -1.0}, {"watchdog_s": 1e9}],
)
def test_arguments_that_make_no_sense_are_refused(arguments: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=r"light source: .*expected"):
        LedDriver(
            "/dev/null", clock=new_world().clock, **{"lowest": 1, "edge_time_s": 0.0, "settling_s": 0.0, **arguments}
        )
