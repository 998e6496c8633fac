"""The emulated function generators: documented commands over a socket, and what the world sees of them."""

from __future__ import annotations

import contextlib
import socket
import time
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

import pytest

from protocols.errors import InputError
from sim_backend.wire.faults import Fault, FaultPlan
from sim_backend.wire.scpi import ScpiWire
from sim_backend.wire.scpi_makers import emulated_generator
from sim_backend.world import OpticalBench

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from sim_backend.wire.scpi_generator import EmulatedGenerator

#: What the manuals give for 2 V to 3 V, 10 Hz, 3 cycles, at rest at the lower level, ready for a trigger, lit.
READY = {
    "rigol": (
        ":OUTP1:LOAD INF;:SOUR1:FUNC SQU;:SOUR1:BURS:MODE TRIG;:SOUR1:BURS:TRIG:SOUR MAN;:SOUR1:BURS:IDLE BOTTOM;"
        ":SOUR1:BURS:STAT ON;:OUTP1:SYNC ON;:SOUR1:FREQ 10;:SOUR1:FUNC:SQU:DCYC 50;:SOUR1:BURS:NCYC 3;"
        ":SOUR1:BURS:PHAS 0;:SOUR1:VOLT:HIGH 3;:SOUR1:VOLT:LOW 2;:OUTP1 ON",
        ":SOUR1:BURS:TRIG",
        0,
    ),
    "siglent": (
        "C1:OUTP LOAD,HZ;C1:BSWV WVTP,SQUARE;C1:BTWV STATE,ON;C1:BTWV GATE_NCYC,NCYC;C1:BTWV TRSR,MAN;C1:SYNC ON;"
        "C1:BSWV FRQ,10;C1:BSWV DUTY,50;C1:BTWV TIME,3;C1:BTWV STPS,270;C1:BSWV HLEV,3;C1:BSWV LLEV,2;C1:OUTP ON",
        "C1:BTWV MTRIG",
        25_000_000,
    ),
    "keysight": (
        "OUTP:LOAD INF;FUNC SQU;BURS:MODE TRIG;TRIG:SOUR BUS;BURS:STAT ON;OUTP:SYNC ON;FREQ 10;FUNC:SQU:DCYC 50;"
        "BURS:NCYC 3;BURS:PHAS 270;VOLT:HIGH 3;VOLT:LOW 2;OUTP ON",
        "*TRG",
        25_000_000,
    ),
}


class Caller:
    """A bare socket to a wire."""

    def __init__(self, address: str) -> None:
        parts = urlsplit(address)
        self._socket = socket.create_connection((parts.hostname or "", parts.port or 0), 5.0)
        self._file = self._socket.makefile("rwb", buffering=0)

    def send(self, *lines: str) -> None:
        self._socket.sendall("".join(f"{line}\n" for line in lines).encode())

    def ask(self, question: str) -> str:
        self.send(question)
        return self._file.readline().decode()

    def close(self) -> None:
        self._file.close()
        self._socket.close()


def patient_caller(address: str) -> Caller:
    """Return a caller as soon as the cable is in."""
    until_s = time.monotonic() + 60.0
    while time.monotonic() < until_s:
        with contextlib.suppress(OSError):
            return Caller(address)
        time.sleep(0.01)
    return Caller(address)


class Bench:
    """A world, a generator, a wire and a caller."""

    def __init__(self, dialect: str) -> None:
        self.world = OpticalBench(lux_per_level=0.05, pixel={"noise_rms": 0.03, "theta_off": 0.25}, sensor_seed=5)
        self.firmware: EmulatedGenerator = emulated_generator(self.world, dialect)
        self.wire = ScpiWire(self.firmware)
        self.caller = Caller(self.wire.address)
        self.ready, self.trigger, self.lead_ns = READY[dialect]

    def close(self) -> None:
        self.caller.close()
        self.wire.close()


@pytest.fixture(name="make")
def bench_maker() -> Iterator[Callable[[str], Bench]]:
    made: list[Bench] = []

    def make(dialect: str) -> Bench:
        made.append(Bench(dialect))
        return made[-1]

    yield make
    for bench in made:
        bench.close()


@pytest.mark.parametrize("dialect", READY)
def test_a_burst_has_its_edges_and_its_sync_and_then_rests_low(make: Callable[[str], Bench], dialect: str) -> None:
    bench = make(dialect)
    bench.caller.send(*bench.ready.split(";"))
    assert "No error" in bench.caller.ask("SYST:ERR?")
    assert bench.world.level == pytest.approx(2.0)
    bench.caller.send(bench.trigger)
    assert bench.caller.ask("*OPC?") == "1\n"
    lasts_ns = 300_000_000
    assert bench.world.clock.now_ns == bench.lead_ns + 250_000_000
    triggers = [(edge.time_ns, edge.rising) for edge in bench.world.triggers(0, 10**12)]
    assert triggers == [(0, True), (lasts_ns, False)]
    light = bench.world.light(0)
    assert light.t_s[-5:].tolist() == pytest.approx([bench.lead_ns * 1e-9 + 0.05 * n for n in range(1, 6)])
    assert light.lux[-5:].tolist() == pytest.approx([0.1, 0.15, 0.1, 0.15, 0.1])
    assert bench.world.level == pytest.approx(2.0)


@pytest.mark.parametrize("dialect", READY)
def test_at_phase_0_the_light_rests_high_where_nothing_says_otherwise(
    make: Callable[[str], Bench], dialect: str
) -> None:
    bench = make(dialect)
    phase = {"rigol": ":SOUR1:BURS:IDLE FPT", "siglent": "C1:BTWV STPS,0", "keysight": "BURS:PHAS 0"}[dialect]
    bench.caller.send(*bench.ready.split(";"), phase)
    bench.caller.ask("*OPC?")
    assert bench.world.level == pytest.approx(3.0)


@pytest.mark.parametrize(
    ("dialect", "command"),
    [("rigol", ":OUTP1:LOAD 50"), ("siglent", "C1:OUTP LOAD,50"), ("keysight", "OUTP:LOAD 50")],
)
def test_changing_the_load_changes_what_is_told_and_not_the_light(
    make: Callable[[str], Bench], dialect: str, command: str
) -> None:
    bench = make(dialect)
    bench.caller.send(*bench.ready.split(";"), command)
    bench.caller.ask("*OPC?")
    assert bench.world.level == pytest.approx(2.0)
    question = {"rigol": ":SOUR1:VOLT:LOW?", "siglent": "C1:BSWV?", "keysight": "VOLT:LOW?"}[dialect]
    expected = {"rigol": "1.000000E+00\n", "siglent": "LLEV,1V", "keysight": "+1.00000000000000E+00\n"}[dialect]
    assert expected in bench.caller.ask(question)


@pytest.mark.parametrize(
    ("dialect", "question", "answer"),
    [
        ("rigol", "*IDN?", "Rigol Technologies,DG1062Z,DG1ZA000000001,03.01.12"),
        ("rigol", ":SYST:ERR?", '0,"No error"'),
        ("rigol", ":OUTP1?", "ON"),
        ("rigol", ":OUTP1:LOAD?", "9.900000E+37"),
        ("rigol", ":SOUR1:FREQ?", "1.000000E+01"),
        ("rigol", ":SOUR1:BURS:NCYC?", "3"),
        ("rigol", ":SOUR1:BURS:IDLE?", "BOTTOM"),
        ("keysight", "SYST:ERR?", '+0,"No error"'),
        ("keysight", "OUTP?", "1"),
        ("keysight", "OUTP:LOAD?", "+9.90000000000000E+37"),
        ("keysight", "FREQ?", "+1.00000000000000E+01"),
        ("keysight", "SOUR1:FREQ?", "+1.00000000000000E+01"),
        ("keysight", "TRIG:SOUR?", "BUS"),
        ("siglent", "C1:OUTP?", "C1:OUTP ON,LOAD,HZ,PLRT,NOR"),
        (
            "siglent",
            "C1:BSWV?",
            "C1:BSWV WVTP,SQUARE,FRQ,10HZ,PERI,0.1S,AMP,1V,OFST,2.5V,HLEV,3V,LLEV,2V,PHSE,0,DUTY,50",
        ),
        ("siglent", "C1:SYNC?", "C1:SYNC ON"),
    ],
)
def test_answers_are_as_documented(make: Callable[[str], Bench], dialect: str, question: str, answer: str) -> None:
    bench = make(dialect)
    bench.caller.send(*bench.ready.split(";"))
    assert bench.caller.ask(question) == f"{answer}\n"


@pytest.mark.parametrize("dialect", ["rigol", "keysight"])
def test_errors_are_queued_and_told_in_order(make: Callable[[str], Bench], dialect: str) -> None:
    bench = make(dialect)
    source = ":SOUR1:" if dialect == "rigol" else ""
    bench.caller.send(f"{source}NOTHING 1", f"{source}FREQ fast", f"{source}VOLT:LOW 99", "")
    assert bench.caller.ask("SYST:ERR?") == '-113,"Undefined header"\n'
    assert bench.caller.ask("SYST:ERR?") == '-224,"Illegal parameter value"\n'
    assert bench.caller.ask("SYST:ERR?") == '-222,"Data out of range"\n'
    assert bench.caller.ask("SYST:ERR?").endswith('0,"No error"\n')
    bench.caller.send(f"{source}NOTHING 1", "*CLS")
    assert bench.caller.ask("SYST:ERR?").endswith('0,"No error"\n')


def test_siglent_changes_what_is_out_of_range_without_a_word(make: Callable[[str], Bench]) -> None:
    bench = make("siglent")
    bench.caller.send(*bench.ready.split(";"), "C1:BSWV DUTY,150", "C1:BSWV HLEV,99")
    assert bench.caller.ask("SYST:ERR?") == '0,"No error"\n'
    assert "HLEV,3V,LLEV,2V,PHSE,0,DUTY,99.99" in bench.caller.ask("C1:BSWV?")


def test_a_trigger_that_nothing_waits_for_is_an_error(make: Callable[[str], Bench]) -> None:
    bench = make("keysight")
    bench.caller.send("*TRG")
    assert bench.caller.ask("SYST:ERR?") == '-211,"Trigger ignored"\n'


def test_after_power_failure_the_light_is_out_and_the_load_is_50_ohm(make: Callable[[str], Bench]) -> None:
    bench = make("keysight")
    bench.caller.send(*bench.ready.split(";"))
    assert bench.caller.ask("OUTP?") == "1\n"
    bench.wire.faults.plan(FaultPlan(Fault.REBOOT, 0))
    bench.caller.send("OUTP?")
    assert bench.caller.ask("OUTP:LOAD?") == "+5.00000000000000E+01\n"
    assert bench.world.lux() == 0.0


def test_faults_spoil_the_answer_and_not_the_request(make: Callable[[str], Bench]) -> None:
    bench = make("keysight")
    bench.wire.faults.plan(FaultPlan(Fault.REPLY_LOST, 0))
    bench.wire.faults.plan(FaultPlan(Fault.REPLY_CUT, 1))
    bench.wire.faults.plan(FaultPlan(Fault.REPLY_LATE, 3, seconds=0.1))
    bench.caller.send("OUTP:LOAD?", "OUTP:LOAD?")
    assert bench.caller.ask("*OPC?") == "+5.000000001\n"  # the half of the second answer, and this one
    begin_s = time.monotonic()
    assert bench.caller.ask("*OPC?") == "1\n"
    assert time.monotonic() - begin_s >= 0.1


def test_the_address_stays_when_the_cable_is_out_and_in_again(make: Callable[[str], Bench]) -> None:
    bench = make("rigol")
    address = bench.wire.address
    bench.wire.faults.plan(FaultPlan(Fault.UNPLUGGED, 0, seconds=600.0))
    assert bench.caller.ask("*IDN?") == ""
    bench.caller.close()
    with pytest.raises(OSError, match="refused"):
        Caller(address)
    bench.wire.put_back()
    bench.caller = patient_caller(address)
    assert bench.caller.ask("*IDN?").startswith("Rigol")


def test_the_time_that_a_cable_is_out_passes_on_the_clock_of_the_world_too(make: Callable[[str], Bench]) -> None:
    bench = make("rigol")
    address, bench.wire.clock = bench.wire.address, bench.world.clock
    bench.wire.faults.plan(FaultPlan(Fault.UNPLUGGED, 0, seconds=600.0))
    assert bench.caller.ask("*IDN?") == ""
    bench.caller.close()
    bench.world.clock.sleep(601.0)
    bench.caller = patient_caller(address)
    assert bench.caller.ask("*IDN?").startswith("Rigol")


def test_time_that_passes_as_soon_as_the_cable_is_out_counts(make: Callable[[str], Bench]) -> None:
    """The driver may notice, and sleep, before the wire's own thread goes on."""
    bench = make("rigol")
    address, bench.wire.clock = bench.wire.address, bench.world.clock
    hang_up = bench.wire._hang_up

    def hang_up_and_sleep() -> None:
        hang_up()
        bench.world.clock.sleep(601.0)

    bench.wire._hang_up = hang_up_and_sleep  # type: ignore[method-assign]
    bench.wire.faults.plan(FaultPlan(Fault.UNPLUGGED, 0, seconds=600.0))
    assert bench.caller.ask("*IDN?") == ""
    bench.caller.close()
    bench.caller = patient_caller(address)
    assert bench.caller.ask("*IDN?").startswith("Rigol")


def test_another_driver_may_come_when_the_first_has_gone(make: Callable[[str], Bench]) -> None:
    bench = make("rigol")
    bench.caller.close()
    bench.caller = Caller(bench.wire.address)
    assert bench.caller.ask("*OPC?") == "1\n"
    bench.wire.close()
    bench.wire.close()


def test_unknown_dialect_is_refused() -> None:
    world = OpticalBench(lux_per_level=0.05, pixel={"noise_rms": 0.03, "theta_off": 0.25}, sensor_seed=5)
    with pytest.raises(InputError, match="expected rigol, siglent, keysight"):
        emulated_generator(world, "tektronix")
