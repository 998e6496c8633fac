"""Protocols through a function generator, a person who changes filters and an EVK4, byte by byte."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bench.analysis.whole import analyze
from bench.run import check, run_protocol
from bench.station import load_station, station_from
from bench.store import Run
from protocols import load_protocol, parse_protocol
from tests.wire.wire_rigs import shares_differ, simulated_twin

if TYPE_CHECKING:
    from pathlib import Path

    from bench.station import Station

PROTOCOL = """
format: evs-bench-protocol/1
title: Square waves, pairs and constant light
seed: 3
roi: {x: 632, y: 352, width: 6, height: 4}
expect: {dark_light_lux: 0.146}
settings:
  long_refractory_period_s: 0.010
  imbalanced_thresholds: {on: 0.30, off: 0.25}
  bandwidth_hz: 200
pulses: 4
measurements:
  - name: square
    stimulus: {kind: square, frequency_hz: 10, duty: 0.5}
    sweep:
      illuminance_lux: [0.1, 100]
      nd_od: {od: 3.0, below_lux: 0.9}
      contrast: {scale: log, values: [0.5]}
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
      illuminance_lux: [100]
      contrast: {scale: threshold, values: [1.0]}
  - name: "off"
    stimulus: {<<: *pair, polarity: off}
    sweep: *sweep
  - name: background
    stimulus: {kind: constant, duration_s: 2}
    sweep: {illuminance_lux: [1]}
"""
DEVICE_TIMED = {
    "timing": "device", "lowest": 0.02, "highest": 9.5, "unit": "V", "level_step": 1e-3, "rise_tau_s": 1e-4,
    "settling_s": 1e-3,
}  # fmt: skip


def speaking(dialect: str) -> Station:
    """Return the station with a generator of another maker."""
    plan: dict[str, Any] = load_station("wire_generator").resolved
    plan["roles"]["light"]["args"]["dialect"] = dialect
    plan["world"]["args"]["instruments"]["generator"]["dialect"] = dialect
    return station_from(plan, dialect)


def taken(station: Station, folder: Path, seed: int | None = None) -> Run:
    run_protocol(parse_protocol(PROTOCOL, "squares.yaml"), station, folder, seed=seed)
    return Run.open(folder)


@pytest.fixture(name="twins", scope="module")
def simulated_runs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Run, Run]:
    """Return the run of simulated devices, and another one with other random numbers."""
    folder = tmp_path_factory.mktemp("twins")
    station = load_station("wire_generator")
    return (
        taken(simulated_twin(station, DEVICE_TIMED), folder / "same"),
        taken(simulated_twin(station, DEVICE_TIMED), folder / "other", seed=77),
    )


@pytest.mark.parametrize("dialect", ["rigol", "siglent", "keysight"])
def test_a_run_is_that_of_the_simulated_devices(dialect: str, twins: tuple[Run, Run], tmp_path: Path) -> None:
    """Both levels of a square wave are exact, so that the events are the same; that of a test pulse has 14 bits.

    The camera sees when a burst begins, and when it is over, if that is before the end: no trigger marks an edge.
    """
    run = taken(speaking(dialect), tmp_path / "run")
    total = 0
    for twin, real in zip(twins[0].points(), run.points(), strict=True):
        assert real.quality["dropped_buffers"] == real.quality["decode_errors"] == 0
        assert real.log_contrast == twin.log_contrast
        assert real.triggers_p.tolist() in ([[1], [1, 0]] if len(real.pulse_start_s) else [[]])
        if real.attributes["measurement"] in ("square", "background"):
            events, seen = (np.concatenate([*point.events()]) for point in (twin, real))
            np.testing.assert_array_equal(events, seen)
            total += len(events)
    assert total > 200
    rows, others = (analyze(r, pixel_maps=False, theta_fit=lambda _: None).responses for r in (run, twins[1]))
    p_values = [shares_differ(a, b) for a, b in zip(rows, others, strict=True)]
    assert min(p_values) * len(p_values) > 0.01


def test_what_a_generator_cannot_time_is_said_before_the_run() -> None:
    text = PROTOCOL.replace("frequency_hz: 10, duty: 0.5", "frequency_hz: 0.0073, duty: 0.123457")
    station = speaking("siglent")
    report = check(parse_protocol(text, "slow.yaml").protocol, station)
    assert report.refused
    assert any("as samples: its edges lie on no common raster to 0.5 us" in str(f) for f in report.findings)


def test_quick_look_can_be_taken() -> None:
    for dialect in ("rigol", "siglent", "keysight"):
        assert not check(load_protocol("quick_look").protocol, speaking(dialect)).refused
