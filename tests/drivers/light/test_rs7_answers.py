"""Answers of an RS-7 as its manual prints them, and bytes that are no answer."""

from __future__ import annotations

import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.errors import DeviceError, DeviceTimeout, UnexpectedAnswer, WrongState
from drivers.light.rs7_answers import (
    Answer,
    Kind,
    ask,
    level_text,
    number_in,
    require_done,
    resynchronise,
    step_to,
    uptime_in,
)
from drivers.light.rs7_errors import CODES, Complaint, Treatment, complaint_in, complaint_raised
from drivers.light.rs7_spectrum import spectrum_in
from drivers.transport.link import Link


class Scripted:
    """A port whose other end says what it was told to, once something was written."""

    path = "scripted"

    def __init__(self, *answers: bytes) -> None:
        self.written: list[bytes] = []
        self._answers = list(answers)
        self._ready = b""

    def open(self) -> None: ...

    def close(self) -> None: ...

    def write(self, data: bytes) -> None:
        self.written.append(data)
        self._ready += self._answers.pop(0) if self._answers else b""

    def discard(self) -> bool:
        return False

    def read(self, timeout_s: float) -> bytes:
        ready, self._ready = self._ready, b""
        return ready


def asked(said: bytes, kind: Kind = "value") -> Answer:
    return ask(Link(Scripted(said), "rs7", 0.0, 0.0), "rs7", "XYZ", kind, time.monotonic)


def test_a_command_ends_with_a_single_cr() -> None:
    port = Scripted(b"\r\n1207471\r\n")
    answer = ask(Link(port, "rs7", 0.0, 0.0), "rs7", "PDI", "value", time.monotonic)
    assert port.written == [b"PDI\r"]
    assert answer.rows == ("1207471",)
    assert answer.written_s <= answer.acknowledged_s <= answer.done_s


def test_the_acknowledgement_is_not_the_end_of_a_list() -> None:
    assert asked(b"\r\n1,-1.4\r\n2,-0.3\r\n3,+0.31\r\n\r\n", "list").rows == ("1,-1.4", "2,-0.3", "3,+0.31")
    assert asked(b"\r\n\r\n", "list").rows == ()
    assert asked(b"\r\nOk\r\n", "ok").rows == ()


@pytest.mark.parametrize(
    "said",
    [
        b"?A5 - TEC off\r\n\r\n1.034\r\n",
        b"\r\n?A5 - TEC off\r\n1.034\r\n",
    ],
)
def test_an_alarm_in_between_is_not_taken_for_the_answer(said: bytes) -> None:
    answer = asked(said)
    assert answer.rows == ("1.034",)
    assert answer.alarms == (Complaint("A5", "TEC off"),)


def test_an_alarm_within_a_list_is_no_row() -> None:
    answer = asked(b"\r\n1\r\n?A1 - limit\r\n2\r\n\r\n", "list")
    assert answer.rows == ("1", "2")
    assert [alarm.code for alarm in answer.alarms] == ["A1"]


@pytest.mark.parametrize("kind", ["ok", "value", "list"])
def test_an_error_is_an_answer_to_any_command(kind: Kind) -> None:
    answer = asked(b"\r\n?16 - Output spectrum is zero\r\n", kind)
    assert answer.complaint == Complaint("16", "Output spectrum is zero")
    with pytest.raises(WrongState, match=r"^rs7: XYZ: \?16 - Output spectrum is zero; load a preset"):
        require_done("rs7", "XYZ", answer)


@pytest.mark.parametrize(
    ("said", "kind", "problem"),
    [
        (b"Ok\r\n", "ok", "'Ok' in place of the acknowledgement"),
        (b"\r\n1.0\r\n", "ok", "'1.0' in place of Ok"),
        (b"\r\nOk\r\n", "value", "'Ok' in place of a value"),
        (b"\r\n\r\n", "value", "'' in place of a value"),
        (b"\r\n\xff\x00\r\n", "value", "xff"),
        (b"\r\n1\x002\r\n", "value", "x00"),
    ],
)
def test_what_is_no_answer_is_refused(said: bytes, kind: Kind, problem: str) -> None:
    with pytest.raises(UnexpectedAnswer, match=problem):
        asked(said, kind)


@pytest.mark.parametrize(
    ("said", "kind"),
    [(b"", "ok"), (b"\r\n", "ok"), (b"\r\nO", "ok"), (b"\r\n1\r\n", "list"), (b"\r\n?A4 - x\r\n", "ok")],
)
def test_half_an_answer_is_a_time_out(said: bytes, kind: Kind) -> None:
    with pytest.raises(DeviceTimeout, match=r"no whole answer within 0 s"):
        asked(said, kind)


def test_a_time_out_tells_of_the_alarms_that_came_instead() -> None:
    with pytest.raises(DeviceTimeout, match=r"\(alarms: \?A6 - LEDs off\)"):
        asked(b"\r\n?A6 - LEDs off\r\n", "ok")


def test_a_loose_list_may_end_in_silence() -> None:
    assert asked(b"\r\nNONE\r\n", "loose list").rows == ("NONE",)
    assert [alarm.code for alarm in asked(b"\r\n?A3 - x\r\n?A5 - y\r\n", "loose list").alarms] == ["A3", "A5"]
    assert asked(b"\r\n\r\n", "loose list").rows == ()


@settings(deadline=None)
@given(st.binary(max_size=60), st.sampled_from(["ok", "value", "list", "loose list"]))
def test_random_bytes_are_never_accepted_silently(said: bytes, kind: Kind) -> None:
    try:
        answer = asked(said, kind)
    except DeviceError:
        return
    # What was accepted has the form of an answer: an acknowledgement, then the body.
    assert b"\r\n" in said
    lines = [line for line in said.split(b"\r\n") if not line.startswith(b"?A")]
    assert lines[0] == b""
    if kind == "ok" and answer.complaint is None:
        assert lines[1].lower() == b"ok"
    if answer.complaint is not None:
        assert lines[1].strip().startswith(b"?")
    assert all(row.isprintable() for row in answer.rows)


_PIECES = st.sampled_from(
    [b"\r\n", b"Ok", b"?20 - low", b"?A4 - lost", b"1.5", b"\r", b"\n", b"?", b"\xff", b"0D 00:00:01"]
)


@settings(deadline=None, max_examples=300)
@given(st.lists(_PIECES, max_size=10), st.sampled_from(["ok", "value", "list", "loose list"]))
def test_pieces_of_answers_in_disorder_end_in_an_answer_or_an_error(pieces: list[bytes], kind: Kind) -> None:
    said = b"".join(pieces)
    try:
        answer = asked(said, kind)
    except DeviceError:
        return
    first = next(line for line in said.split(b"\r\n") if not line.startswith(b"?A"))
    assert first == b""
    assert kind != "ok" or answer.rows == ()


def test_flood_of_alarms_and_endless_lists_end() -> None:
    with pytest.raises(UnexpectedAnswer, match="more than 1000 alarms"):
        asked(b"?A1 - x\r\n" * 1001)
    with pytest.raises(UnexpectedAnswer, match="more than 10000 rows"):
        asked(b"\r\n" + b"1\r\n" * 10_001, "list")


def test_in_step_again_after_old_answers() -> None:
    port = Scripted(b"\r\nOk\r\n\r\n1.5\r\n\r\nHX2855\r\n", b"\r\nOk\r\n")
    link = Link(port, "rs7", 1.0, 0.0)
    resynchronise(link, "rs7", "HX2855")
    assert ask(link, "rs7", "FBK 1", "ok", time.monotonic).complaint is None
    with pytest.raises((DeviceTimeout, UnexpectedAnswer)):
        resynchronise(Link(Scripted(b"\r\nHX9999\r\n"), "rs7", 0.0, 0.0), "rs7", "HX2855")


def stepped(*answers: bytes) -> list[bytes]:
    port = Scripted(*answers)
    step_to(Link(port, "rs7", 0.0, 0.0), "rs7", 1234.5, time.monotonic)
    return port.written


def test_a_level_is_asked_for_again_if_it_did_not_settle() -> None:
    ok, slow, lost = b"\r\nOk\r\n", b"\r\n?18 - not settled\r\n", b"\r\n?A4 - lost lock\r\nOk\r\n"
    assert stepped(ok) == [b"OUT 1234.5\r"]
    assert stepped(slow, lost, ok) == [b"OUT 1234.5\r"] * 3
    with pytest.raises(DeviceError, match=r"\?18 - not settled; allow more time"):
        stepped(slow, slow, slow, ok)
    with pytest.raises(DeviceError, match=r"\?A4 - lost lock"):
        stepped(lost, lost, lost, ok)


@pytest.mark.parametrize("code", ["02", "06", "07", "08", "09", "10", "16", "17", "20", "24"])
def test_what_cannot_be_done_is_refused(code: str) -> None:
    with pytest.raises(WrongState, match=rf"^rs7: OUT 1234.5: \?{code} - because; "):
        stepped(f"\r\n?{code} - because\r\n".encode())


@pytest.mark.parametrize(
    "said", [b"?A3 - x\r\n\r\nOk\r\n", b"\r\n?A6 - x\r\nOk\r\n", b"\r\n?A7 - x\r\nOk\r\n", b"\r\n?F1 - x\r\n"]
)
def test_a_light_that_is_wrong_stops_the_run(said: bytes) -> None:
    with pytest.raises(DeviceError, match="; stop the run"):
        stepped(said)


@pytest.mark.parametrize(
    ("line", "code", "text"),
    [
        ("?18 - settle timeout", "18", "settle timeout"),
        ("?2", "02", "an argument is out of range"),
        ("?A4 - feedback lock lost", "A4", "feedback lock lost"),
        ("?F1", "F1", "fault: the unit obeys nothing until it is cleared"),
        ("?77 - new in some firmware", "77", "new in some firmware"),
        ("?77", "77", "an error that the manual does not list"),
    ],
)
def test_codes(line: str, code: str, text: str) -> None:
    assert complaint_in(line) == Complaint(code, text)


@pytest.mark.parametrize("line", ["", "Ok", "18", "?", "?B1 - x", "?CH07 fail", "x ?18 - y", "?123 - z"])
def test_what_is_no_complaint(line: str) -> None:
    assert complaint_in(line) is None


def test_treatments() -> None:
    def codes(treatment: Treatment) -> set[str]:
        return {code for code, (how, _) in CODES.items() if how is treatment}

    assert codes(Treatment.RETRY) == {"18", "A4"}
    assert {"A3", "A6", "A7", "F1"} <= codes(Treatment.STOP)
    assert {"02", "06", "07", "08", "09", "10", "20", "24"} <= codes(Treatment.REFUSE)
    assert str(complaint_raised("rs7", "OUT 1", Complaint("77", "x"))).startswith("rs7: OUT 1: ?77 - x; is this")


@pytest.mark.parametrize(
    ("level", "text"), [(0.0, "0"), (20.0, "20"), (1e6, "1000000"), (123.456, "123.456"), (1e-5, "0.00001")]
)
def test_level_as_text(level: float, text: str) -> None:
    assert level_text(level) == text


@given(st.floats(1e-3, 1e6))
def test_no_level_is_rounded_away(level: float) -> None:
    assert float(level_text(level)) == pytest.approx(level, rel=1e-6)
    assert "e" not in level_text(level)


def answer(*rows: str) -> Answer:
    return Answer(rows, None, (), 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("text", "number"), [("1.034", 1.034), ("-8388608", -8388608.0), ("+.5", 0.5), ("1e3", 1000.0)]
)
def test_numbers(text: str, number: float) -> None:
    assert number_in("rs7", "OUT", answer(text)) == number


@pytest.mark.parametrize("text", ["", "Ok", "nan", "inf", "1_000", "1.0.0", "0x10", "1 2", "1e999"])
def test_what_is_no_number(text: str) -> None:
    with pytest.raises(UnexpectedAnswer, match="in place of a number"):
        number_in("rs7", "OUT", answer(text))


@pytest.mark.parametrize(
    ("text", "seconds"), [("0D 02:09:28.736", 7768.736), ("0D 00:00:00.000", 0.0), ("12D 23:59:59.5", 1123199.5)]
)
def test_uptime(text: str, seconds: float) -> None:
    assert uptime_in("rs7", "POT", answer(text)) == pytest.approx(seconds)


@pytest.mark.parametrize("text", ["", "1.5", "0D 2:9", "02:09:28.736", "-1D 02:09:28.736", "0D 02:09:28.736 x"])
def test_what_is_no_uptime(text: str) -> None:
    with pytest.raises(UnexpectedAnswer, match="in place of a time such as"):
        uptime_in("rs7", "POT", answer(text))


def test_spectrum() -> None:
    spectrum = spectrum_in("rs7", [f"{i}.5" for i in range(741)], "uW/cm2/nm/sr")
    assert (spectrum.wavelength_nm[0], spectrum.wavelength_nm[-1]) == (360.0, 1100.0)
    assert (spectrum.density[0], spectrum.density[-1]) == (0.5, 740.5)


@pytest.mark.parametrize(
    ("rows", "problem"),
    [(["1"] * 740, "740 values; expected 741"), (["1"] * 740 + ["x"], "x"), (["1"] * 740 + ["nan"], "741 finite")],
)
def test_what_is_no_spectrum(rows: list[str], problem: str) -> None:
    with pytest.raises(UnexpectedAnswer, match=problem):
        spectrum_in("rs7", rows, "uW/cm2/nm/sr")
