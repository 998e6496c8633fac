"""Verdicts on points of a simulated bench: as it is, and with something wrong."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from bench.run.plan import plan_or_raise
from bench.run.recorder import Recorder
from bench.run.verdict import Limits, Seen, Verdict, judge
from bench.station import Station
from bench.store.point_writer import PointWriter
from drivers.events.types import EventChunk
from protocols import parse_protocol
from sim_backend.devices.camera import SimulatedCamera

if TYPE_CHECKING:
    from pathlib import Path

StationMaker = Callable[..., Station]

_PROTOCOL = """\
format: evs-bench-protocol/1
title: Points to be judged
seed: 5
roi: {x: 10, y: 20, width: 8, height: 8}
expect: {dark_light_lux: 0.1}
settings: {refractory_period_s: 0.005, thresholds: {on: 0.3, off: 0.25}, bandwidth_hz: 500}
pulses: 20
measurements:
  - name: "on"
    stimulus: {kind: reset_test, polarity: "on", reset_s: 0.04, test_s: 0.04,
               reset_contrast: {scale: log, value: 0.8}}
    sweep:
      illuminance_lux: [100]
      contrast: {scale: log, values: [0.1, 0.3, 0.8]}
  - name: "square"
    stimulus: {kind: square, frequency_hz: 5}
    sweep: {illuminance_lux: [100], contrast: {scale: log, values: [0.8]}}
  - name: "dim"
    stimulus: {kind: constant, duration_s: 5}
    sweep: {illuminance_lux: [0.1], nd_od: [2]}
"""


class _Shaded(SimulatedCamera):
    """Sees nothing any more after the first half of each recording."""

    def chunks(self) -> Any:
        everything = [chunk for chunk in super().chunks() if len(chunk.events)]
        middle = max(chunk.events["t"][-1] for chunk in everything) / 2
        for chunk in everything:
            yield EventChunk(chunk.events[chunk.events["t"] < middle], chunk.triggers)


def _verdicts(station: Station, folder: Path) -> list[Verdict]:
    points = plan_or_raise(parse_protocol(_PROTOCOL, "judged.yaml").protocol.expand(), station)
    found = []
    with station:
        station.connect()
        recorder = Recorder(station, points[0].point.roi)
        for planned in points:
            recorder.prepare(planned)
            seen, chunks = Seen(planned.point.roi), station.camera.chunks

            def watched(chunks: Any = chunks, seen: Seen = seen) -> Any:
                for chunk in chunks():
                    seen.add(chunk)
                    yield chunk

            station.camera.chunks = watched  # type: ignore[method-assign]
            with PointWriter(folder / f"{planned.point.index}.h5") as writer:
                record = recorder.take(planned, writer)
                assert seen.n_events == writer.n_events + sum(map(len, writer._held))
            station.camera.chunks = chunks  # type: ignore[method-assign]
            found.append(judge(record, planned, seen, Limits(dark_light_lux=0.1, triggers_expected=True)))
    return found


def test_points_of_a_sound_bench_are_green(make_station: StationMaker, tmp_path: Path) -> None:
    assert _verdicts(make_station(), tmp_path) == [Verdict("green", ())] * 5


def test_points_whose_light_went_out_are_red(make_station: StationMaker, tmp_path: Path) -> None:
    found = _verdicts(make_station(camera=_Shaded), tmp_path)
    assert [verdict.light for verdict in found[:4]] == ["red"] * 4
    assert all(verdict.reasons[0].startswith(("silence from ", "drift: ")) for verdict in found[:4])
