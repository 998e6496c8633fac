"""The lines of the LED driver: documented ones, and random bytes."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.light.led_program import Program, program_of
from drivers.light.led_protocol import (
    LONGEST_LINE,
    DeviceFacts,
    Reply,
    crc16,
    encode_line,
    encode_program,
    parse_facts,
    parse_reply,
    text_of_line,
)
from tests.drivers.light.led_waveforms import waveform


def test_checksum_is_the_published_one() -> None:
    """CRC-16/CCITT-FALSE has the check value 0x29B1 for the digits 1 to 9."""
    assert crc16(b"123456789") == 0x29B1
    assert crc16(b"") == 0xFFFF


def test_a_request_is_as_documented() -> None:
    assert encode_line("1 hello") == b"1 hello*E648\n"
    assert text_of_line(b"1 hello*E648") == "1 hello"


@pytest.mark.parametrize("line", [b"1 hello*E649", b"1 hello*e648", b"1 hello", b"*FFFF", b"", b"2 hello*E648"])
def test_a_line_that_was_damaged_is_noticed(line: bytes) -> None:
    with pytest.raises(ValueError, match=r"checksum|text"):
        text_of_line(line)


@given(st.text(st.characters(min_codepoint=32, max_codepoint=126), min_size=1))
def test_every_text_comes_back(text: str) -> None:
    assert text_of_line(encode_line(text)[:-1]) == text


@given(st.binary(max_size=60), st.booleans())
def test_random_bytes_are_refused(data: bytes, summed: bool) -> None:
    line = data + b"*%04X" % crc16(data) if summed else data
    try:
        reply = parse_reply(line)
    except ValueError:
        return
    assert summed
    assert reply.kind


@given(st.integers(0, 9), st.integers(0, 255), st.data())
def test_a_changed_byte_is_noticed(number: int, byte: int, data: st.DataObject) -> None:
    line = encode_line(f"{number} ok 1234")[:-1]
    at = data.draw(st.integers(0, len(line) - 1))
    changed = line[:at] + bytes([byte]) + line[at + 1 :]
    if changed != line:
        with pytest.raises(ValueError, match=r"checksum|text"):
            parse_reply(changed)


@pytest.mark.parametrize(
    ("text", "reply"),
    [
        ("7 ok", Reply(7, "ok", ())),
        ("7 ok 1234", Reply(7, "ok", ("1234",))),
        ("12 done 40 3", Reply(12, "done", ("40", "3"))),
        ("3 error 4 out of range", Reply(3, "error", ("4", "out", "of", "range"))),
        ("? error 1 garbled", Reply(None, "error", ("1", "garbled"))),
        ("! boot evs-led", Reply(None, "boot", ("evs-led",))),
        ("! watchdog", Reply(None, "watchdog", ())),
    ],
)
def test_documented_answers(text: str, reply: Reply) -> None:
    assert parse_reply(encode_line(text)[:-1]) == reply


@pytest.mark.parametrize("text", ["7", "x ok", "7 okay", "? ok", "!", "-1 ok"])
def test_other_answers_make_no_sense(text: str) -> None:
    with pytest.raises(ValueError, match="no reply"):
        parse_reply(encode_line(text)[:-1])


HELLO = "evs-led protocol=1 firmware=1.0 serial=A7 tick_us=1 dac_bits=16 max_edges=4096 shortest_us=20"


def test_hello_is_understood() -> None:
    assert parse_facts(tuple(HELLO.split())) == DeviceFacts(1, "1.0", "A7", 1, 16, 4096, 20)


@pytest.mark.parametrize("missing", ["serial", "tick_us", "max_edges"])
def test_hello_must_be_whole(missing: str) -> None:
    words = tuple(word for word in HELLO.split() if not word.startswith(missing))
    with pytest.raises(ValueError, match=f"does not tell its {missing}"):
        parse_facts(words)


@pytest.mark.parametrize("bad", [HELLO.replace("=4096", "=many"), HELLO.replace("tick_us=1", "tick_us=0")])
def test_hello_must_make_sense(bad: str) -> None:
    with pytest.raises(ValueError, match=r"invalid literal|below 1"):
        parse_facts(tuple(bad.split()))


def requests(program: Program) -> list[str]:
    return list(encode_program(program))


def test_a_waveform_is_stored_as_documented() -> None:
    steps = waveform([0, 1000, 3000], [10, 20, 5], 4000)
    assert requests(program_of(steps, tick_us=1, max_edges=8, shortest_us=20)) == [
        "wave 10 2 0 2 1 1000",
        "edges 0 1000:20 2000:5",
    ]


def test_a_square_wave_is_one_request() -> None:
    edges = [0, *(500 + 100 * n + more for n in range(50) for more in (0, 30))]
    square = waveform(edges, [10, *([20, 10] * 50)], 5500)
    assert requests(program_of(square, tick_us=1, max_edges=8, shortest_us=20)) == ["square 10 20 100 30 50 500"]


def test_no_line_is_too_long() -> None:
    times = [0, *(2_000_000_000 * n for n in (1, 2))]
    longest = [(2_000_000_000 - n, 65535) for n in range(100)]
    program = program_of(waveform(times, [65535] * 3, times[-1]), tick_us=1, max_edges=8, shortest_us=20)
    program = Program(65535, longest, 0, 100, 1, 0, program.t_us, program.duration_us)
    lines = [encode_line(f"10000 {text}") for text in encode_program(program)]
    assert max(len(line) for line in lines) <= LONGEST_LINE
    assert sum(line.count(b":") for line in lines) == 100
