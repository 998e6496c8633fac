"""The points of a protocol, taken from a simulated pixel in memory."""

from __future__ import annotations

import numpy as np
import pytest

from bench.study.simulate import SimulatedRun
from protocols import parse_protocol
from sim_backend.pixel import FastEngine, PixelModel
from sim_backend.pixel.effects import DarkCurrent, NdError

PROTOCOL = """\
format: evs-bench-protocol/1
title: behind a filter
seed: 3
roi: {{x: 0, y: 0, width: 4, height: 4}}
pulses: 4
measurements:
  - name: "square"
    stimulus: {{kind: square, frequency_hz: 10}}
    sweep: {{illuminance_lux: [0.5], nd_od: {nd_od}, contrast: {{scale: log, values: [0.6]}}}}
"""


@pytest.mark.parametrize(("nd_od", "same"), [("[2.0]", False), ("[0.0]", True)])
def test_the_error_of_a_filter_acts_where_the_protocol_puts_one_in(nd_od: str, same: bool) -> None:
    points = parse_protocol(PROTOCOL.format(nd_od=nd_od), "filter.yaml").protocol.expand()
    model = PixelModel(noise_rms=0.05) + DarkCurrent(mean_fa=5.0)
    right, wrong = (
        np.concatenate([e for p in SimulatedRun(points, m, FastEngine(), "x").points() for e in p.events()])
        for m in (model, model + NdError(delta_od=0.3))
    )
    assert len(right) > 20
    assert np.array_equal(right, wrong) == same
