"""Which data are not fit to be judged, why, and what is told of data that are."""

from __future__ import annotations

from dataclasses import asdict, replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bench.diagnosis.expected.gate import cautions_of, findings_of
from bench.diagnosis.recorded.excerpt import beginnings, middles
from bench.store import Run, RunWriter
from bench.store.record import PointRecord, PulseRecord, StimulusRecord
from drivers.events.types import EVENT_DTYPE, EventChunk, empty_triggers
from drivers.interfaces import RecordingQuality
from protocols.points import Roi
from sim_backend.pixel import PixelModel
from sim_backend.pixel.effects import ReadoutSaturation

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from bench.store.data import PointData

    MakePoint = Callable[..., Any]

BY_TRIGGER = {"time_axis": "trigger"}


def problem(points: Sequence[PointData]) -> Any:
    """Return as much of a problem as is asked for."""
    return SimpleNamespace(points=tuple(points))


def as_recorded(lost: RecordingQuality) -> dict[str, Any]:
    """Return what the recorder writes as a point's quality, but for the gaps themselves."""
    told = asdict(lost)
    return {**told, "gaps": len(told.pop("gaps_s"))}


def judged(point: MakePoint, lost: RecordingQuality, bad: int, of: int = 20, **changes: Any) -> tuple[str, ...]:
    """Return what is found where so many of some points were taken with this loss, and changes."""
    gaps_s = np.array(lost.gaps_s, np.float64).reshape(-1, 2)
    values = {"quality": as_recorded(lost), "gaps_s": gaps_s, **changes}
    sound = {"quality": as_recorded(RecordingQuality()), "attributes": BY_TRIGGER}
    points = [point(i, 0.3, n_events=1000, **(values if i < bad else sound)) for i in range(of)]
    return findings_of(problem(points))


@pytest.mark.parametrize(
    ("lost", "what"),
    [
        (RecordingQuality(overflows=1), "events were lost on the way, nobody knows when, in 3 of 20 points"),
        (RecordingQuality(dropped_buffers=2), "events were lost on the way, nobody knows when, in 3 of 20 points"),
        (RecordingQuality(gaps_s=((0.1, 0.2),)), "data are missing for more than 2% of the time in 3 of 20 points"),
        (
            RecordingQuality(decode_errors=12),
            "more than 1% of the stream broke the rules of its format in 3 of 20 points",
        ),
    ],
)
def test_what_a_recording_lost_is_a_reason_in_more_than_a_tenth_of_the_points(
    point: MakePoint, lost: RecordingQuality, what: str
) -> None:
    assert judged(point, lost, bad=3) == (what,)
    assert judged(point, lost, bad=2) == ()


def test_each_count_of_a_recording_is_looked_at(point: MakePoint) -> None:
    for name in set(asdict(RecordingQuality())) - {"bytes_received", "gaps_s"}:
        lost: Any = {name: 1000}
        assert judged(point, RecordingQuality(**lost), bad=20), name


def test_the_words_of_the_format_count_too(point: MakePoint) -> None:
    assert "were lost" in judged(point, RecordingQuality(), bad=20, quality={"device_overflow": 3})[0]


def test_what_was_lost_in_known_gaps_is_judged_by_their_length(point: MakePoint) -> None:
    short = RecordingQuality(dropped_buffers=1, overflows=2, gaps_s=((0.1, 0.11),))
    assert judged(point, short, bad=20) == ()
    # The gap lies in a part that is not looked at.
    assert judged(point, short, bad=20, gaps_s=np.zeros((0, 2))) == ()


def test_few_decode_errors_among_many_events_are_none(point: MakePoint) -> None:
    assert judged(point, RecordingQuality(decode_errors=8), bad=20) == ()
    # An import kept a tenth of the events: the errors are those of all.
    quality = {"decode_errors": 50, "outside_roi": 6000, "after_end": 3000}
    assert judged(point, RecordingQuality(), bad=20, quality=quality) == ()
    assert judged(point, RecordingQuality(), bad=20, quality={"decode_errors": 50}) != ()


def test_edges_without_a_trigger_count_by_their_share(point: MakePoint) -> None:
    def found(lost: Any, **attributes: Any) -> tuple[str, ...]:
        quality = {"edges_without_trigger": lost, "triggers_without_edge": 0}
        return judged(point, RecordingQuality(), bad=3, quality=quality, attributes=attributes)

    what = "more than 10% of the edges of the light have no trigger in 3 of 20 points"
    assert found(2, **BY_TRIGGER) == ()  # of 20
    assert found(3, **BY_TRIGGER) == (what,)
    assert found(3) == (what,)  # who placed them is not said
    assert found(20, time_axis="from_events") == ()
    assert found("unknown", **BY_TRIGGER) == ()


def test_what_a_run_does_not_say_is_no_reason(point: MakePoint) -> None:
    assert judged(point, RecordingQuality(), bad=20, quality={}) == ()
    assert cautions_of(problem([point(0, 0.3)])) == ()


def test_other_reasons_are_as_they_were(point: MakePoint) -> None:
    few = findings_of(problem([point(0, 0.0, n_events=12)]))
    assert few == ("12 events in all points; expected 100 or more",)
    doubtful = judged(point, RecordingQuality(), bad=3, quality={"time_doubtful": 1})
    assert doubtful == ("when the light changed is doubtful in 3 of 20 points",)
    invalid = judged(point, RecordingQuality(), bad=3, pulse_valid=np.zeros(20, np.bool_))
    assert invalid == ("60 of 400 test pulses are marked as not valid, as by lost triggers",)
    empty = point(0, 0.0, n_events=1000, waveform="reset_test")
    assert findings_of(problem([empty])) == ("there are neither test pulses nor constant light",)


def queued(t_s: Any, seed: int = 2) -> np.ndarray[Any, Any]:
    """Return events of random pixels at these times."""
    rng = np.random.default_rng(seed)
    found = np.zeros(len(t_s), EVENT_DTYPE)
    found["t"], found["p"] = np.sort(1e6 * np.asarray(t_s)), 1
    found["x"], found["y"] = 40 + rng.integers(0, 8, len(t_s)), 30 + rng.integers(0, 8, len(t_s))
    return found


def test_a_readout_at_its_limit_is_told_and_no_reason(point: MakePoint) -> None:
    steady = queued(np.linspace(1.0, 1.15, 30_000, endpoint=False))
    free = queued(1.0 + 0.15 * np.random.default_rng(3).random(30_000))
    made = {"n_events": 30_000, "refractory_s": float("nan")}
    points = [point(0, 0.3, stored=steady, **made), point(1, 0.3, stored=free, **made)]
    assert findings_of(problem(points)) == ()
    assert cautions_of(problem(points)) == (
        "the readout was the limit in 1 of 2 points, at 2e+05 events/s and more: pixels wait for each other, or "
        "events are lost",
    )
    assert cautions_of(problem(points[1:])) == ()
    # 64 pixels with a dead time of 0.3 ms could not do more.
    assert cautions_of(problem([replace(points[0], refractory_s=3e-4)])) == ()


def test_a_simulated_readout_at_its_limit_is_told(point: MakePoint, run_of: Callable[..., Any]) -> None:
    asked = point(0, 2.0, periods=2, roi=Roi(40, 30, 48, 48), refractory_s=1e-3)
    pixel = PixelModel(noise_rms=0.03, corner_hz=300.0, theta_on=0.2, theta_off=0.2, refractory_s=1e-3)
    assert cautions_of(problem(run_of([asked], pixel, 3).points())) == ()
    queue = ReadoutSaturation(max_rate_eps=2e5, fifo_events=1e5)
    (told,) = cautions_of(problem(run_of([asked], pixel + queue, 3).points()))
    assert "at 2e+05 events/s" in told


def test_a_rate_near_what_a_camera_transfers_is_told(point: MakePoint) -> None:
    burst = queued(1.0 + 1e-3 * np.arange(95_000) / 95_000)
    (told,) = cautions_of(problem([point(0, 0.3, stored=burst, n_events=len(burst))]))
    assert "at 9.5e+07 events/s" in told


HEADER: dict[str, Any] = {
    "id": "a-test",
    "sensor": {"name": "S", "width": 128, "height": 128, "pixel_pitch_m": 4.86e-6, "quantum_efficiency": 0.6},
    "roi": {"x": 0, "y": 0, "width": 128, "height": 128},
}  # fmt: skip


def recorded(folder: Path, events: np.ndarray[Any, Any], **quality: Any) -> list[PointData]:
    """Return a point of a run folder: a square wave of 100 periods, in a window that is larger than is looked at."""
    edges_s = np.linspace(0.0, 10.0, 201)
    pulses = PulseRecord(edges_s[1:], edges_s[1:] + 0.05, (np.arange(200) % 2).astype(np.uint8))
    record = PointRecord(
        0, "square", "both", 10.0, 0.3, 10.05, 0.0,
        stimulus=StimulusRecord(edges_s, 10.0 * np.exp(0.3 * (np.arange(201) % 2))), pulses=pulses,
        roi=Roi(0, 0, 128, 128), attributes=BY_TRIGGER, quality=as_recorded(RecordingQuality()) | quality,
    )  # fmt: skip
    with RunWriter(folder, HEADER) as writer, writer.point(0) as file:
        file.append(EventChunk(events, empty_triggers()))
        writer.finish(file, record)
    return list(Run.open(folder).points())


def test_of_a_recording_that_is_looked_at_in_part_all_counts(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    times_s = np.concatenate([10.0 * rng.random(30_000), np.linspace(1.0, 1.1, 20_000, endpoint=False)])
    events = queued(times_s)
    events["x"], events["y"] = rng.integers(0, 128, (2, len(events)))
    for lost, bad in ((20, False), (21, True)):
        points = recorded(tmp_path / f"{lost}", events, edges_without_trigger=lost, decode_errors=400)
        part = beginnings(middles(points), 3_000)
        assert part[0].stimulus_t_s.size < 100
        assert part[0].roi.pixels == 64 * 64
        assert bool(findings_of(problem(part))) == bad, "edges are those of the file, events those of its window"
        # In the middle of the window the queue's events scatter: some of them are of other pixels.
        assert "the readout was the limit in 1 of 1 points" in cautions_of(problem(part))[0]
