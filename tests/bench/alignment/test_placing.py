"""Who tells where the edges are: triggers, else the events, else the source; and what the point file says of it."""

from __future__ import annotations

import logging
import math
from typing import TYPE_CHECKING

import numpy as np
import pytest

from bench.alignment.counts import EventCounts
from bench.alignment.latency import Answering
from bench.alignment.placing import PlacedEdges, Taken, place_edges
from benchmarks.edge_alignment import Truth, recorded
from protocols.points import Preamble
from protocols.preamble import with_preamble
from protocols.waveforms import constant_light, square_edges
from tests.bench.alignment.edge_support import SENSOR

if TYPE_CHECKING:
    import numpy.typing as npt

    from protocols.stimulus import Stimulus

SQUARE = square_edges(period_s=0.2, duty=0.5, low_lux=10.0, high_lux=20.0, cycles=20, first_edge_s=0.2)
MARKED = with_preamble(SQUARE, Preamble(math.log(5.0)))
TRUTH = Truth(offset_s=0.234, rate=50e-6, duration_s=7.0)
NO_TRIGGERS = np.empty(0, np.int64)


def never() -> EventCounts:
    raise AssertionError("events were counted")


def placed(
    stimulus: Stimulus,
    counts: EventCounts | None = None,
    trigger_t_us: npt.NDArray[np.int64] = NO_TRIGGERS,
    marks_s: npt.NDArray[np.float64] | None = None,
) -> PlacedEdges:
    taken = Taken(
        name="point 7",
        edges_s=stimulus.t_s,
        lux=stimulus.lux,
        trigger_t_us=trigger_t_us,
        trigger_p=np.ones(len(trigger_t_us), np.uint8),
        marks_s=marks_s,
        duration_s=TRUTH.duration_s,
        latest_s=0.0,
        answering=Answering(rise_tau_s=1e-3),
        counted=never if counts is None else lambda: counts,
    )
    return place_edges(taken)


def answers(stimulus: Stimulus) -> EventCounts:
    return EventCounts.of(*recorded(stimulus, SENSOR, TRUTH, stretches=False, rng=np.random.default_rng(2)))


def test_triggers_tell_and_no_event_is_looked_at() -> None:
    triggers = np.round(1e6 * TRUTH.at(SQUARE.t_s[1:])).astype(np.int64)
    edges = placed(SQUARE, trigger_t_us=triggers)
    np.testing.assert_allclose(edges.t_s[1:], TRUTH.at(SQUARE.t_s[1:]), atol=1e-6)
    assert edges.attributes["time_axis"] == "trigger"
    assert edges.quality == {"edges_without_trigger": 0, "triggers_without_edge": 0}


def test_triggers_at_begin_and_end_of_a_burst_tell() -> None:
    marks = np.array([SQUARE.t_s[1] - 1e-3, SQUARE.t_s[-1] + 0.1])
    triggers = np.round(1e6 * TRUTH.at(marks)).astype(np.int64)
    edges = placed(SQUARE, trigger_t_us=triggers, marks_s=marks)
    np.testing.assert_allclose(edges.t_s[1:], TRUTH.at(SQUARE.t_s[1:]), atol=2e-6)
    assert edges.attributes["time_axis"] == "trigger"
    assert edges.attributes["time_rate_ppm"] == pytest.approx(50.0, abs=0.5)
    assert edges.trigger is None
    alone = placed(SQUARE, trigger_t_us=triggers[:1], marks_s=marks)
    np.testing.assert_allclose(alone.t_s[1:], TRUTH.at(SQUARE.t_s[1:]), atol=60e-6 * 4.2)
    assert "time_residual_s" not in alone.attributes


def test_triggers_that_are_not_those_of_the_burst_are_not_taken() -> None:
    marks = np.array([0.2, 4.2])
    strange = placed(MARKED, answers(MARKED), np.array([300_000, 4_400_000]), marks)
    assert strange.attributes["time_axis"] == "from_events"


def test_without_triggers_the_answers_tell() -> None:
    edges = placed(MARKED, answers(MARKED))
    np.testing.assert_allclose(edges.t_s[1:], TRUTH.at(MARKED.t_s[1:]), atol=2e-4, rtol=0.0)
    assert edges.trigger is None
    assert edges.attributes["time_axis"] == "from_events"
    assert edges.attributes["time_rate_ppm"] == pytest.approx(50.0, abs=5.0)
    assert edges.quality["time_doubtful"] == 0
    assert "edges_without_trigger" not in edges.quality


def test_a_trigger_that_fits_no_edge_is_counted_and_told(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        edges = placed(MARKED, answers(MARKED), np.array([1_000_000]))
    assert edges.attributes["time_axis"] == "from_events"
    assert edges.quality["triggers_without_edge"] == 1
    assert edges.quality["edges_without_trigger"] == len(MARKED.t_s) - 1
    assert "point 7: triggers (1) do not fit the edges" in caplog.text


def test_where_nothing_answers_the_source_is_believed_and_that_is_doubtful(caplog: pytest.LogCaptureFixture) -> None:
    rng = np.random.default_rng(4)
    noise = EventCounts.of(np.sort(rng.integers(0, 7_000_000, 900)), rng.integers(0, 2, 900).astype(np.uint8))
    with caplog.at_level(logging.WARNING):
        edges = placed(MARKED, noise)
    np.testing.assert_array_equal(edges.t_s[1:], MARKED.t_s[1:])
    assert edges.attributes == {"time_axis": "edges_known"}
    assert edges.quality["time_doubtful"] == 1
    assert "where the source says" in caplog.text


def test_constant_light_has_nothing_to_place() -> None:
    edges = placed(constant_light(10.0, 7.0))
    assert edges.attributes == {"time_axis": "edges_known"}
    assert edges.quality == {}
    np.testing.assert_array_equal(edges.t_s, [0.0])


def test_of_places_that_are_equally_good_the_one_where_the_source_says_is_taken() -> None:
    """A short square wave fits a period away as well: that stays doubtful, but the host knows better than that."""
    short = square_edges(period_s=0.2, duty=0.5, low_lux=10.0, high_lux=20.0, cycles=6, first_edge_s=0.2)
    truth = Truth(offset_s=0.01, rate=50e-6, duration_s=7.0)
    counts = EventCounts.of(*recorded(short, SENSOR, truth, stretches=True, rng=np.random.default_rng(5)))
    edges = placed(short, counts)
    np.testing.assert_allclose(edges.t_s[1:], truth.at(short.t_s[1:]), atol=1e-3, rtol=0.0)
    assert edges.quality["time_doubtful"] == 1
    assert "would fit" in edges.quality["time_note"]
