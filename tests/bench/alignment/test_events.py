"""Edges placed by the events that answer them: recordings made pixel by pixel, and by the reference engine."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import pytest

from bench.alignment.counts import EventCounts
from bench.alignment.events import EdgeAlignment, align_to_events
from bench.alignment.latency import Answering
from benchmarks.edge_alignment import CASES, Case, Sensor, Truth, recorded, trial
from protocols.points import Preamble, Roi
from protocols.preamble import with_preamble
from protocols.waveforms import constant_light, square_edges
from sim_backend.pixel.chain import build_chain
from sim_backend.pixel.effects import ComparatorDelay, PhotoreceptorBandwidth, ShotNoise, ThresholdMismatch
from sim_backend.pixel.engines import ReferenceEngine
from sim_backend.pixel.light import LightHistory
from sim_backend.pixel.model import PixelModel
from tests.bench.alignment.edge_support import SENSOR

if TYPE_CHECKING:
    from protocols.stimulus import Stimulus

PERIOD_S = 0.2
SQUARE = square_edges(period_s=PERIOD_S, duty=0.5, low_lux=10.0, high_lux=20.0, cycles=30, first_edge_s=0.2)
FIVE_TIMES = Preamble(math.log(5.0))
MARKED = with_preamble(SQUARE, FIVE_TIMES)
TRUTH = Truth(offset_s=0.734, rate=50e-6, duration_s=9.5)


def _taken(
    stimulus: Stimulus, truth: Truth = TRUTH, seed: int = 1, sensor: Sensor = SENSOR
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.uint8]]:
    return recorded(stimulus, sensor, truth, stretches=False, rng=np.random.default_rng(seed))


def _placed(
    stimulus: Stimulus,
    t_us: npt.NDArray[np.int64],
    p: npt.NDArray[np.uint8],
    truth: Truth = TRUTH,
    limits_s: tuple[float, float] | None = None,
) -> EdgeAlignment:
    found = align_to_events(
        stimulus.t_s,
        stimulus.lux,
        EventCounts.of(t_us, p),
        duration_s=truth.duration_s,
        offset_limits_s=limits_s,
        answering=Answering(rise_tau_s=1e-3),
    )
    assert found is not None
    return found


def _case(name: str) -> Case:
    return next(case for case in CASES if case.name == name)


@pytest.mark.parametrize("rate", [-50e-6, 0.0, 50e-6])
def test_behind_a_preamble_edges_are_found_to_0_2_ms(rate: float) -> None:
    truth = replace(TRUTH, rate=rate)
    found = _placed(MARKED, *_taken(MARKED, truth), truth)
    assert not found.doubtful, found.doubts
    np.testing.assert_allclose(found.t_s[1:], truth.at(MARKED.t_s[1:]), atol=2e-4, rtol=0.0)
    assert found.t_s[0] == 0.0
    assert found.offset_s == pytest.approx(truth.offset_s, abs=2e-4)
    assert found.rate_ppm == pytest.approx(1e6 * rate, abs=5.0)
    assert found.residual_s < 1e-4
    assert found.seen == len(MARKED.t_s) - 1
    assert found.unseen == 0
    assert abs(found.offset_s - truth.offset_s) < found.bound_s < 4e-4


@pytest.mark.parametrize("name", ["preamble", "preamble, rise not given"])
def test_trials_with_a_preamble(name: str) -> None:
    for seed in range(20_000, 20_004):
        outcome, _ = trial(_case(name), seed)
        assert not outcome.doubtful
        assert not outcome.periods_off
        assert outcome.worst_s < 2e-4


def test_what_is_a_period_off_says_that_it_is_doubtful() -> None:
    """Without a preamble, with its beginning cut off: one period is like the next."""
    off = 0
    for seed in range(20_000, 20_006):
        outcome, _ = trial(_case("no preamble, beginning not recorded"), seed)
        off += outcome.periods_off
        assert outcome.doubtful or not outcome.periods_off
    assert off > 0


def test_a_square_wave_without_preamble_is_doubtful_and_names_the_other_place() -> None:
    found = _placed(SQUARE, *_taken(SQUARE))
    assert found.doubtful
    assert "preamble" in found.doubts[0]
    assert abs(found.second_s - found.offset_s) == pytest.approx(PERIOD_S, abs=5e-3)


def test_where_the_host_knows_the_offset_a_square_wave_is_sure() -> None:
    limits = (TRUTH.offset_s - 0.015, TRUTH.offset_s + 0.02)
    found = _placed(SQUARE, *_taken(SQUARE), limits_s=limits)
    assert not found.doubtful, found.doubts
    assert abs(found.t_s[1:] - TRUTH.at(SQUARE.t_s[1:])).max() < found.bound_s


def test_a_preamble_that_was_not_recorded_does_not_help() -> None:
    truth = Truth(offset_s=-2.1, rate=50e-6, duration_s=4.0)
    found = _placed(MARKED, *_taken(MARKED, truth), truth)
    assert found.doubtful


def test_background_alone_is_doubtful_or_nothing() -> None:
    rng = np.random.default_rng(3)
    t_us = np.sort(rng.integers(0, 9_500_000, 5000))
    found = align_to_events(
        MARKED.t_s, MARKED.lux, EventCounts.of(t_us, rng.integers(0, 2, 5000).astype(np.uint8)), duration_s=9.5
    )
    assert found is None or found.doubtful


def test_the_answers_to_another_stimulus_are_doubtful() -> None:
    other = square_edges(period_s=0.173, duty=0.4, low_lux=10.0, high_lux=20.0, cycles=30, first_edge_s=0.2)
    found = _placed(MARKED, *_taken(other))
    assert found.doubtful


def test_events_of_exchanged_polarity_are_doubtful() -> None:
    t_us, p = _taken(MARKED)
    found = _placed(MARKED, t_us, (1 - p).astype(np.uint8))
    assert found.doubtful


def test_nothing_to_align() -> None:
    constant = constant_light(10.0, 5.0)
    some = EventCounts.of(np.array([100, 200]), np.array([0, 1], np.uint8))
    assert align_to_events(constant.t_s, constant.lux, some, duration_s=5.0) is None
    assert align_to_events(SQUARE.t_s, SQUARE.lux, EventCounts(), duration_s=5.0) is None


@pytest.mark.parametrize("cycles", [1, 2])
def test_few_edges_are_no_sure_alignment(cycles: int) -> None:
    few = square_edges(period_s=0.2, duty=0.5, low_lux=10.0, high_lux=20.0, cycles=cycles, first_edge_s=0.2)
    truth = replace(TRUTH, duration_s=3.0)
    t_us, p = _taken(few, truth)
    found = align_to_events(few.t_s, few.lux, EventCounts.of(t_us, p), duration_s=3.0)
    assert found is not None
    assert found.doubtful or cycles == 2


def test_what_the_point_file_says() -> None:
    found = _placed(SQUARE, *_taken(SQUARE))
    attributes, quality = found.attributes(), found.quality()
    assert attributes["time_axis"] == "from_events"
    assert attributes["time_offset_s"] == found.offset_s
    assert attributes["time_bound_s"] == found.bound_s
    assert quality["time_doubtful"] == 1
    assert quality["time_note"]
    assert quality["edges_seen"] == found.seen


def _engine_events(model: PixelModel, stimulus: Stimulus, truth: Truth) -> npt.NDArray[np.void]:
    t_s = truth.at(stimulus.t_s)
    t_s[0] = 0.0
    light = LightHistory(t_s, stimulus.lux, rise_tau_s=1e-3)
    engine = ReferenceEngine(dt_s=2e-5, threads=2)
    events = np.concatenate(list(engine.events(build_chain(model, Roi(0, 0, 8, 8), 5), light, truth.duration_s, 9)))
    return np.asarray(events[np.random.default_rng(2).random(len(events)) >= 0.2])


@pytest.mark.parametrize(
    ("model", "within_s"),
    [
        (PixelModel(noise_rms=0.04, corner_hz=1000.0), 2e-4),
        (PixelModel(noise_rms=0.02, corner_hz=500.0, refractory_s=5e-3) + ThresholdMismatch(), 2e-4),
        (PixelModel(corner_hz=2000.0) + ComparatorDelay() + ShotNoise() + PhotoreceptorBandwidth(), 3e-4),
    ],
)
def test_recordings_of_the_reference_engine(model: PixelModel, within_s: float) -> None:
    square = square_edges(period_s=0.2, duty=0.5, low_lux=100.0, high_lux=200.0, cycles=8, first_edge_s=0.2)
    stimulus = with_preamble(square, FIVE_TIMES)
    truth = Truth(offset_s=0.4321, rate=-50e-6, duration_s=4.2)
    events = _engine_events(model, stimulus, truth)
    found = _placed(stimulus, events["t"].astype(np.int64), events["p"], truth)
    assert not found.doubtful, found.doubts
    errors = found.t_s[1:] - truth.at(stimulus.t_s[1:])
    assert np.abs(errors).max() < within_s
    assert np.abs(errors).max() < found.bound_s + 5e-5


def test_slow_pixels_are_placed_within_the_bound_if_their_bandwidth_is_given() -> None:
    """At 50 Hz the first answers come 1 ms after the light: that cannot be told from the clock."""
    truth = Truth(offset_s=0.4321, rate=-50e-6, duration_s=4.2)
    square = square_edges(period_s=0.2, duty=0.5, low_lux=100.0, high_lux=200.0, cycles=8, first_edge_s=0.2)
    stimulus = with_preamble(square, FIVE_TIMES)
    events = _engine_events(PixelModel(corner_hz=50.0), stimulus, truth)
    counts = EventCounts.of(events["t"].astype(np.int64), events["p"])
    found = align_to_events(
        stimulus.t_s,
        stimulus.lux,
        counts,
        duration_s=truth.duration_s,
        answering=Answering(rise_tau_s=1e-3, bandwidth_hz=50.0),
    )
    assert found is not None
    assert not found.doubtful, found.doubts
    assert np.abs(found.t_s[1:] - truth.at(stimulus.t_s[1:])).max() < found.bound_s
    assert found.bound_s > 5e-4
