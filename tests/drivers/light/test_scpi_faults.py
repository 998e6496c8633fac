"""What goes wrong on the way to a function generator: it goes on right, or says so, and the light can be put out."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.errors import DeviceError
from drivers.light.scpi_talk import ScpiTalk
from sim_backend.wire.faults import Fault, FaultPlan, Faults
from tests.drivers.light.scpi_support import DIALECT_NAMES, ScpiBench, pulses, scpi_bench, square
from tests.drivers.patience import PATIENT_S, impatient

if TYPE_CHECKING:
    from collections.abc import Iterator

FAULTS = (Fault.REPLY_LOST, Fault.REPLY_LATE, Fault.REPLY_CUT, Fault.GARBAGE, Fault.UNPLUGGED, Fault.REBOOT)


def session(bench: ScpiBench) -> None:
    """Do a bit of everything."""
    light = bench.light
    light.connect()
    light.set_level(3.0)
    assert light.level() == pytest.approx(3.0)
    light.play(square(cycles=3))
    assert light.level() == pytest.approx(2.0)
    light.play(pulses(cycles=2, test=3.0))
    assert light.level() == pytest.approx(2.0)
    light.set_level(0.0)


def requests_of_a_session(dialect: str) -> int:
    bench = scpi_bench(dialect)
    session(bench)
    count = bench.wire.faults.requests
    bench.light.close()
    return count


def require_dark_after_safe_state(bench: ScpiBench) -> None:
    """Let the wire be whole, and require that the light goes out and can be used again."""
    bench.light._talk._link.timeout_s = PATIENT_S
    until_s = time.monotonic() + PATIENT_S
    bench.light.safe_state()
    while bench.light.unsafe is not None and time.monotonic() < until_s:  # the cable is not in yet
        time.sleep(0.02)
        bench.light.safe_state()
    assert bench.light.unsafe is None
    assert bench.is_dark()


def try_with(dialect: str, fault: Fault, at: int) -> bool:
    """Return whether a session with one fault went through; what comes of it is right in any case."""
    faults = Faults([FaultPlan(fault, at, seconds=0.3 if fault is Fault.REPLY_LATE else 0.1)])
    bench = scpi_bench(dialect, faults=faults, timeout_s=0.2)
    said = ""
    try:
        session(bench)
    except DeviceError as error:
        said = str(error)
    assert said.startswith("light source: ") or len(bench.world.triggers(0, 10**12)) == 4
    if bench.light.connected:
        require_dark_after_safe_state(bench)
    assert bench.is_dark()
    bench.light.close()
    bench.wire.close()
    return not said


def sampled(dialect: str) -> Iterator[tuple[Fault, int]]:
    """Yield some requests of a session, each with the next fault; different ones for each dialect."""
    first = DIALECT_NAMES.index(dialect)
    for number, at in enumerate(range(first, requests_of_a_session(dialect), 9)):
        yield FAULTS[(number + first) % len(FAULTS)], at


@pytest.mark.parametrize("dialect", DIALECT_NAMES)
def test_any_fault_is_told_or_mended_and_safe_state_makes_dark(dialect: str) -> None:
    outcomes = [try_with(dialect, fault, at) for fault, at in sampled(dialect)]
    assert not all(outcomes)


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_in_safe_state_itself_is_overcome(fault: Fault) -> None:
    for at in range(3):
        bench = scpi_bench(DIALECT_NAMES[at], timeout_s=PATIENT_S)
        bench.light.connect()
        bench.light.set_level(3.0)
        bench.wire.faults.plan(FaultPlan(fault, at, seconds=0.3 if fault is Fault.REPLY_LATE else 0.05))
        with impatient(bench.light._talk._link, 0.2):
            bench.light.safe_state()
        require_dark_after_safe_state(bench)
        bench.light.set_level(2.0)
        assert bench.world.level == pytest.approx(2.0)
        bench.light.close()


def test_a_cable_that_stays_out_is_told_as_unsafe() -> None:
    bench = scpi_bench("keysight", timeout_s=PATIENT_S)
    bench.light.connect()
    bench.light.set_level(3.0)
    bench.wire.close()
    with impatient(bench.light._talk._link, 0.2):
        bench.light.safe_state()
    assert "could not be made dark" in str(bench.light.unsafe)
    assert "switch it off by hand" in str(bench.light.unsafe)
    assert not bench.is_dark()


def test_an_answer_that_comes_late_is_not_taken_for_the_next_one() -> None:
    bench = scpi_bench("keysight", timeout_s=PATIENT_S)
    bench.light.connect()
    bench.light.set_level(3.0)
    bench.wire.faults.plan(FaultPlan(Fault.REPLY_LATE, 0, seconds=0.6))
    with pytest.raises(DeviceError, match="within"), impatient(bench.light._talk._link, 0.2):
        bench.light.level()
    assert bench.light.level() == pytest.approx(3.0)
    bench.light.close()


class Scripted:
    """A port that answers every question with the next of some bytes."""

    def __init__(self, *answers: bytes) -> None:
        self._answers = list(answers)
        self._ready = b""
        self.written = b""

    def open(self) -> None: ...

    def close(self) -> None: ...

    def write(self, data: bytes) -> None:
        self.written += data
        if data.endswith(b"?\n") and self._answers:
            self._ready += self._answers.pop(0)

    def discard(self) -> bool:
        return False

    def read(self, timeout_s: float) -> bytes:
        data, self._ready = self._ready, b""
        return data


IDN = b"Agilent Technologies,33521A,MY50000001,2.03\n"


def test_error_question_is_understood_in_all_its_spellings() -> None:
    for answer in (b'0,"No error"\n', b'+0,"No error"\r\n', b"0, No Error\n", b'  0  ,  "No Error" \n'):
        ScpiTalk(Scripted(answer), "light source", 0.05).tell("OUTP OFF")


@pytest.mark.parametrize("answer", [b'-113,"Undefined header"\n', b'+501,"Cross-isolation"\n', b"-222, Out\n"])
def test_error_is_told_with_its_text_and_the_queue_is_emptied(answer: bytes) -> None:
    port = Scripted(answer)
    with pytest.raises(DeviceError, match=r"light source: OUTP ON: error (-113|501|-222) \((Und|Cross|Out)"):
        ScpiTalk(port, "light source", 0.05).tell("OUTP ON")
    assert port.written == b"OUTP ON\nSYST:ERR?\n*CLS\n"


@settings(max_examples=40, deadline=None)
@given(st.binary(max_size=60).filter(lambda data: not data.lstrip(b" +-0\t\r\x0b\x0c").startswith(b",")))
def test_no_bytes_but_no_error_are_no_error(data: bytes) -> None:
    with pytest.raises(DeviceError):
        ScpiTalk(Scripted(data), "light source", 0.01).tell("OUTP OFF")


@settings(max_examples=40, deadline=None)
@given(st.binary(max_size=80))
def test_identity_of_random_bytes_never_crashes(data: bytes) -> None:
    talk = ScpiTalk(Scripted(data), "light source", 0.01)
    try:
        fields = talk.open()
    except DeviceError:
        return
    assert len(fields) == 4
    assert all(field.isprintable() and field for field in fields)
