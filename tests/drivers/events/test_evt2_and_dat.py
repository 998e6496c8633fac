"""EVT2, EVT2.1 in both orders of its halves, and DAT, against words put together by hand from their fields."""

from __future__ import annotations

import struct
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.events.decoders import DatDecoder, Decoder, ErcCounts, Evt2Decoder, Evt21Decoder

if TYPE_CHECKING:
    from collections.abc import Callable


def found(decoder: Decoder) -> dict[str, int]:
    return {name: n for name, n in decoder.violations.items() if n}


# EVT2: type 31:28, time 27:22, x 21:11, y 10:0; TIME_HIGH 27:0 in 64 us; trigger channel 12:8, edge 0.


def cd2(p: int, low: int, x: int, y: int) -> int:
    return p << 28 | low << 22 | x << 11 | y


def high2(high: int) -> int:
    return 0x8 << 28 | high


def trigger2(low: int, channel: int, edge: int) -> int:
    return 0xA << 28 | low << 22 | channel << 8 | edge


def feed2(decoder: Evt2Decoder, *words: int) -> tuple[list[tuple[int, ...]], list[tuple[int, ...]]]:
    chunk = decoder.feed(struct.pack(f"<{len(words)}I", *words))
    return chunk.events.tolist(), chunk.triggers.tolist()


def test_evt2_by_the_bytes() -> None:
    # TIME_HIGH 0x0000010 -> 0x400 us; ON, time 5, x = 0x123, y = 0x045: 0x1 | 000101 | 00100100011 | 00001000101
    data = bytes.fromhex("10000080") + bytes([0x45, 0x18, 0x49, 0x11])
    assert Evt2Decoder(640, 480).feed(data).events.tolist() == [(0x405, 0x123, 0x45, 1)]


def test_evt2_events_and_triggers() -> None:
    decoder = Evt2Decoder(640, 480)
    events, triggers = feed2(
        decoder, high2(100), cd2(1, 5, 639, 479), cd2(0, 63, 0, 0), trigger2(7, 31, 1), trigger2(8, 6, 0)
    )
    assert events == [(6405, 639, 479, 1), (6463, 0, 0, 0)]
    assert triggers == [(6407, 1, 31), (6408, 0, 6)]
    assert decoder.word_types == {0: 1, 1: 1, 8: 1, 0xA: 2}
    assert found(decoder) == {}


def test_evt2_rolls_over_at_34_bits() -> None:
    decoder = Evt2Decoder()
    events, _ = feed2(decoder, high2(0xFFFFFFF), cd2(1, 63, 1, 1), high2(0), cd2(1, 0, 1, 1))
    assert [e[0] for e in events] == [(1 << 34) - 1, 1 << 34]
    assert found(decoder) == {}


def test_evt2_violations() -> None:
    decoder = Evt2Decoder(640, 480)
    events, triggers = feed2(
        decoder,
        *(cd2(1, 5, 1, 1), trigger2(0, 0, 0)),
        *(high2(10), high2(9), cd2(0, 0, 640, 0), cd2(0, 0, 0, 480)),
        *(0x2 << 28, 0xF << 28, 0xE << 28 | 0x14, 0xF << 28, 0xF << 28, 0xFFFFFFFF),
        *(high2(9), 0xF << 28),
    )
    decoder.feed(b"abc")
    decoder.finish()
    assert (events, triggers) == ([], [])
    assert found(decoder) == {
        "before_time_high": 2,
        "time_high_backward": 1,
        "x_out_of_range": 1,
        "y_out_of_range": 1,
        "reserved_type": 1,
        "orphan_continued": 2,
        "torn_word": 1,
    }


# EVT2.1: type 63:60, time 59:54, x 53:43, y 42:32, valid 31:0; TIME_HIGH 59:32; trigger channel 44:40, edge 32;
# OTHERS subtype 47:32, payload 31:0. In the legacy order the 32-bit half with the type comes first.


def cd21(p: int, low: int, x: int, y: int, valid: int) -> int:
    return p << 60 | low << 54 | x << 43 | y << 32 | valid


def high21(high: int) -> int:
    return 0x8 << 60 | high << 32


def pack21(words: tuple[int, ...], legacy: bool) -> bytes:
    if legacy:
        return b"".join(struct.pack("<II", word >> 32, word & 0xFFFFFFFF) for word in words)
    return struct.pack(f"<{len(words)}Q", *words)


def test_evt21_half_orders_as_documented() -> None:
    # 0x0102030405060708 goes as 04030201 08070605 in the legacy order, and as 0807060504030201 in the standard one.
    word = (0x0102030405060708,)
    assert pack21(word, legacy=True) == bytes.fromhex("0403020108070605")
    assert pack21(word, legacy=False) == bytes.fromhex("0807060504030201")


@pytest.mark.parametrize("legacy", [False, True])
def test_evt21_events_and_triggers(legacy: bool) -> None:
    decoder = Evt21Decoder(1280, 720, legacy=legacy)
    trigger = 0xA << 60 | 9 << 54 | 3 << 40 | 1 << 32
    words = (high21(100), cd21(1, 5, 1248, 719, 0x80000011), cd21(0, 63, 0, 0, 0), cd21(0, 63, 32, 2, 2), trigger)
    chunk = decoder.feed(pack21(words, legacy))
    assert chunk.events.tolist() == [(6405, x, 719, 1) for x in (1248, 1252, 1279)] + [(6463, 33, 2, 0)]
    assert chunk.triggers.tolist() == [(6409, 1, 3)]
    assert decoder.word_types == {0: 2, 1: 1, 8: 1, 0xA: 1}
    assert found(decoder) == {}


@pytest.mark.parametrize("legacy", [False, True])
def test_evt21_rollover_and_rate_controller(legacy: bool) -> None:
    decoder = Evt21Decoder(legacy=legacy)
    before = 0xE << 60 | 0x14 << 32 | 0xFFFFFFFF
    after = 0xE << 60 | 0x16 << 32 | 17
    words = (high21(0xFFFFFFF), cd21(1, 63, 0, 0, 1), high21(0), cd21(1, 0, 0, 0, 1), before, after, 0xF << 60)
    events = decoder.feed(pack21(words, legacy)).events
    assert events["t"].tolist() == [(1 << 34) - 1, 1 << 34]
    assert decoder.erc_counts == ErcCounts(1, 0xFFFFFFFF, 1, 17)
    assert found(decoder) == {}


def test_evt21_violations() -> None:
    decoder = Evt21Decoder(1270, 720)
    words = (
        cd21(1, 0, 0, 0, 7),
        high21(5),
        high21(4),
        cd21(1, 0, 1248, 0, 0xFFFFFFFF),
        cd21(1, 0, 0, 720, 0xF),
        cd21(1, 0, 33, 0, 1),
        0x3 << 60,
        0xF << 60,
    )
    events = decoder.feed(pack21(words, legacy=False)).events
    assert events["x"].tolist() == [*range(1248, 1270), 33]
    assert found(decoder) == {
        "before_time_high": 1,
        "time_high_backward": 1,
        "x_out_of_range": 10,
        "y_out_of_range": 4,
        "invalid_vector_base": 1,
        "reserved_type": 1,
        "orphan_continued": 1,
    }


# DAT: u32 time in us; u32 with x 13:0, y 27:14, p 28. Triggers: u32 time; u32 with edge 3:0, channel 31:26.


def test_dat_events_and_rollover() -> None:
    decoder = DatDecoder(640, 480)
    records = (
        *(0xFFFFFFF0, 639 | 479 << 14 | 1 << 28),
        *(5, 1 | 2 << 14),
        *(4, 640),
        *(6, 480 << 14),
    )
    chunk = decoder.feed(struct.pack("<8I", *records))
    assert chunk.events.tolist() == [(0xFFFFFFF0, 639, 479, 1), (2**32 + 5, 1, 2, 0)]
    assert len(chunk.triggers) == 0
    assert decoder.word_types == {}
    assert found(decoder) == {"time_backward": 1, "x_out_of_range": 1, "y_out_of_range": 1}


def test_dat_triggers() -> None:
    decoder = DatDecoder(triggers=True)
    chunk = decoder.feed(struct.pack("<4I", 10, 1 | 6 << 26, 11, 0 | 63 << 26))
    assert chunk.triggers.tolist() == [(10, 1, 6), (11, 0, 63)]
    assert len(chunk.events) == 0


FACTORIES: dict[str, Callable[[], Decoder]] = {
    "evt2": lambda: Evt2Decoder(640, 480),
    "evt21": lambda: Evt21Decoder(640, 480),
    "evt21 legacy": lambda: Evt21Decoder(640, 480, legacy=True),
    "dat": lambda: DatDecoder(640, 480),
    "dat triggers": lambda: DatDecoder(triggers=True),
}


def run(make: Callable[[], Decoder], data: bytes, cuts: list[int]) -> tuple[object, ...]:
    decoder = make()
    places = [0, *sorted(min(cut, len(data)) for cut in cuts), len(data)]
    chunks = [decoder.feed(data[a:b]) for a, b in pairwise(places)]
    decoder.finish()
    events = b"".join(c.events.tobytes() for c in chunks)
    triggers = b"".join(c.triggers.tobytes() for c in chunks)
    inside = all(np.all(c.events["x"] < 640) and np.all(c.events["y"] < 480) for c in chunks)
    return events, triggers, inside, decoder.violations, decoder.word_types, decoder.erc_counts


@pytest.mark.parametrize("name", FACTORIES)
@settings(max_examples=100, deadline=None)
@given(st.binary(max_size=600), st.lists(st.integers(0, 600), max_size=6))
def test_random_bytes_never_crash_and_any_cut_gives_the_same(name: str, data: bytes, cuts: list[int]) -> None:
    whole = run(FACTORIES[name], data, [])
    assert whole[2]
    assert run(FACTORIES[name], data, cuts) == whole
    assert run(FACTORIES[name], data, list(range(len(data)))) == whole
