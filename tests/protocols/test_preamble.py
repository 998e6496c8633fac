"""The preamble of unequal gaps."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from protocols.estimation import recording_s
from protocols.points import Preamble
from protocols.preamble import marks, with_preamble
from protocols.schema import Protocol
from protocols.waveforms import square_edges, stimulus_of


@pytest.mark.parametrize("edges", [4, 6, 8, 10])
def test_all_distances_in_a_preamble_differ(edges: int) -> None:
    at_s = marks(Preamble(1.0, edges, 0.04))
    assert len(at_s) == edges
    assert at_s[0] == 0.0
    apart = np.round((at_s[:, None] - at_s)[np.tril_indices(edges, -1)] / 0.04).astype(int)
    assert len(set(apart.tolist())) == len(apart)
    assert min(np.diff(at_s)) == pytest.approx(0.04)


def test_a_stimulus_behind_a_preamble_keeps_its_windows() -> None:
    square = square_edges(period_s=0.2, duty=0.5, low_lux=1.0, high_lux=2.0, cycles=3, first_edge_s=0.1)
    longer = with_preamble(square, Preamble(math.log(10.0), 4, 0.05))
    np.testing.assert_allclose(longer.t_s[:5], [0.0, 0.1, 0.15, 0.3, 0.4])
    np.testing.assert_allclose(longer.lux[:6], [1.0, 10.0, 1.0, 10.0, 1.0, 2.0])
    np.testing.assert_allclose(longer.t_s[5:], square.t_s[1:] + 0.5)
    np.testing.assert_allclose(longer.pulse_start_s, square.pulse_start_s + 0.5)
    assert longer.duration_s == pytest.approx(square.duration_s + 0.5)
    assert np.all(np.diff(longer.t_s) > 0)


def protocol(**stimulus: Any) -> Protocol:
    return Protocol.model_validate(
        {
            "format": "evs-bench-protocol/1",
            "title": "with a preamble",
            "roi": {"x": 0, "y": 0, "width": 4, "height": 4},
            "pulses": 5,
            "measurements": [
                {
                    "name": "square",
                    "stimulus": {"kind": "square", "frequency_hz": 5.0, **stimulus},
                    "sweep": {"illuminance_lux": 10.0, "contrast": {"scale": "log", "values": [0.4]}},
                }
            ],
        }
    )


def test_a_protocol_with_a_preamble_makes_longer_points() -> None:
    (plain,), (marked,) = protocol().expand(), protocol(preamble={"contrast": 4, "edges": 6}).expand()
    light = stimulus_of(marked)
    assert marked.preamble == Preamble(math.log(5.0), 6, 0.04)
    assert light.lux[1] == pytest.approx(5.0 * light.lux[0])
    assert recording_s(marked) == pytest.approx(light.duration_s)
    assert light.duration_s == pytest.approx(stimulus_of(plain).duration_s + 0.2 + 17 * 0.04)
    again = Protocol.model_validate(protocol(preamble={"contrast": 4, "edges": 6}).resolved())
    assert again.expand() == (marked,)


def test_a_preamble_that_there_is_not_is_refused() -> None:
    with pytest.raises(ValueError, match="4, 6, 8 or 10"):
        protocol(preamble={"edges": 7})
    with pytest.raises(ValueError, match="greater than 0"):
        protocol(preamble={"unit_s": 0.0})
