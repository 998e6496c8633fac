"""Which events answer which pulse, beside a count of each event by itself."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bench.analysis.windows import window_of
from bench.diagnosis.recorded.recording import Frame, Recording
from drivers.events.types import EVENT_DTYPE

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

SIDE = 8


def random_events(rng: np.random.Generator, count: int, duration_us: int) -> npt.NDArray[np.void]:
    events = np.zeros(count, EVENT_DTYPE)
    events["t"] = np.sort(rng.integers(0, duration_us + 1000, count))  # some come when it is over
    events["x"], events["y"] = (rng.integers(low - 1, low + SIDE + 1, count) for low in (40, 30))  # or from outside
    events["p"] = rng.integers(0, 2, count)
    return events


@pytest.mark.parametrize("sensors", [1, 3])
def test_answers_are_those_of_each_event_by_itself(point: Callable[..., Any], sensors: int) -> None:
    rng = np.random.default_rng(3)
    taken = replace(point(0, 0.5), masked=np.array([[42, 31], [40, 30]], np.uint16), gaps_s=np.array([[0.11, 0.13]]))
    frame = Frame(taken)
    each = [random_events(rng, 4000, round(1e6 * taken.duration_s)) for _ in range(sensors)]
    recording = Recording(frame, *([events[:1500], events[1500:]] for events in each))
    own = window_of(frame.windows, recording.t_us, recording.p)
    other = window_of(frame.windows, recording.t_us, 1 - recording.p)
    assert recording.pixels == sensors * (SIDE * SIDE - 2)
    for number, answers in enumerate(recording.groups):
        places = np.flatnonzero(frame.windows.group == number)
        for k, window in enumerate(places):
            for pixel in range(recording.pixels):
                mine = np.flatnonzero((own == window) & (recording.pixel == pixel))
                assert answers.own[pixel, k] == mine.size
                assert answers.other[pixel, k] == np.sum((other == window) & (recording.pixel == pixel))
                late_s = (recording.t_us[mine] - frame.windows.edge_us[window]) / 1e6
                first = late_s[0] if mine.size else np.nan
                later = late_s[late_s > first]
                np.testing.assert_equal(answers.latency_s[pixel, k], first)
                np.testing.assert_equal(answers.gap_s[pixel, k], later[0] - first if later.size else np.nan)
