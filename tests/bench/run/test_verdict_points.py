"""Points as a recorder would have taken them, with events at will; and that those in order are found so."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pytest

from bench.run.plan import PlannedPoint
from bench.run.verdict import Limits, Seen, Verdict, judge
from bench.store.record import PointRecord, PulseRecord, StimulusRecord
from drivers.events.types import EVENT_DTYPE, TRIGGER_DTYPE, EventChunk, empty_triggers
from drivers.interfaces import Waveform
from protocols.points import ConstantTiming, Point, ResetTestTiming, Roi, Settings
from protocols.waveforms import stimulus_of

if TYPE_CHECKING:
    from protocols.stimulus import Stimulus

__all__ = ["ROI", "Taken", "answers", "constant", "events_at", "reset_test", "triggers_at"]

ROI = Roi(10, 20, 8, 8)
_TIMING = ResetTestTiming(0.04, 0.04, 0.8, "up", 0.04, 0.04)


@dataclass
class Taken:
    """A point, and what came of it; change what is to be wrong."""

    planned: PlannedPoint
    record: PointRecord
    events: npt.NDArray[np.void]
    triggers: npt.NDArray[np.void] = field(default_factory=empty_triggers)

    def seen(self) -> Seen:
        """Return the events as they are gathered, in three chunks."""
        seen = Seen(self.planned.point.roi)
        third = len(self.events) // 3
        seen.add(EventChunk(self.events[:third], self.triggers))
        seen.add(EventChunk(self.events[third : 2 * third], empty_triggers()))
        seen.add(EventChunk(self.events[2 * third :], empty_triggers()))
        return seen

    def judged(self, limits: Limits | None = None) -> Verdict:
        """Return the verdict."""
        return judge(self.record, self.planned, self.seen(), limits or Limits())

    def with_record(self, **changes: Any) -> Taken:
        """Return the same with fields of the record changed."""
        return replace(self, record=replace(self.record, **changes))


def events_at(
    t_s: npt.NDArray[np.float64], x: npt.NDArray[np.int64], y: npt.NDArray[np.int64], p: npt.NDArray[np.int64]
) -> npt.NDArray[np.void]:
    """Return events in order of time; x and y from the corner of the window."""
    found = np.zeros(len(t_s), EVENT_DTYPE)
    found["t"], found["x"], found["y"], found["p"] = 1e6 * t_s, ROI.x + x, ROI.y + y, p
    return found[np.argsort(found["t"], kind="stable")]


def triggers_at(t_s: npt.NDArray[np.float64], rising: npt.NDArray[np.bool_]) -> npt.NDArray[np.void]:
    """Return edges at the trigger input."""
    found = np.zeros(len(t_s), TRIGGER_DTYPE)
    found["t"], found["p"] = np.rint(1e6 * t_s), rising
    return found


def answers(stimulus: Stimulus, seed: int, chance: float = 0.9) -> npt.NDArray[np.void]:
    """Return one event of each pixel, with some chance, a few ms after each edge."""
    rng = np.random.default_rng(seed)
    rising = np.diff(stimulus.lux) > 0.0
    edge, pixel = np.nonzero(rng.random((len(rising), ROI.pixels)) < chance)
    t_s = stimulus.t_s[1:][edge] + rng.exponential(2e-3, len(edge)) + 1e-4
    return events_at(t_s, pixel % ROI.width, pixel // ROI.width, rising[edge].astype(np.int64))


def reset_test(seed: int = 1, pulses: int = 40, chance: float = 0.9) -> Taken:
    """Return a sound point of reset and test pulses, each edge of which has its trigger."""
    settings = Settings(theta_on=0.3, theta_off=0.25, refractory_s=0.01)
    point = Point(0, "on", "reset_test", "on", 100.0, 0.5, pulses, _TIMING, ROI, settings=settings)
    stimulus = stimulus_of(point)
    edges = len(stimulus.t_s)
    record = PointRecord(
        index=0,
        waveform="reset_test",
        polarity="on",
        baseline_lux=100.0,
        log_contrast=0.5,
        duration_s=stimulus.duration_s,
        nd_od=0.0,
        stimulus=StimulusRecord(stimulus.t_s, stimulus.lux, np.arange(-1, edges - 1)),
        pulses=PulseRecord(stimulus.pulse_start_s, stimulus.pulse_stop_s, stimulus.pulse_kind),
        refractory_s=0.01,
        temperature_c=25.0,
        attributes={"time_axis": "trigger"},
        quality={"edges_without_trigger": 0, "triggers_without_edge": 0, "bytes_received": 1000},
    )
    rising = np.diff(stimulus.lux) > 0.0
    triggers = triggers_at(stimulus.t_s[1:], rising)
    return Taken(_planned(point, stimulus), record, answers(stimulus, seed, chance), triggers)


def constant(seed: int = 1, rate_hz: float = 1.0, duration_s: float = 20.0, roi: Roi = ROI) -> Taken:
    """Return a sound point of constant light, with background activity."""
    point = Point(0, "dark", "constant", "both", 1.0, 0.0, 0, ConstantTiming(duration_s), roi)
    stimulus = stimulus_of(point)
    rng = np.random.default_rng(seed)
    n = rng.poisson(rate_hz * duration_s * roi.pixels)
    x, y = rng.integers(0, roi.width, n), rng.integers(0, roi.height, n)
    events = events_at(rng.random(n) * duration_s, x, y, rng.integers(0, 2, n))
    empty = np.empty(0)
    record = PointRecord(
        index=0,
        waveform="constant",
        polarity="both",
        baseline_lux=1.0,
        log_contrast=0.0,
        duration_s=duration_s,
        nd_od=0.0,
        stimulus=StimulusRecord(stimulus.t_s, stimulus.lux),
        pulses=PulseRecord(empty, empty, np.empty(0, np.uint8)),
        refractory_s=0.01,
        attributes={"time_axis": "edges_known"},
    )
    return Taken(_planned(point, stimulus), record, events)


def _planned(point: Point, stimulus: Stimulus) -> PlannedPoint:
    waveform = Waveform(stimulus.t_s, stimulus.lux, stimulus.duration_s)
    return PlannedPoint(point, stimulus, "clear", waveform, {}, point.log_contrast)


@pytest.mark.parametrize("seed", range(20))
def test_a_sound_point_is_green(seed: int) -> None:
    for taken in (reset_test(seed), reset_test(seed, chance=0.3), reset_test(seed, pulses=4)):
        assert taken.judged() == Verdict("green", ())


@pytest.mark.parametrize("seed", range(20))
def test_sound_constant_light_is_green(seed: int) -> None:
    for rate_hz in (0.0, 0.01, 1.0, 10.0):
        assert constant(seed, rate_hz).judged() == Verdict("green", ())
