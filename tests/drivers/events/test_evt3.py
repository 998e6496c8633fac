"""EVT3 against words written by hand, rule by rule, and against any cut of the stream."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.events.decoders import ErcCounts, Evt3Decoder
from drivers.events.types import EVENT_DTYPE, TRIGGER_DTYPE

if TYPE_CHECKING:
    import numpy.typing as npt

START = [0x8001, 0x6005, 0x0007]  # TIME_HIGH 1, TIME_LOW 5, row 7
T = 4096 + 5


def as_bytes(words: list[int]) -> bytes:
    return np.array(words, "<u2").tobytes()


def decode(
    words: list[int], width: int | None = 1280, height: int | None = 720
) -> tuple[list[tuple[int, ...]], list[tuple[int, ...]], dict[str, int]]:
    """Return events (t, x, y, p), triggers (t, p, id) and the violations that were found."""
    decoder = Evt3Decoder(width, height)
    chunk = decoder.feed(as_bytes(words))
    decoder.finish()
    assert chunk.events.dtype == EVENT_DTYPE
    assert chunk.triggers.dtype == TRIGGER_DTYPE
    found = {name: n for name, n in decoder.violations.items() if n}
    return chunk.events.tolist(), chunk.triggers.tolist(), found


def test_single_events() -> None:
    events, triggers, found = decode([*START, 0x2003, 0x2804, 0x6009, 0x0FD0 & 0x7FF | 0x800 & 0, 0x24FF])
    assert events == [(T, 3, 7, 0), (T, 4, 7, 1)]  # the third is in row 0x7D0 = 2000, outside
    assert triggers == []
    assert found == {"y_out_of_range": 1}


def test_the_camera_bit_of_addr_y_is_no_part_of_the_row() -> None:
    events, _, found = decode([0x8001, 0x0807, 0x2003])
    assert events == [(4096, 3, 7, 0)]
    assert found == {}


def test_triple_of_vectors_takes_polarity_from_the_base_and_moves_it_by_32() -> None:
    triple = [0x4801, 0x4001, 0x5081]
    events, _, found = decode([*START, 0x3840, *triple, *triple])
    columns = [64, 75, 76, 88, 95]
    assert events == [(T, x, 7, 1) for x in columns + [x + 32 for x in columns]]
    assert found == {}


def test_addr_x_does_not_move_the_vector_base() -> None:
    events, _, _ = decode([*START, 0x3040, 0x2BFF & 0x2AFF, 0x4001, 0x4000, 0x5000])
    assert events == [(T, 0x2FF, 7, 1), (T, 64, 7, 0)]


def test_time_low_is_zero_after_a_new_time_high_and_stays_after_a_repeated_one() -> None:
    events, _, found = decode([*START, 0x8001, 0x2001, 0x8002, 0x2002, 0x6010, 0x8002, 0x2003])
    assert [e[0] for e in events] == [T, 8192, 8192 + 16]
    assert found == {}


def test_time_low_may_go_back_and_is_not_held() -> None:
    events, _, found = decode([0x8001, 0x0007, 0x6000 | 811, 0x2001, 0x6000 | 800, 0x2002])
    assert [e[0] for e in events] == [4096 + 811, 4096 + 800]
    assert found == {}


def test_rollover_after_16_777216_s() -> None:
    events, _, found = decode([0x8FFF, 0x6FFF, 0x0007, 0x2001, 0x8000, 0x2002, 0x8001, 0x2003])
    assert [e[0] for e in events] == [(1 << 24) - 1, 1 << 24, (1 << 24) + 4096]
    assert found == {}


def test_rollover_needs_half_the_range() -> None:
    def times(high: int) -> tuple[list[int], dict[str, int]]:
        events, _, found = decode([0x8000 | 0x900, 0x0007, 0x8000 | high, 0x2001])
        return [e[0] for e in events], found

    assert times(0x100) == ([1 << 24 | 0x100 << 12], {"time_high_gap": 1})
    assert times(0x101) == ([0x101 << 12], {"time_high_backward": 1})


def test_time_high_that_skips_is_counted() -> None:
    assert decode([0x8001, 0x8002, 0x8004])[2] == {"time_high_gap": 1}
    assert decode([0x8FFE, 0x8000])[2] == {"time_high_gap": 1}
    assert decode([0x8FFF, 0x8000])[2] == {}


def test_before_the_first_time_high_row_and_base_are_kept_but_nothing_is_an_event() -> None:
    early = [0x0007, 0x2001, 0x3820, 0x4001, 0x4000, 0x5000, 0xA001, 0x6123]
    events, triggers, found = decode([*early, 0x8001, 0x2002, 0x4001, 0x4000, 0x5000])
    assert events == [(4096, 2, 7, 0), (4096, 64, 7, 1)]
    assert triggers == []
    assert found == {"before_time_high": 8}


def test_triggers_have_time_edge_and_channel() -> None:
    _, triggers, found = decode([0x8001, 0x6005, 0xA601, 0x6006, 0xA600, 0xAF01])
    assert triggers == [(T, 1, 6), (T + 1, 0, 6), (T + 1, 1, 15)]
    assert found == {}


def test_events_of_the_rate_controller() -> None:
    decoder = Evt3Decoder(1280, 720)
    before = [0xE014, 0xF345, 0xF012, 0x7006]
    after = [0xE016, 0xF001, 0xF000, 0x7000]
    decoder.feed(as_bytes([0x8001, *before, *before, *after]))
    value = 0x6 << 24 | 0x012 << 12 | 0x345
    assert decoder.erc_counts == ErcCounts(2, 2 * value, 1, 1)
    assert not any(decoder.violations.values())


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ([0x8001, 0x2001], {"missing_addr_y": 1}),
        ([0x8001, 0x3000, 0x4003, 0x4000, 0x5001], {"missing_addr_y": 3}),
        ([*START, 0x4001, 0x4000, 0x5000], {"missing_vector_base": 3}),
        ([*START, 0x2000 | 1280], {"x_out_of_range": 1}),
        ([0x8001, 720, 0x3000, 0x4FFF, 0x4000, 0x5000], {"y_out_of_range": 12}),
        ([*START, 0x3000 | 1264, 0x4FFF, 0x4FFF, 0x50FF], {"invalid_vector_base": 1, "x_out_of_range": 16}),
        ([*START, 0x3000, 0x4001, 0x2001], {"partial_vector": 1}),
        ([*START, 0x3000, 0x4001, 0x4001, 0x2001], {"partial_vector": 1}),
        ([*START, 0x3000, 0x4001, 0x4001], {"partial_vector": 1}),
        ([*START, 0x3000, 0x4001, 0x5001], {"partial_vector": 1}),
        ([*START, 0x3000, 0x5001], {"partial_vector": 1}),
        ([*START, 0x3000, 0x4001, 0x4001, 0x4001, 0x4001, 0x5001], {"partial_vector": 1}),
        ([0x8001, 0xE014, 0xF000, 0x8001], {"partial_continued": 1}),
        ([0x8001, 0xE014, 0xF000, 0xF000], {"partial_continued": 1}),
        ([0x8001, 0xE014, 0xF000, 0xF000, 0xF000], {"partial_continued": 1, "orphan_continued": 1}),
        ([0x8001, 0xE019, 0xF000, 0xF000, 0x8001], {}),
        ([0x8001, 0xF000, 0x7000], {"orphan_continued": 2}),
        ([0x8001, 0x1000, 0x9000, 0xB000, 0xC000], {"reserved_type": 4}),
        ([0x8001, 0xD000], {}),
    ],
)
def test_violations(words: list[int], expected: dict[str, int]) -> None:
    assert decode(words)[2] == expected


def test_incomplete_vectors_still_give_their_events() -> None:
    events, _, _ = decode([*START, 0x3000 | 1264, 0x4001, 0x4010, 0x5001, 0x3020, 0x4001, 0x2005, 0x4001])
    assert [e[1] for e in events] == [1264, 32, 5, 44]  # columns 1280 and 1288 are outside


def test_without_a_size_only_the_fields_limit() -> None:
    events, _, found = decode([0x8001, 0x07FF, 0x27FF], None, None)
    assert events == [(4096, 2047, 2047, 0)]
    assert found == {}


def test_a_torn_last_word_is_counted() -> None:
    decoder = Evt3Decoder()
    decoder.feed(as_bytes(START) + b"\x01")
    assert decoder.violations["torn_word"] == 0
    decoder.finish()
    decoder.finish()
    assert decoder.violations["torn_word"] == 1


def test_word_types_are_counted() -> None:
    decoder = Evt3Decoder()
    decoder.feed(as_bytes([*START, 0x2001, 0x2002, 0xB000]))
    assert decoder.word_types == {0x0: 1, 0x2: 2, 0x6: 1, 0x8: 1, 0xB: 1}


@pytest.mark.parametrize("size", [(0, 10), (2049, 10), (10, 2049)])
def test_a_size_that_the_format_cannot_hold_is_refused(size: tuple[int, int]) -> None:
    with pytest.raises(ValueError, match="expected 1 to 2048"):
        Evt3Decoder(*size)


@pytest.mark.parametrize("kind", ["bytearray", "memoryview", "array", "words", "unaligned"])
def test_any_buffer_is_taken(kind: str) -> None:
    data = as_bytes([*START, 0x2003])
    buffers = {
        "bytearray": bytearray(data),
        "memoryview": memoryview(data),
        "array": np.frombuffer(data, np.uint8),
        "words": np.frombuffer(data, "<u2"),
        "unaligned": memoryview(b"x" + data)[1:],
    }
    assert Evt3Decoder().feed(buffers[kind]).events.tolist() == [(T, 3, 7, 0)]  # type: ignore[arg-type]


def run(data: bytes, cuts: list[int]) -> tuple[bytes, bytes, dict[str, int], dict[int, int], ErcCounts]:
    """Return all that comes out when the stream is fed in pieces."""
    decoder = Evt3Decoder(640, 480)
    places = [0, *sorted(min(cut, len(data)) for cut in cuts), len(data)]
    chunks = [decoder.feed(data[a:b]) for a, b in pairwise(places)]
    decoder.finish()
    events = b"".join(c.events.tobytes() for c in chunks)
    triggers = b"".join(c.triggers.tobytes() for c in chunks)
    return events, triggers, decoder.violations, decoder.word_types, decoder.erc_counts


#: Words that lead deep into the rules, more often than words drawn evenly do.
likely_words = st.one_of(
    st.integers(0, 0xFFFF),
    st.integers(0x8000, 0x8003),
    st.integers(0x0000, 0x0200),
    st.integers(0x3000, 0x3290),
    st.integers(0x4000, 0x4FFF),
    st.integers(0x5000, 0x5FFF),
    st.sampled_from([0xE014, 0xE016, 0xE019]),
    st.integers(0xF000, 0xFFFF),
    st.integers(0x7000, 0x7FFF),
)
streams = st.tuples(st.lists(likely_words, max_size=80), st.binary(max_size=1)).map(lambda s: as_bytes(s[0]) + s[1])


@settings(max_examples=400, deadline=None)
@given(streams, st.lists(st.integers(0, 161), max_size=8))
def test_any_cut_gives_the_same(data: bytes, cuts: list[int]) -> None:
    assert run(data, cuts) == run(data, [])


@settings(max_examples=100, deadline=None)
@given(streams)
def test_single_bytes_give_the_same(data: bytes) -> None:
    assert run(data, list(range(len(data)))) == run(data, [])


@settings(max_examples=300, deadline=None)
@given(st.binary(max_size=2000), st.integers(1, 2048), st.integers(1, 2048))
def test_random_bytes_never_crash_and_stay_inside(data: bytes, width: int, height: int) -> None:
    decoder = Evt3Decoder(width, height)
    events: npt.NDArray[np.void] = decoder.feed(data).events
    decoder.finish()
    assert np.all(events["x"] < width)
    assert np.all(events["y"] < height)
    assert np.all(events["p"] <= 1)
    assert sum(decoder.word_types.values()) == len(data) // 2
    assert decoder.violations["torn_word"] == len(data) % 2
