"""EVT3 against another implementation: the package `evt3`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import evt3
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.events.decoders import Evt3Decoder
from drivers.events.encode import raw_header

if TYPE_CHECKING:
    from pathlib import Path

WIDTH, HEIGHT = 1280, 720


def words_of(seed: int, groups: int) -> list[int]:
    """Draw a stream that a sensor could send.

    The package takes another view than we do of what a sensor does not do, so it is left out here: a TIME_HIGH
    without a TIME_LOW after it, or one that skips far at a rollover; words ahead of the first TIME_HIGH.
    """
    rng = np.random.default_rng(seed)
    high = int(rng.integers(4050, 4096))
    words = [0x8000 | high, 0x6000 | int(rng.integers(4096)), int(rng.integers(HEIGHT)), 0x3000]
    vectors_left = WIDTH // 32

    for _ in range(groups):
        kind = rng.integers(7)
        value = int(rng.integers(4096))
        polarity = int(rng.integers(2)) << 11
        if kind == 0:
            high = (high + int(rng.integers(3))) & 0xFFF
            words += [0x8000 | high, 0x6000 | value]
        elif kind == 1:
            words.append(int(rng.integers(HEIGHT)) | polarity)
        elif kind == 2:
            words.append(0x2000 | polarity | int(rng.integers(WIDTH)))
        elif kind == 3:
            block = int(rng.integers(WIDTH // 32))
            vectors_left = WIDTH // 32 - block
            words.append(0x3000 | polarity | block * 32)
        elif kind == 4 and vectors_left:
            words += [0x4000 | value, 0x4000 | int(rng.integers(4096)), 0x5000 | int(rng.integers(256))]
            vectors_left -= 1
        elif kind == 5:
            words.append(0xA000 | value)
        elif kind == 6:
            words += [0xE014, 0xF000 | value, 0xF000 | value, 0x7000 | value & 0xF]
    return words


@settings(max_examples=300, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 400))
def test_same_events_as_the_package(seed: int, groups: int) -> None:
    data = np.array(words_of(seed, groups), "<u2").tobytes()
    decoder = Evt3Decoder(WIDTH, HEIGHT)
    ours = decoder.feed(data).events
    theirs = evt3.decode_bytes(data, WIDTH, HEIGHT)
    for name, values in (("t", theirs.timestamp), ("x", theirs.x), ("y", theirs.y), ("p", theirs.polarity)):
        np.testing.assert_array_equal(ours[name], values)
    ignored = ("time_high_gap",)
    assert not any(n for name, n in decoder.violations.items() if name not in ignored)


@pytest.mark.parametrize("seed", range(3))
def test_same_triggers_as_the_package(seed: int, tmp_path: Path) -> None:
    data = np.array(words_of(seed, 2000), "<u2").tobytes()
    path = tmp_path / "stream.raw"
    path.write_bytes(raw_header(WIDTH, HEIGHT) + data)
    ours = Evt3Decoder(WIDTH, HEIGHT).feed(data).triggers
    _, theirs = evt3.decode_file_with_triggers(str(path))
    assert len(ours) > 100
    for name, values in (("t", theirs.timestamp), ("p", theirs.value), ("id", theirs.id)):
        np.testing.assert_array_equal(ours[name], values)


def test_same_events_of_a_real_sensor(data_folder: Path) -> None:
    data = (data_folder / "recordings/gen31_640x480_triggers.evt3").read_bytes()
    ours = Evt3Decoder(640, 480).feed(data).events
    theirs = evt3.decode_bytes(data, 640, 480)
    for name, values in (("t", theirs.timestamp), ("x", theirs.x), ("y", theirs.y), ("p", theirs.polarity)):
        np.testing.assert_array_equal(ours[name], values)
