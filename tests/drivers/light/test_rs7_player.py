"""Waveforms of an RS-7, played by the thread that asks and by a process of its own."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from drivers.clock import RealClock
from drivers.errors import ConnectionFailed, DeviceError, DeviceTimeout, WrongState
from drivers.interfaces import Waveform
from drivers.light.level_player import Schedule, play_in_process
from drivers.light.rs7 import SpectralLed
from drivers.transport.trace import Trace
from sim_backend.clock import NS_PER_S, VirtualClock
from sim_backend.wire.faults import Fault, FaultPlan
from sim_backend.wire.rs7 import Rs7Firmware
from sim_backend.wire.serial_wire import SerialWire
from sim_backend.world import OpticalBench

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator


class RealTime(VirtualClock):
    """The clock of a world that goes by the clock on the wall."""

    @property
    def now_ns(self) -> int:
        return time.monotonic_ns()

    def now(self) -> float:
        return self.now_ns / NS_PER_S

    def sleep(self, seconds: float) -> None:
        time.sleep(seconds)


class CountedClock(VirtualClock):
    """A virtual clock that counts how often it is read."""

    def __init__(self) -> None:
        super().__init__()
        self.reads = 0

    def now(self) -> float:
        self.reads += 1
        return super().now()


PLAYERS = pytest.mark.parametrize(("player", "clock"), [("inline", CountedClock), ("process", RealTime)])


@contextmanager
def bench(
    clock: VirtualClock, player: Any, **arguments: Any
) -> Iterator[tuple[OpticalBench, SpectralLed, SerialWire]]:
    world = OpticalBench(lux_per_level=0.05, pixel={}, sensor_seed=5)
    world.clock = clock
    wire = SerialWire(Rs7Firmware(world, photodiode=True, **arguments), "rs7")
    light = SpectralLed(wire.path, clock=RealClock() if player == "process" else clock, player=player, timeout_s=20.0)
    try:
        light.connect()
        yield world, light, wire
    finally:
        light.close()
        wire.close()


def square(half_period_s: float, *levels: float) -> Waveform:
    return Waveform(
        np.arange(len(levels), dtype=np.float64) * half_period_s, np.array(levels), len(levels) * half_period_s
    )


def test_times_of_each_edge_on_a_virtual_clock() -> None:
    with bench(CountedClock(), "inline", latency_s=2e-3, settling_s=0.05) as (world, light, _):
        light.set_level(1000.0)
        begin_ns = world.clock.now_ns
        played = light.play(square(0.1, 1000.0, 2000.0, 1000.0, 0.0))
        edges = world.triggers(begin_ns, world.clock.now_ns)
        assert played.t_written_s is not None
        assert played.t_acknowledged_s is not None
        assert played.t_settled_s is not None
        np.testing.assert_allclose(played.t_written_s, [0.0, 0.1, 0.2, 0.3], atol=1e-9)
        np.testing.assert_allclose(played.t_acknowledged_s, [0.0, 0.1, 0.2, 0.3], atol=1e-9)
        np.testing.assert_array_equal(played.t_s, played.t_acknowledged_s)
        np.testing.assert_allclose(played.t_settled_s, [0.0, 0.152, 0.252, 0.352], atol=1e-9)
        assert [(edge.time_ns - begin_ns, edge.rising) for edge in edges] == [
            (102_000_000, True),
            (202_000_000, False),
            (302_000_000, False),
        ]


def test_edges_that_come_before_the_light_has_settled_are_late_and_say_so() -> None:
    with bench(CountedClock(), "inline", latency_s=2e-3, settling_s=0.05) as (_, light, _):
        played = light.play(square(0.03, 1000.0, 2000.0, 1000.0, 2000.0))
        assert played.t_written_s is not None
        np.testing.assert_allclose(played.t_written_s, [0.0, 0.052, 0.104, 0.156], atol=1e-9)


def test_a_process_plays_in_real_time(tmp_path: Path) -> None:
    with bench(RealTime(), "process", latency_s=1e-3, settling_s=5e-3) as (world, light, _):
        trace = Trace(tmp_path / "trace.txt")
        light.trace_to(trace)
        begin_ns = world.clock.now_ns
        played = light.play(square(0.1, 1000.0, 2000.0, 1000.0, 2000.0, 1000.0))
        trace.close()
        edges = world.triggers(begin_ns, world.clock.now_ns)
        assert world.level == 1000.0
        assert light.level() == 1000.0
    assert played.t_written_s is not None
    assert played.t_settled_s is not None
    planned = np.arange(5) * 0.1
    assert np.all(played.t_written_s >= planned)
    assert np.all(played.t_s >= played.t_written_s)
    assert np.all(played.t_settled_s >= played.t_s)
    assert np.all(played.t_settled_s >= played.t_written_s + 6e-3 - 1e-6)  # it does not answer before
    assert [edge.rising for edge in edges] == [True, True, False, True, False]
    # Each step of the light lies between the command and its Ok: some beginning of the waveform fits them all.
    seen_s = np.array([edge.time_ns for edge in edges]) / NS_PER_S
    assert np.max(seen_s - played.t_settled_s) <= np.min(seen_s - played.t_written_s)
    assert r"sent OUT 2000\r" in (tmp_path / "trace.txt").read_text()


@PLAYERS
def test_an_answer_that_does_not_come_leaves_the_light_dark_and_raises(
    player: str, clock: Callable[[], VirtualClock]
) -> None:
    with bench(clock(), player, latency_s=0.0, settling_s=0.0) as (world, light, wire):
        light._talk.link.timeout_s = 1.0
        wire.faults.plan(FaultPlan(Fault.REPLY_LOST, 2 + 2))  # POT, ALA, two levels
        with pytest.raises(DeviceTimeout, match="OUT 1000: no whole answer within 1 s"):
            light.play(square(0.02, 1000.0, 2000.0, 1000.0, 2000.0))
        assert world.level == 0.0
        assert light.level() == 0.0


@PLAYERS
def test_a_level_that_the_unit_refuses_ends_the_waveform_dark(player: str, clock: Callable[[], VirtualClock]) -> None:
    with bench(clock(), player, latency_s=0.0, settling_s=0.0, full_cd_m2=1500.0) as (world, light, _):
        with pytest.raises(WrongState, match=r"OUT 2000: \?24 - .*; choose a lower level"):
            light.play(square(0.02, 1000.0, 2000.0, 1000.0))
        assert world.level == 0.0


@PLAYERS
def test_a_light_that_does_not_settle_is_asked_again_and_then_given_up(
    player: str, clock: Callable[[], VirtualClock]
) -> None:
    with bench(clock(), player, latency_s=0.0, settling_s=0.0) as (world, light, wire):
        firmware = wire.firmware
        assert isinstance(firmware, Rs7Firmware)
        firmware.next_errors = ["18"]
        played = light.play(square(0.02, 1000.0, 2000.0))
        assert played.t_s[0] >= 0.5
        assert played.t_written_s is not None
        assert played.t_written_s[0] < played.t_s[0] - 0.49
        firmware.next_errors = ["18"] * 3
        with pytest.raises(DeviceError, match=r"OUT 3000: \?18 - "):
            light.play(square(0.02, 3000.0, 2000.0))
        assert world.level == 0.0


def test_a_waveform_that_is_given_up_leaves_the_light_dark() -> None:
    with bench(RealTime(), "process", latency_s=0.0, settling_s=0.0) as (world, light, wire):
        talked, main = wire.faults.requests, threading.get_ident()

        def interrupt() -> None:
            while wire.faults.requests < talked + 3:  # POT, ALA, the first level
                time.sleep(0.005)
            time.sleep(0.05)
            signal.pthread_kill(main, signal.SIGINT)

        threading.Thread(target=interrupt, daemon=True).start()
        with pytest.raises(KeyboardInterrupt):
            light.play(square(30.0, 1000.0, 2000.0))
        assert world.level == 0.0
        light.set_level(500.0)


def play_alone(fd: int, stdin: Any) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", "drivers.light.level_player_process"],
        stdin=stdin,
        stdout=subprocess.PIPE,
        pass_fds=(fd,),
        env={**os.environ, "PYTHONPATH": str(Path.cwd())},
    )


def test_a_player_whose_parent_is_gone_makes_the_light_dark() -> None:
    with bench(RealTime(), "process", latency_s=0.0, settling_s=0.0) as (world, light, wire):
        schedule = asdict(Schedule((0.0, 60.0), (1000.0, 2000.0), 120.0, already_at=None, timeout_s=10.0))
        with play_alone(light._port.fd, subprocess.PIPE) as player:
            assert player.stdin is not None
            before = wire.faults.requests
            player.stdin.write(json.dumps({"fd": light._port.fd, "device": "rs7", "schedule": schedule}).encode())
            player.stdin.write(b"\n")
            player.stdin.flush()
            while wire.faults.requests == before:
                time.sleep(0.005)
            assert player.stdout is not None
            player.stdin.close()
            result = json.loads(player.stdout.read())
        assert result["error"]["kind"] == "WrongState"
        assert "is gone or wants no more" in result["error"]["answered"]
        assert world.level == 0.0


def test_a_player_that_cannot_play_says_why() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    try:
        with pytest.raises(ConnectionFailed, match=r"^rs7: OUT 5: .*Broken pipe"):
            play_in_process(writing, "rs7", Schedule((0.0,), (5.0,), 0.1, None, 1.0))
    finally:
        os.close(writing)


def test_a_player_that_does_not_start_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("drivers.light.level_player._MODULE", "drivers.light.no_such_player")
    with pytest.raises(DeviceError, match=r"^rs7: play a waveform .*No module named drivers.light.no_such_player"):
        play_in_process(0, "rs7", Schedule((0.0,), (5.0,), 0.1, None, 1.0))


@pytest.mark.parametrize(
    ("waveform", "why"),
    [
        (Waveform(np.array([]), np.array([]), 0.1), "do not ascend from 0 s"),
        (Waveform(np.array([0.1]), np.array([100.0]), 0.2), "do not ascend from 0 s"),
        (Waveform(np.array([0.0, 0.2, 0.1]), np.array([100.0] * 3), 0.3), "do not ascend from 0 s"),
        (Waveform(np.array([0.0, 0.2]), np.array([100.0] * 2), 0.1), "an edge after its end"),
        (Waveform(np.array([0.0]), np.array([100.0]), float("nan")), "an edge after its end"),
    ],
)
def test_a_waveform_that_makes_no_sense_is_refused(waveform: Waveform, why: str) -> None:
    with bench(CountedClock(), "inline") as (world, light, _):
        with pytest.raises(WrongState, match=why):
            light.play(waveform)
        assert world.level == 0.0
