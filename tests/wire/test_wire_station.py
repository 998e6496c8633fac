"""A protocol through the real drivers, byte by byte, gives the events of the simulated devices."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from bench.analysis.whole import analyze
from bench.run import run_protocol
from bench.station import load_station
from bench.store import Run
from protocols import load_protocol
from tests.wire.wire_rigs import DEVICE_TIMED, HOST_TIMED, shares_differ, simulated_twin

if TYPE_CHECKING:
    from pathlib import Path

PROTOCOL = """
format: evs-bench-protocol/1
title: A short look
seed: 3
roi: {x: 632, y: 352, width: 6, height: 4}
expect: {dark_light_lux: 0.146}
settings:
  long_refractory_period_s: 0.010
  imbalanced_thresholds: {on: 0.30, off: 0.25}
  bandwidth_hz: 200
pulses: 5
measurements:
  - name: "on"
    stimulus: &pair
      kind: reset_test
      polarity: on
      gap_s: 0.040
      reset_s: 0.040
      reset_direction: same
      reset_contrast: {scale: linear, value: 1.2}
      test_s: 0.040
    sweep: &sweep
      illuminance_lux: [0.1, 100]
      nd_od: {od: 3.0, below_lux: 0.9}
      contrast: {scale: threshold, values: [0.8, 1.3]}
  - name: "off"
    stimulus: {<<: *pair, polarity: off}
    sweep: *sweep
  - name: background
    stimulus: {kind: constant, duration_s: 2}
    sweep: {illuminance_lux: [1]}
"""


@pytest.fixture(name="protocol")
def short_protocol(tmp_path: Path) -> Path:
    path = tmp_path / "short.yaml"
    path.write_text(PROTOCOL)
    return path


def test_events_are_those_of_the_simulated_devices(protocol: Path, tmp_path: Path) -> None:
    loaded = load_protocol(protocol)
    wire = load_station("wire")
    runs = [
        Run.open(run_protocol(loaded, station, tmp_path / name).folder)
        for name, station in (("twin", simulated_twin(wire, DEVICE_TIMED)), ("wire", wire))
    ]
    pairs = list(zip(*(run.points() for run in runs), strict=True))
    assert len(pairs) == 9
    total = 0
    for twin, real in pairs:
        events, seen = (np.concatenate([*point.events()]) for point in (twin, real))
        np.testing.assert_array_equal(events, seen)
        np.testing.assert_array_equal(twin.triggers_t_us, real.triggers_t_us)
        np.testing.assert_allclose(twin.stimulus_lux, real.stimulus_lux)
        np.testing.assert_allclose(twin.stimulus_t_s, real.stimulus_t_s, atol=1e-9)
        assert real.quality["dropped_buffers"] == real.quality["decode_errors"] == 0
        total += len(events)
    assert total > 500


def test_counts_are_those_of_a_simulated_source_timed_by_the_host(protocol: Path, tmp_path: Path) -> None:
    """The RS-7 steps when its words arrive; other seeds, so that equal counts would be chance."""
    loaded, wire = load_protocol(protocol), load_station("wire_rs7")
    run_protocol(loaded, wire, tmp_path / "wire")
    run_protocol(loaded, simulated_twin(wire, HOST_TIMED), tmp_path / "twin", seed=77)
    real, twin = (
        analyze(Run.open(tmp_path / name), pixel_maps=False, theta_fit=lambda _: None).responses
        for name in ("wire", "twin")
    )
    assert len(real) == len(twin) == 8
    assert min(shares_differ(a, b) for a, b in zip(real, twin, strict=True)) * len(real) > 0.01
    for point in Run.open(tmp_path / "wire").points():
        assert point.attributes["time_axis"] == ("trigger" if point.pulse_start_s.size else "edges_known")
