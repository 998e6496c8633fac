"""A function generator as a light source: what it is told, what the light does, and what it refuses."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from drivers.clock import RealClock
from drivers.errors import ConnectionFailed, DataLost, DeviceError, UnexpectedAnswer, Unsupported
from drivers.interfaces import Waveform
from drivers.light.scpi_generator import ScpiGenerator
from drivers.transport.trace import Trace
from protocols.errors import InputError
from sim_backend.devices.light import SimulatedLightSource
from sim_backend.wire.faults import Fault, FaultPlan
from sim_backend.wire.scpi_makers import EmulatedKeysight
from sim_backend.world import OpticalBench
from tests.drivers.light.scpi_support import (
    DIALECT_NAMES,
    ScpiBench,
    pulses,
    scpi_bench,
    square,
    with_unequal_gaps,
)

if TYPE_CHECKING:
    from pathlib import Path

    from drivers.interfaces import LightSource


@pytest.fixture(name="bench", params=DIALECT_NAMES)
def connected(request: pytest.FixtureRequest) -> ScpiBench:
    built = scpi_bench(request.param)
    built.light.connect()
    return built


def sent_by(bench: ScpiBench, folder: Path, waveform: Waveform) -> list[str]:
    """Return the commands that play `waveform`, without questions."""
    trace = Trace(folder / "trace.txt", bench.clock)
    bench.light.trace_to(trace)
    bench.light.play(waveform)
    bench.light.trace_to(None)
    trace.close()
    lines = re.findall(r" > b'(.*)\\n'", (folder / "trace.txt").read_text())
    return [line for line in lines if not line.endswith("?")]


PLAYED = {
    "rigol": [
        ":SOUR1:VOLT:HIGH 8",
        ":SOUR1:VOLT:LOW 2",
        ":OUTP1 ON",
        ":SOUR1:FREQ 10",
        ":SOUR1:FUNC:SQU:DCYC 25",
        ":SOUR1:BURS:NCYC 5",
        ":SOUR1:BURS:PHAS 0",
        ":SOUR1:VOLT:HIGH 2.5",
        ":SOUR1:BURS:TRIG",
    ],
    "siglent": [
        "C1:BSWV HLEV,8",
        "C1:BSWV LLEV,2",
        "C1:OUTP ON",
        "C1:BSWV FRQ,10",
        "C1:BSWV DUTY,25",
        "C1:BTWV TIME,5",
        "C1:BTWV STPS,359.0028",
        "C1:BSWV HLEV,2.5",
        "C1:BTWV MTRIG",
    ],
    "keysight": [
        "VOLT:HIGH 8",
        "VOLT:LOW 2",
        "OUTP ON",
        "FREQ 10",
        "FUNC:SQU:DCYC 25",
        "BURS:NCYC 5",
        "BURS:PHAS 359.0028",
        "VOLT:HIGH 2.5",
        "*TRG",
    ],
}


def test_commands_of_a_square_wave_are_those_of_the_manual(bench: ScpiBench, tmp_path: Path) -> None:
    sent = sent_by(bench, tmp_path, square())
    dialect = next(name for name in DIALECT_NAMES if name in type(bench.firmware).__name__.lower())
    assert [re.sub(r"(\d)\.?0{6,}\d$|(\d\.\d*?)9{6,}\d*$", r"\1\2", line) for line in sent] == PLAYED[dialect]


def seen(world: OpticalBench, light: LightSource, waveform: Waveform) -> tuple[Any, ...]:
    """Return the light and the triggers that come of a waveform, in ns since it began, and how long it took."""
    light.connect()
    light.set_level(float(waveform.level[0]))
    world.clock.sleep(1.0)
    begin_ns = world.clock.now_ns
    played = light.play(waveform)
    history = world.light(begin_ns)
    triggers = [(edge.time_ns - begin_ns, edge.rising) for edge in world.triggers(begin_ns, begin_ns + 10**12)]
    # What lasts no time is no light: of several levels at one time, the last.
    lasts = np.append(np.diff(history.t_s) > 0.0, True)
    edges_ns = np.rint(history.t_s[lasts] * 1e9).astype(np.int64).tolist()
    return edges_ns, history.lux[lasts].tolist(), triggers, world.clock.now_ns - begin_ns, played.t_s.tolist()


@pytest.mark.parametrize("dialect", DIALECT_NAMES)
@pytest.mark.parametrize(
    "waveform",
    [
        square(),
        square(cycles=100, period_s=0.02, duty=0.5),
        square(cycles=3, period_s=2.0, duty=0.8, low=0.5, high=8.0),
        square(cycles=7, period_s=1e-3, duty=0.5),
        square(cycles=1),
        square(cycles=4, low=0.0, high=5.0),
        square(cycles=4, duty=0.05),
        pulses(),
        pulses(cycles=1),
        pulses(reset=1.0, test=1.8),
        pulses(reset=1.0, test=2.5),
        pulses(cycles=300, gap_s=0.01, test_s=0.0001),
        with_unequal_gaps(square(cycles=3)),
        with_unequal_gaps(pulses(), 0.013),
    ],
    ids=[
        "contrast", "fast", "slow", "1 kHz", "single pulse", "from dark", "short pulses", "reset and test",
        "one pair", "downwards", "both ways", "many pairs", "unequal gaps", "unequal gaps and pairs",
    ],
)  # fmt: skip
def test_the_light_is_that_of_a_source_that_is_timed_exactly(dialect: str, waveform: Waveform) -> None:
    world = OpticalBench(lux_per_level=0.05, pixel={"noise_rms": 0.03, "theta_off": 0.25}, sensor_seed=5)
    exact = SimulatedLightSource(world, lowest=0.5, highest=8.0, unit="V")
    bench = scpi_bench(dialect)
    expected, found = seen(world, exact, waveform), seen(bench.world, bench.light, waveform)
    assert found[0] == expected[0]
    np.testing.assert_allclose(found[1], expected[1], rtol=2e-5)  # a level between two others has 14 bits at least
    assert found[3] == expected[3]
    np.testing.assert_allclose(found[4], expected[4], atol=1e-9)


def test_odd_periods_are_right_to_the_nanosecond_of_rounding(bench: ScpiBench) -> None:
    waveform = square(cycles=50, period_s=1.0 / 30.0, duty=1.0 / 3.0)
    edges_ns, *_ = seen(bench.world, bench.light, waveform)
    np.testing.assert_allclose(np.array(edges_ns[1:]), waveform.t_s[1:] * 1e9, atol=1.0)


@pytest.mark.parametrize("waveform", [square(), pulses()], ids=["square", "samples"])
def test_the_sync_output_is_high_during_the_burst_and_marks_no_edge(bench: ScpiBench, waveform: Waveform) -> None:
    _, _, triggers, lasted_ns, _ = seen(bench.world, bench.light, waveform)
    assert [rising for _, rising in triggers] == [True, False]
    first_ns, last_ns = round(waveform.t_s[1] * 1e9), round(waveform.t_s[-1] * 1e9)
    assert 0 < triggers[0][0] <= first_ns
    assert last_ns <= triggers[1][0] <= lasted_ns


def edges_since(bench: ScpiBench, begin_ns: int) -> int:
    """Return how often the light changed, what lasts no time left out."""
    history = bench.world.light(begin_ns)
    lasts = np.append(np.diff(history.t_s) > 0.0, True)
    return int(np.count_nonzero(np.diff(history.lux[lasts], prepend=history.lux[0])))


def test_two_waveforms_in_a_row(bench: ScpiBench) -> None:
    bench.light.play(square(cycles=2, duty=0.2))
    bench.light.play(square(cycles=3, duty=0.8, low=4.0, high=4.5))
    assert edges_since(bench, 0) == 1 + 4 + 1 + 6
    assert bench.light.level() == 4.0
    bench.light.play(Waveform(np.array([0.0, 0.1, 0.2, 0.3]), np.array([1.0, 3.0, 1.0, 3.0]), 0.4))
    assert bench.light.level() == 3.0
    begin_ns = bench.clock.now_ns
    bench.light.play(square(cycles=2))
    assert edges_since(bench, begin_ns) == 1 + 4


def test_arming_leaves_the_light_alone(bench: ScpiBench, monkeypatch: pytest.MonkeyPatch) -> None:
    bench.light.set_level(2.0)
    begin_ns = bench.clock.now_ns
    changes: list[float] = []
    with monkeypatch.context() as watched:
        watched.setattr(bench.world, "set_level", changes.append)
        bench.light.play(square())
    assert changes[: changes.index(2.5)] == [2.0] * changes.index(2.5)
    assert set(changes) == {2.0, 2.5}
    assert bench.clock.now_ns > begin_ns


@pytest.mark.parametrize("dialect", DIALECT_NAMES)
@pytest.mark.parametrize("wired_to", ["high_z", 50])
def test_the_load_is_told_so_that_the_voltage_is_the_one_asked_for(dialect: str, wired_to: Any) -> None:
    bench = scpi_bench(dialect, wired_to=wired_to, load=wired_to, highest=4.0)
    bench.light.connect()
    bench.light.set_level(3.0)
    assert bench.world.level == pytest.approx(3.0)


@pytest.mark.parametrize("dialect", DIALECT_NAMES)
def test_a_wrong_load_would_double_the_voltage(dialect: str) -> None:
    bench = scpi_bench(dialect, wired_to="high_z", load=50, highest=4.0)
    bench.light.connect()
    bench.light.set_level(3.0)
    assert bench.world.level == pytest.approx(6.0)


def test_a_generator_that_restarted_is_set_up_again(bench: ScpiBench) -> None:
    bench.light.set_level(3.0)
    bench.firmware.reboot(lambda _: None)
    assert bench.light.level() == 0.0
    bench.light.set_level(3.0)
    assert bench.world.level == pytest.approx(3.0)
    begin_ns = bench.clock.now_ns
    bench.light.play(square())
    assert edges_since(bench, begin_ns) == 1 + 10


def test_a_trigger_that_is_lost_in_a_restart_is_told(bench: ScpiBench) -> None:
    bench.light.set_level(2.0)
    bench.light.play(square())
    first = bench.wire.faults.requests
    bench.light.play(square())
    # The trigger, SYST:ERR?, the question whether the output is on, and *OPC? of Keysight come last.
    last = 4 if isinstance(bench.firmware, EmulatedKeysight) else 3
    trigger = bench.wire.faults.requests - first - last
    bench.wire.faults.plan(FaultPlan(Fault.REBOOT, trigger))
    with pytest.raises(DataLost, match="its output is off at the end; did it restart"):
        bench.light.play(square())


def test_levels_are_in_steps_that_the_generator_has(bench: ScpiBench) -> None:
    bench.light.set_level(1.23456)
    assert bench.light.level() == pytest.approx(1.235, abs=1e-9)
    assert bench.light.nearest(1.23456) == pytest.approx(1.235)


def test_millivolts() -> None:
    bench = scpi_bench("keysight", lowest=500.0, highest=8000.0, unit="mV")
    bench.light.connect()
    bench.light.set_level(2500.0)
    assert bench.world.level == pytest.approx(2.5)
    assert bench.light.level() == pytest.approx(2500.0)


REFUSED = {
    "begins with the higher of its two levels; a square wave begins with the lower one; as samples: it ends at 1 and "
    "begins at 3": Waveform(np.array([0.0, 0.1]), np.array([3.0, 1.0]), 0.2),
    "it has 3 levels; a square wave has two; as samples: it ends at 3": Waveform(
        np.array([0.0, 0.1, 0.2]), np.array([1.0, 2.0, 3.0]), 0.3
    ),
    "its period is 8e-07 s; it can time 1e-06 s and more; as samples: two of its edges are 2e-07 s apart; 1e-06 s": (
        square(cycles=2, period_s=8e-7, duty=0.75)
    ),
    "as samples: its levels are 0.002 V apart; it can time 0.004 V and more": square(low=2.0, high=2.002),
    "as samples: its first edge comes": Waveform(
        np.array([0.0, 1e-6, 0.5, 0.7]), np.array([1.0, 2.0, 3.0, 1.0]), 1.0
    ),
}


@pytest.mark.parametrize("reason", REFUSED)
def test_what_it_cannot_time_is_refused_and_nothing_happens(bench: ScpiBench, reason: str) -> None:
    waveform = REFUSED[reason]
    why_not = bench.light.why_not(waveform)
    before = bench.wire.faults.requests
    with pytest.raises(Unsupported) as caught:
        bench.light.play(waveform)
    assert bench.wire.faults.requests == before
    assert reason in why_not
    assert why_not in str(caught.value)
    assert bench.is_dark()


def test_too_many_cycles_are_refused() -> None:
    light = ScpiGenerator("tcp://127.0.0.1:1", dialect="keysight", clock=RealClock(), lowest=0.1, highest=5.0)
    assert light.why_not(square(cycles=50_000)) == ""
    reason = "it has 50001 cycles; it can time 50000"
    assert light.why_not(square(cycles=50_001)) == f"as a square wave: {reason}; as samples: {reason}"


@pytest.mark.parametrize("dialect", DIALECT_NAMES)
def test_another_maker_is_refused(dialect: str) -> None:
    other = DIALECT_NAMES[(DIALECT_NAMES.index(dialect) + 1) % 3]
    bench = scpi_bench(other)
    light = ScpiGenerator(bench.wire.address, dialect=dialect, clock=bench.clock, lowest=0.5, highest=8.0)
    with pytest.raises(ConnectionFailed, match=f"this is .*; the dialect is for .*{dialect}"):
        light.connect()
    assert not light.connected
    bench.light.connect()  # the one before has let go of the line
    bench.light.close()


@pytest.mark.parametrize("dialect", DIALECT_NAMES)
def test_a_level_that_the_generator_cannot_reach_is_an_error(dialect: str) -> None:
    bench = scpi_bench(dialect, highest=12.0)
    with pytest.raises(UnexpectedAnswer, match=r"(error -222 \(Data out of range\)|it is '0\.1')") as caught:
        bench.light.connect()
    assert re.search(r"HIGH 12|HLEV,12|it is", str(caught.value))
    assert bench.is_dark()


def test_an_error_is_told_once_and_the_next_command_is_sound(bench: ScpiBench) -> None:
    bench.firmware._errors += [(-350, "Queue overflow"), (-113, "Undefined header")]
    with pytest.raises(UnexpectedAnswer, match=r"error -350 \(Queue overflow\)"):
        bench.light.set_level(3.0)
    bench.light.set_level(3.0)
    assert bench.light.level() == pytest.approx(3.0)


def test_sockets_are_let_go_and_no_one_there_is_told() -> None:
    bench = scpi_bench("rigol")
    bench.wire.close()
    with pytest.raises(ConnectionFailed, match=r"open 127\.0\.0\.1:\d+: .*is it plugged in"):
        bench.light.connect()


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"dialect": "tektronix"}, "dialect is 'tektronix'; expected rigol, siglent, keysight"),
        ({"unit": "cd/m2"}, "unit is 'cd/m2'; expected V, mV"),
        ({"channel": 0}, "channel is 0"),
        ({"load": 75}, "load is 75; expected high_z or 50"),
        ({"lowest": 0.0}, "limits are 0.0 to 5.0 V"),
        ({"highest": float("inf")}, "limits are"),
        ({"edge_time_s": -1.0}, "edge_time_s is -1.0"),
        ({"settling_s": float("nan")}, "settling_s is nan"),
        ({"timeout_s": 0.0}, "timeout_s is 0.0"),
        ({"address": "tcp://nowhere"}, "address is 'tcp://nowhere'; expected tcp://host:port or /dev/usbtmcN"),
        ({"address": "127.0.0.1:5025"}, "address is"),
        ({"address": "tcp://host:99999"}, "address is"),
        ({"address": "http://host:80"}, "address is"),
    ],
)
def test_wrong_arguments_are_refused(arguments: dict[str, Any], text: str) -> None:
    sound: dict[str, Any] = {"address": "tcp://h:1", "dialect": "rigol", "clock": RealClock(), "lowest": 0.5}
    chosen = {**sound, "highest": 5.0, **arguments}
    with pytest.raises(InputError, match=re.escape(text)):
        ScpiGenerator(chosen.pop("address"), **chosen)


def test_a_path_that_is_not_there_is_told() -> None:
    light = ScpiGenerator("/dev/usbtmc_none", dialect="rigol", clock=RealClock(), lowest=0.5, highest=5.0)
    with pytest.raises(DeviceError, match=r"open /dev/usbtmc_none: .*No such file"):
        light.connect()


def test_on_the_real_clock_a_burst_takes_its_time() -> None:
    bench = scpi_bench("keysight", clock=RealClock())
    bench.light.connect()
    begin_s = RealClock().now()
    bench.light.play(square(cycles=2, period_s=0.05, duty=0.5))
    assert RealClock().now() - begin_s >= 0.124
