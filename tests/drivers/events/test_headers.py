"""The text at the start of a file, well formed and not."""

from __future__ import annotations

from hypothesis import example, given, settings
from hypothesis import strategies as st

from drivers.events.headers import parse_header
from protocols.errors import InputError

NEW_STYLE = b"""% camera_integrator_name Prophesee
% date 2026-01-02 03:04:05
% evt 3.0
% format EVT3;height=720;width=1280
% geometry 1280x720
% plugin_name hal_plugin_prophesee
% sensor_name IMX636
% serial_number 00051234
% end
"""

OLD_STYLE = b"""% Date 2020-01-02 03:04:05
% evt 2.0
% firmware_version 3.9.0
% integrator_name Prophesee
% serial_number 00001234
% system_ID 49
"""


def test_new_style() -> None:
    header = parse_header(NEW_STYLE + b"% not a line")
    assert header.data_offset == len(NEW_STYLE)
    assert (header.format, header.width, header.height) == ("EVT3", 1280, 720)
    assert header.fields["date"] == "2026-01-02 03:04:05"
    assert header.lines[0] == "camera_integrator_name Prophesee"
    assert len(header.lines) == 8


def test_old_style_ends_at_the_first_byte_that_is_no_line() -> None:
    header = parse_header(OLD_STYLE + b"\x25\x00\x0a")
    assert header.data_offset == len(OLD_STYLE)
    assert (header.format, header.width) == ("EVT2", None)
    assert header.fields["system_ID"] == "49"


def test_windows_line_ends() -> None:
    header = parse_header(NEW_STYLE.replace(b"\n", b"\r\n") + b"data")
    assert header.data_offset == len(NEW_STYLE) + 9
    assert (header.format, header.width) == ("EVT3", 1280)


def test_data_that_look_like_the_start_of_a_line() -> None:
    # 0x2025 is an event in column 0x25, and its bytes are "% ".
    assert parse_header(b"\x25\x20\x01\x02\x03\x0a").data_offset == 0
    assert parse_header(b"% no end of line").data_offset == 0
    assert parse_header(OLD_STYLE + b"\x25\x20\x00\x80\x0a").data_offset == len(OLD_STYLE)


def test_bytes_after_end_belong_to_the_data_whatever_they_are() -> None:
    assert parse_header(b"% evt 3.0\n% end\n% evt 2.0\n").data_offset == 16


header_like = st.lists(
    st.one_of(
        st.binary(max_size=20),
        st.builds(
            lambda key, value: f"% {key} {value}\n".encode(),
            st.sampled_from(["evt", "format", "geometry", "endianness", "Width", "Height", "end", "Date", ""]),
            st.one_of(
                st.text(max_size=12),
                st.sampled_from(["3.0", "2.1", "EVT3;height=1;width=2", "EVT21;=;;", "1280x720", "legacy", "640"]),
            ),
        ),
    ),
    max_size=8,
).map(b"".join)


@settings(max_examples=300, deadline=None)
@given(header_like)
@example(b"% ")
@example(b"% \n% \n")
@example("% geometry \u0661x\u0662\n".encode())
def test_any_bytes_give_a_header_or_one_clear_error(data: bytes) -> None:
    try:
        header = parse_header(data)
    except InputError as error:
        assert str(error).startswith("header: ")  # noqa: PT017 - either way out is fine
        return
    assert 0 <= header.data_offset <= len(data)
    assert data[: header.data_offset].count(b"\n") in (len(header.lines), len(header.lines) + 1)
    assert parse_header(data[: header.data_offset]).fields == header.fields
