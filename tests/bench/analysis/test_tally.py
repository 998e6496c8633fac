"""Counting: known answers by hand, an independent slow count, and chunks of every size."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from bench.analysis.tally import observed_s, tally_point
from drivers.events.types import EVENT_DTYPE


def _slow_answers(point: Any, kind: int) -> tuple[np.ndarray, int]:
    """Return (pixels,) answers and the number of events in windows: one pixel and one pulse after the other."""
    roi, events = point.roi, point.stored
    answers, total = np.zeros(roi.pixels, np.int64), 0
    for pixel in range(roi.pixels):
        x, y = roi.x + pixel % roi.width, roi.y + pixel // roi.width
        mine = events[(events["x"] == x) & (events["y"] == y) & (events["p"] == 1 - kind)]["t"] / 1e6
        for start, stop, k in zip(point.pulse_start_s, point.pulse_stop_s, point.pulse_kind, strict=True):
            if k == kind:
                inside = int(np.sum((mine >= start - 1e-9) & (mine < stop - 1e-9)))
                answers[pixel] += inside > 0
                total += inside
    return answers, total


def _random_events(seed: int, n: int, stop_us: int, point: Any) -> Any:
    rng = np.random.default_rng(seed)
    events = np.zeros(n, EVENT_DTYPE)
    events["t"] = np.sort(rng.integers(0, stop_us, n))
    events["x"] = rng.integers(point.roi.x, point.roi.x + point.roi.width, n)
    events["y"] = rng.integers(point.roi.y, point.roi.y + point.roi.height, n)
    events["p"] = rng.integers(0, 2, n)
    return events


def test_known_answers(square: Any, events: Any) -> None:
    stored = events(
        [
            (100_000, 100, 50, 1),  # at the very edge: an answer of pixel 0 to the first bright half, latency 0
            (150_000, 100, 50, 1),  # a second event of the same pulse
            (120_000, 101, 50, 0),  # wrong polarity
            (199_999, 102, 50, 1),  # the last microsecond
            (200_000, 103, 50, 1),  # too late: the window is [start, stop)
            (210_000, 100, 50, 0),  # pixel 0 answers the dark half after it
            (250_000, 101, 51, 0),  # pixel 5 answers it without having answered the bright half
        ]
    )
    on, off = tally_point(square(0.3, periods=1, half_s=0.1, stored=stored)).groups
    assert np.flatnonzero(on.answers).tolist() == [0, 2]
    assert on.events == 3
    assert on.latencies.sum() == 2
    assert np.flatnonzero(on.latencies).tolist() == [0, 99_999]
    assert np.flatnonzero(off.answers).tolist() == [0, 5]
    assert np.flatnonzero(off.latencies).tolist() == [10_000, 50_000]
    assert np.flatnonzero(off.given).tolist() == [0, 2], "pixels 0 and 2 answered the half before"
    assert np.flatnonzero(off.followed).tolist() == [0]


@pytest.mark.parametrize("chunk", [1, 7, 1000, 10**6])
def test_agrees_with_a_slow_count_whatever_the_chunks(square: Any, chunk: int) -> None:
    point = square(0.3, periods=20, half_s=0.02)
    point = square(0.3, periods=20, half_s=0.02, stored=_random_events(chunk, 700, 820_000, point))
    tally = tally_point(point, chunk)
    for kind, group in enumerate(tally.groups):
        answers, total = _slow_answers(point, kind)
        assert group.answers.tolist() == answers.tolist()
        assert group.events == total
    assert tally.pixel_events.sum() == 700


def test_pairs_agree_with_a_slow_count(square: Any) -> None:
    point = square(0.3, periods=20, half_s=0.02)
    point = square(0.3, periods=20, half_s=0.02, stored=_random_events(5, 500, 820_000, point))
    window = point.stored["t"] // 20_000 - 1  # the pulse into which an event falls, from 0; even ones are bright
    pixel = (point.stored["y"] - 50).astype(int) * 4 + point.stored["x"] - 100
    right = (point.stored["p"] == 1) == (window % 2 == 0)
    answered = {(int(w), int(x)) for w, x, ok in zip(window, pixel, right, strict=True) if ok and w >= 0}
    on, off = tally_point(point, 13).groups
    for group, parity in ((on, 0), (off, 1)):
        pulses = [w for w in range(1, 40) if w % 2 == parity]
        given = sum((w - 1, x) in answered for w in pulses for x in range(12))
        followed = sum((w - 1, x) in answered and (w, x) in answered for w in pulses for x in range(12))
        assert (group.given.sum(), group.followed.sum()) == (given, followed)


def test_masked_and_outside_events_do_not_count(square: Any, events: Any) -> None:
    stored = events([(110_000, 100, 50, 1), (120_000, 101, 50, 1), (130_000, 99, 50, 1), (130_000, 104, 50, 1)])
    tally = tally_point(square(0.3, periods=1, stored=stored, masked=np.array([[100, 50], [5, 5]], np.uint16)))
    assert np.flatnonzero(tally.groups[0].answers).tolist() == [1]
    assert tally.outside == 2
    assert np.flatnonzero(~tally.active).tolist() == [0]
    assert tally.pixel_events.sum() == 1


def test_gaps_shorten_the_recording_and_hide_its_events(point: Any, events: Any) -> None:
    stored = events([(500_000, 100, 50, 1), (1_500_000, 100, 50, 1), (9_000_000, 101, 50, 0)])
    made = point(stored=stored, gaps_s=np.array([[1.0, 2.0], [1.5, 2.5], [9.5, 12.0]]))
    tally = tally_point(made)
    assert tally.pixel_events.sum() == 2
    assert tally.observed_s == pytest.approx(10.0 - 1.5 - 0.5)
    assert observed_s(point()) == 10.0


def test_answered_resets(reset_test: Any, events: Any) -> None:
    stored = events(
        [
            (510_000, 100, 50, 0),  # pixel 0 is re-armed, twice counts once
            (520_000, 100, 50, 0),
            (550_000, 101, 50, 1),  # wrong polarity
            (499_999, 102, 50, 0),  # before the return of the reset
            (600_000, 103, 50, 0),  # after the test has begun
            (1_310_000, 100, 50, 0),
        ]
    )
    (group,) = tally_point(reset_test(0.3, pulses=2, stored=stored)).groups
    assert group.resets == 2
    assert group.rearmed.tolist() == [2] + [0] * 11
