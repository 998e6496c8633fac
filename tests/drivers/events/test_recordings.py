"""A real recording against what is known of it, and files of every format."""

from __future__ import annotations

import json
import struct
from typing import TYPE_CHECKING, Any

import pytest

from drivers.events.encode import raw_header
from drivers.events.raw import open_recording
from drivers.events.summary import summarise
from protocols.errors import InputError

if TYPE_CHECKING:
    from pathlib import Path

EVT3 = struct.pack("<4H", 0x8001, 0x6005, 0x0007, 0x2003)  # one event at 4101 us, x = 3, y = 7, OFF
EVT2 = struct.pack("<2I", 0x8 << 28 | 10, 1 << 28 | 5 << 22 | 3 << 11 | 7)  # 645 us, ON
EVT21 = struct.pack("<2Q", 0x8 << 60 | 10 << 32, 1 << 60 | 5 << 54 | 32 << 43 | 7 << 32 | 2)
EVT21_LEGACY = struct.pack("<4I", 0x8 << 28 | 10, 0, 1 << 28 | 5 << 22 | 32 << 11 | 7, 2)
CD_RECORD = struct.pack("<2I", 12, 3 | 7 << 14 | 1 << 28)


@pytest.fixture(scope="module")
def expected(request: pytest.FixtureRequest) -> dict[str, Any]:
    folder: Path = request.getfixturevalue("data_folder")
    loaded: dict[str, Any] = json.loads((folder / "recordings/gen31_640x480_triggers.expected.json").read_text())
    return loaded


@pytest.mark.parametrize("chunk_bytes", [1 << 20, 1000, pytest.param(7, marks=pytest.mark.slow)])
def test_real_recording_has_every_expected_figure(
    data_folder: Path, expected: dict[str, Any], chunk_bytes: int
) -> None:
    path = data_folder / "recordings/gen31_640x480_triggers.evt3"
    summary = summarise(path, chunk_bytes=chunk_bytes).to_dict()
    assert {key: summary[key] for key in expected} == expected
    assert not any(summary["violations"].values())


@pytest.mark.slow
def test_the_first_part_of_a_real_recording_has_the_same_figures_byte_by_byte(
    data_folder: Path, tmp_path: Path
) -> None:
    content = (data_folder / "recordings/gen31_640x480_triggers.evt3").read_bytes()
    path = tmp_path / "part.evt3"
    path.write_bytes(content[: len(content) // 8])
    at_once, byte_by_byte = (summarise(path, chunk_bytes=n).to_dict() for n in (1 << 20, 1))
    assert at_once["n_cd"] > 1000
    assert byte_by_byte == at_once


def test_rates_are_counts_over_the_time_of_the_events(data_folder: Path, expected: dict[str, Any]) -> None:
    summary = summarise(data_folder / "recordings/gen31_640x480_triggers.evt3").to_dict()
    seconds = (expected["t_max"] - expected["t_min"]) / 1e6
    assert summary["rates_hz"]["cd"] == pytest.approx(expected["n_cd"] / seconds)
    assert summary["rates_hz"]["trigger"] == pytest.approx(expected["n_trigger"] / seconds)


def test_summary_of_a_file_without_events(tmp_path: Path) -> None:
    path = tmp_path / "empty.evt3"
    path.write_bytes(b"")
    summary = summarise(path).to_dict()
    assert summary["sensor"] is None
    assert summary["t_first"] is None
    assert summary["n_cd"] == 0
    assert set(summary["rates_hz"].values()) == {None}


def test_steps_back_are_counted_across_chunks(tmp_path: Path) -> None:
    path = tmp_path / "back.evt3"
    words = [0x8001, 0x0007, *[word for low in (9, 8, 10, 7, 7) for word in (0x6000 | low, 0x2001)]]
    path.write_bytes(struct.pack(f"<{len(words)}H", *words))
    assert {summarise(path, chunk_bytes=n).tally.n_backward_steps for n in (1, 6, 100)} == {2}


DAT_HEADER = b"% Data file containing CD events\n% Version 2\n% Width 640\n% Height 480\n"
OLD_HEADER = b"% Date 2020-01-01 00:00:00\n% evt 2.0\n% system_ID 49\n"


@pytest.mark.parametrize(
    ("name", "data", "format_name", "size", "event"),
    [
        ("a.evt3", EVT3, "EVT3 (no header)", None, (4101, 3, 7, 0)),
        ("a.raw", raw_header(1280, 720) + EVT3, "EVT3", (1280, 720), (4101, 3, 7, 0)),
        ("a.raw", b"% evt 3.0\n" + EVT3, "EVT3", None, (4101, 3, 7, 0)),
        ("a.raw", OLD_HEADER + EVT2, "EVT2", None, (645, 3, 7, 1)),
        ("a.EVT2", EVT2, "EVT2 (no header)", None, (645, 3, 7, 1)),
        ("a.raw", b"% format EVT21;height=720;width=1280\n% end\n" + EVT21, "EVT2.1", (1280, 720), (645, 33, 7, 1)),
        ("a.raw", b"% evt 2.1\n% endianness legacy\n% end\n" + EVT21_LEGACY, "EVT2.1", None, (645, 33, 7, 1)),
        ("a.raw", b"% format EVT21;endianness=little\n% end\n" + EVT21, "EVT2.1", None, (645, 33, 7, 1)),
        ("a.evt21", EVT21 * 9, "EVT2.1 (no header)", None, (645, 33, 7, 1)),
        ("a.evt21", EVT21_LEGACY * 9, "EVT2.1 (no header)", None, (645, 33, 7, 1)),
        ("a.dat", DAT_HEADER + b"\x0c\x08" + CD_RECORD, "DAT", (640, 480), (12, 3, 7, 1)),
        ("a.dat", b"\x00\x08" + CD_RECORD, "DAT (no header)", None, (12, 3, 7, 1)),
    ],
)
def test_every_format_is_found(
    tmp_path: Path, name: str, data: bytes, format_name: str, size: tuple[int, int] | None, event: tuple[int, ...]
) -> None:
    path = tmp_path / name
    path.write_bytes(data)
    recording = open_recording(path, chunk_bytes=5)
    events = [event for chunk in recording.chunks() for event in chunk.events.tolist()]
    assert recording.format == format_name
    assert (recording.width, recording.height) == (size or (None, None))
    assert events[0] == event
    assert not any(n for kind, n in recording.violations.items() if kind != "time_high_backward")


def test_the_caller_may_say_the_format_and_the_size(tmp_path: Path) -> None:
    path = tmp_path / "words.bin"
    path.write_bytes(EVT21_LEGACY)
    recording = open_recording(path, format="evt2.1-legacy", width=40, height=8)
    assert [c.events.tolist() for c in recording.chunks()] == [[(645, 33, 7, 1)]]
    path.write_bytes(EVT3)
    recording = open_recording(path, format="EVT3", width=3, height=8)
    assert list(recording.chunks()) == []
    assert recording.violations["x_out_of_range"] == 1


def test_dat_triggers_are_read(tmp_path: Path) -> None:
    path = tmp_path / "a.dat"
    path.write_bytes(b"\x0e\x08" + struct.pack("<2I", 10, 1 | 6 << 26))
    (chunk,) = open_recording(path).chunks()
    assert chunk.triggers.tolist() == [(10, 1, 6)]


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("a.raw", EVT3, "neither by a header nor by its extension"),
        ("a.raw", b"% format HISTO3D\n% end\n", "format 'HISTO3D' is not known"),
        ("a.raw", b"% evt 4.0\n% end\n", "evt version '4.0' is not known"),
        ("a.raw", b"% evt 2.0\n% format EVT3\n% end\n", "contradicts itself: it names EVT2 and EVT3"),
        ("a.raw", b"% evt 3.0\n% geometry big\n% end\n", "geometry 'big' is not of the form"),
        ("a.raw", b"% format EVT3;height=x;width=9\n% end\n", "are '9' and 'x'; expected pixels"),
        ("a.raw", b"% evt 3.0\n% geometry 4096x2000\n% end\n", "expected 1 to 2048"),
        ("a.raw", b"% evt 3.0\n% geometry 0x0\n% end\n", "expected 1 to 2048"),
        ("a.raw", b"% evt 2.1\n% endianness big\n% end\n", "endianness 'big' is not known"),
        ("a.raw", b"% evt 2.1\n% end\n", "which half of a word comes first"),
        ("a.dat", b"\x28\x08", "type 0x28 with 8 bytes"),
        ("a.dat", b"\x0c\x10", "type 0x0C with 16 bytes"),
        ("a.dat", DAT_HEADER + b"\x0c", "ends ahead of its data"),
    ],
)
def test_what_cannot_be_read_is_said_in_one_line(tmp_path: Path, name: str, data: bytes, message: str) -> None:
    path = tmp_path / name
    path.write_bytes(data)
    with pytest.raises(InputError, match=message) as caught:
        open_recording(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_what_the_caller_asks_for_must_make_sense(tmp_path: Path) -> None:
    path = tmp_path / "a.evt3"
    with pytest.raises(InputError, match="cannot be read: No such file"):
        open_recording(path)
    path.write_bytes(EVT3)
    with pytest.raises(InputError, match="format 'EVT9' is not known"):
        open_recording(path, format="EVT9")
    with pytest.raises(InputError, match="width and height"):
        open_recording(path, width=640)
    with pytest.raises(InputError, match="width of the sensor is 0; expected 1 to 2048"):
        open_recording(path, width=0, height=0)
    with pytest.raises(InputError, match="chunks of 0 bytes"):
        open_recording(path, chunk_bytes=0)
