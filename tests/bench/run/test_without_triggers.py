"""A whole run on a bench whose trigger cable was left out: edges by events, no latencies, and it says so."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from bench.analysis import analyze
from bench.run import run_protocol
from bench.store.run import Run
from protocols import parse_protocol

if TYPE_CHECKING:
    from pathlib import Path

    from tests.bench.run.conftest import StationMaker

PROTOCOL = """\
format: evs-bench-protocol/1
title: no cable
seed: 5
roi: {x: 10, y: 20, width: 8, height: 8}
settings: {bandwidth_hz: 1000, long_refractory_period_s: 0.005}
pulses: 8
measurements:
  - name: "square"
    stimulus: {kind: square, frequency_hz: 5PREAMBLE}
    sweep:
      illuminance_lux: [100]
      contrast: {scale: log, values: [0.5, 1.0]}
"""
MARKED = PROTOCOL.replace("PREAMBLE", ", preamble: {contrast: 4}")


def test_the_events_tell_when_the_light_changed(make_station: StationMaker, tmp_path: Path) -> None:
    protocol = parse_protocol(MARKED, "p.yaml")
    run_protocol(protocol, make_station(), tmp_path / "cable")
    run_protocol(protocol, make_station(trigger_cable=False), tmp_path / "none")
    cable, none = Run.open(tmp_path / "cable"), Run.open(tmp_path / "none")
    for a, b in zip(cable.points(), none.points(), strict=True):
        assert (a.attributes["time_axis"], b.attributes["time_axis"]) == ("trigger", "from_events")
        np.testing.assert_array_equal(np.concatenate(list(a.events())), np.concatenate(list(b.events())))
        # The low-pass has 0.16 ms, of which the pixels' part before the threshold is known by its bandwidth.
        np.testing.assert_allclose(b.stimulus_t_s[1:], a.stimulus_t_s[1:], atol=2e-4, rtol=0.0)
        assert b.quality["time_doubtful"] == 0
    seen, blind = analyze(cable), analyze(none)
    assert [r.responses for r in blind.responses] == [r.responses for r in seen.responses]
    assert all(np.isnan(r.latency_median_s) and not r.latency_counts.any() for r in blind.responses)
    assert any(np.isfinite(r.latency_median_s) for r in seen.responses)
    assert any("no latencies" in text for text in blind.warnings)
    assert not any("no latencies" in text for text in seen.warnings)


def test_without_a_preamble_a_short_wave_is_doubtful_and_says_so(make_station: StationMaker, tmp_path: Path) -> None:
    protocol = parse_protocol(PROTOCOL.replace("PREAMBLE", ""), "p.yaml")
    run_protocol(protocol, make_station(trigger_cable=False), tmp_path / "run")
    run = Run.open(tmp_path / "run")
    assert [point.quality["time_doubtful"] for point in run.points()] == [1, 1]
    assert any("doubtful in 2 points; point 0" in text for text in analyze(run).warnings)


@pytest.mark.parametrize("value", ["3", "{edges: 7}", "{contrast: 0}"])
def test_a_preamble_that_there_is_not_is_refused(value: str) -> None:
    from protocols.errors import InputError

    with pytest.raises(InputError, match=r"p.yaml:\d+:\d+: .*preamble"):
        parse_protocol(PROTOCOL.replace("PREAMBLE", f", preamble: {value}"), "p.yaml")
