"""What is gathered of the events while they pass."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from bench.run.verdict_seen import Seen
from drivers.events.types import EVENT_DTYPE, EventChunk, empty_events, empty_triggers
from protocols.points import Roi
from tests.bench.run.test_verdict_points import triggers_at


def _events(seed: int, n: int, last_us: int) -> npt.NDArray[np.void]:
    rng = np.random.default_rng(seed)
    events = np.zeros(n, EVENT_DTYPE)
    events["t"] = np.sort(rng.integers(0, last_us, n))
    events["x"], events["y"], events["p"] = rng.integers(0, 40, n), rng.integers(0, 30, n), rng.integers(0, 2, n)
    return events


@pytest.mark.parametrize("size", [1, 7, 100_000])
def test_counts_are_those_of_all_events_however_they_come(size: int) -> None:
    events = _events(1, 3000, 9_000_000)
    seen = Seen(Roi(5, 6, 20, 10))
    for first in range(0, len(events), size):
        seen.add(EventChunk(events[first : first + size], empty_triggers()))
    x, y, p = (events[name].astype(np.int64) for name in ("x", "y", "p"))
    inside = (x >= 5) & (x < 25) & (y >= 6) & (y < 16)
    expected = np.zeros((10, 20), np.int64)
    np.add.at(expected, (y[inside] - 6, x[inside] - 5), 1)
    np.testing.assert_array_equal(seen.pixels, expected)
    assert (seen.n_events, seen.n_outside) == (3000, int((~inside).sum()))
    for polarity in (0, 1):
        in_bins = np.bincount(events["t"][p == polarity] // 1000, minlength=9000)
        np.testing.assert_array_equal(seen.binned(9.0)[polarity], in_bins)
        np.testing.assert_array_equal(seen.per_second(9.0)[polarity], in_bins.reshape(9, -1).sum(axis=1))


def test_events_between_times() -> None:
    events = np.zeros(4, EVENT_DTYPE)
    events["t"], events["p"] = [0, 1_000, 1_500, 2_999], [1, 0, 1, 1]
    seen = Seen(Roi(0, 0, 1, 1))
    seen.add(EventChunk(events, empty_triggers()))
    found = seen.between(np.array([0.0, 0.001, 0.0, 5.0]), np.array([0.001, 0.003, 0.0015, 6.0]))
    np.testing.assert_allclose(found, [[0.0, 1.0, 0.5, 0.0], [1.0, 2.0, 1.5, 0.0]], atol=1e-9)


def test_a_long_recording_has_longer_bins_and_loses_nothing() -> None:
    events = _events(2, 20_000, 5_000_000_000)
    seen = Seen(Roi(0, 0, 40, 30))
    for part in np.array_split(events, 13):
        seen.add(EventChunk(part, empty_triggers()))
    assert seen.bin_us == 8000
    assert seen.n_events == 20_000
    binned = seen.binned(5000.0)
    np.testing.assert_array_equal(binned.sum(axis=0), np.bincount(events["t"] // 8000, minlength=625_000))


def test_events_that_step_back_and_come_before_the_start() -> None:
    events = np.zeros(3, EVENT_DTYPE)
    events["t"] = [5_000, 4_999, -3]
    seen = Seen(Roi(0, 0, 1, 1))
    seen.add(EventChunk(events, empty_triggers()))
    assert np.flatnonzero(seen.binned(0.01)[0]).tolist() == [0, 4, 5]


def test_triggers_are_kept_in_order() -> None:
    seen = Seen(Roi(0, 0, 1, 1))
    assert seen.trigger_p.size == 0
    for rising in ([True], [False, True]):
        triggers = triggers_at(np.arange(len(rising), dtype=np.float64), np.array(rising))
        seen.add(EventChunk(empty_events(), triggers))
    assert seen.n_triggers == 3
    assert seen.trigger_p.tolist() == [1, 0, 1]
    assert seen.n_events == 0
