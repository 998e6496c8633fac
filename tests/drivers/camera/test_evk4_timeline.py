"""From words to events on the time axis of a recording, and what is missing from it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.camera.evk4.spool import Lost
from drivers.camera.evk4.timeline import Timeline

ROW_7 = 0x0007
COLUMN_9_ON = 0x2809
TRIGGER = 0xA001


def high(step: int) -> int:
    return 0x8000 | step & 0xFFF


def low(us: int) -> int:
    return 0x6000 | us


def words(*values: int) -> bytes:
    return np.array(values, "<u2").tobytes()


def times(timeline: Timeline, data: bytes) -> list[int]:
    return [int(t) for chunk in timeline.feed(data) for t in chunk.events["t"]]


def test_time_begins_with_the_first_step_wherever_the_camera_counts() -> None:
    for first in (0, 17, 4095):
        timeline = Timeline(1280, 720)
        data = words(high(first), ROW_7, low(5), COLUMN_9_ON, high(first + 1), low(6), COLUMN_9_ON)
        assert times(timeline, data) == [5, 4096 + 6]
        timeline.finish(0.008, 0.02)
        assert (timeline.violations, timeline.overflows, timeline.gaps_us) == (0, 0, [])


def test_time_goes_on_after_the_count_begins_anew() -> None:
    timeline = Timeline(1280, 720)
    times(timeline, words(high(0), ROW_7))
    last = []
    for begin in range(1, 10_000, 1000):
        last = times(
            timeline, words(*(w for s in range(begin, begin + 1000) for w in (high(s), low(3), COLUMN_9_ON)))
        )
    assert last[-1] == 10_000 * 4096 + 3
    timeline.finish(40.96, 0.02)
    assert (timeline.violations, timeline.overflows, timeline.gaps_us) == (0, 0, [])


def test_words_before_the_first_step_are_counted() -> None:
    timeline = Timeline(1280, 720)
    assert times(timeline, words(ROW_7, COLUMN_9_ON, high(3), ROW_7, COLUMN_9_ON)) == [0]
    assert timeline.violations == 2


def test_a_step_that_is_left_out_is_an_overflow_and_a_gap() -> None:
    timeline = Timeline(1280, 720)
    before = words(high(2), ROW_7, low(8), COLUMN_9_ON)
    after = words(high(5), low(1), COLUMN_9_ON, ROW_7, COLUMN_9_ON)
    # The row of the first event after the gap is not known: what was sent of it was lost.
    assert times(timeline, before + after) == [8, 3 * 4096 + 1]
    timeline.finish(0.016, 0.02)
    assert timeline.overflows == 1
    assert timeline.gaps_us == [(0, 3 * 4096)]
    assert timeline.violations == 1


def test_a_count_that_goes_back_is_counted() -> None:
    timeline = Timeline(1280, 720)
    times(timeline, words(high(9), high(10), high(7), ROW_7))
    assert (timeline.violations, timeline.overflows) == (1, 0)


@pytest.mark.parametrize("lost_bytes", [10, 11])
def test_after_dropped_transfers_it_goes_on_at_the_next_step(lost_bytes: int) -> None:
    timeline = Timeline(1280, 720)
    assert times(timeline, words(high(0), ROW_7, COLUMN_9_ON)) == [0]
    timeline.lose(Lost(1, lost_bytes, 0.0))
    after = words(COLUMN_9_ON, COLUMN_9_ON, high(1), COLUMN_9_ON, ROW_7, low(2), COLUMN_9_ON)
    assert times(timeline, b"\x80" * (lost_bytes % 2) + after) == [4096 + 2]
    assert timeline.gaps_us == [(0, 2 * 4096)]
    assert timeline.overflows == 0


def test_dropped_transfers_that_lasted_longer_than_the_count_are_placed_by_the_clock() -> None:
    timeline = Timeline(1280, 720)
    times(timeline, words(high(0)))
    timeline.lose(Lost(100, 1000, 40.0))  # two rounds of 16.8 s, and 6.4 s
    (t,) = times(timeline, words(high(1562), ROW_7, COLUMN_9_ON))
    assert t == (2 * 4096 + 1562) * 4096


def test_an_end_that_did_not_come_is_a_gap() -> None:
    timeline = Timeline(1280, 720)
    times(timeline, words(high(0), high(1)))
    timeline.finish(0.5, 0.02)
    assert timeline.gaps_us == [(4096, 500_000)]


def test_a_stream_of_nothing_is_a_gap() -> None:
    timeline = Timeline(1280, 720)
    timeline.finish(0.5, 0.02)
    assert timeline.gaps_us == [(0, 500_000)]


def test_an_end_that_was_dropped_is_a_gap() -> None:
    timeline = Timeline(1280, 720)
    times(timeline, words(high(0), high(1)))
    timeline.lose(Lost(1, 2, 0.0))
    timeline.finish(0.008, 0.02)
    assert timeline.gaps_us == [(4096, 8192)]


def test_an_input_that_turns_edges_round_is_put_right() -> None:
    for inverted in (False, True):
        timeline = Timeline(1280, 720, trigger_inverted=inverted)
        (chunk,) = timeline.feed(words(high(0), TRIGGER))
        assert chunk.triggers["p"].tolist() == [0 if inverted else 1]


@given(st.lists(st.integers(0, 0xFFFF), max_size=60), st.data())
def test_where_the_bytes_are_cut_does_not_matter(values: list[int], data: st.DataObject) -> None:
    stream = words(high(0), *values)
    whole = Timeline(1280, 720)
    expected = [tuple(e) for chunk in whole.feed(stream) for e in chunk.events.tolist()]
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=5)))
    cut = Timeline(1280, 720)
    found = []
    for begin, end in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        found += [tuple(e) for chunk in cut.feed(stream[begin:end]) for e in chunk.events.tolist()]
    whole.finish(0.0, 1.0)
    cut.finish(0.0, 1.0)
    assert found == expected
    assert (cut.violations, cut.overflows, cut.gaps_us) == (whole.violations, whole.overflows, whole.gaps_us)
