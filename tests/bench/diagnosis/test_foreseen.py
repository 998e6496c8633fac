"""Points that were not taken yet: what is planned, and how far two models would be apart there."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bench.compute import Workforce
from bench.diagnosis.searching.foreseen import apart_at, planned_points
from bench.diagnosis.session import open_session
from protocols import load_protocol
from protocols.points import Roi
from sim_backend.pixel import PixelModel
from sim_backend.pixel.effects.dark_current import DarkCurrent
from sim_backend.pixel.effects.stray_light import StrayLight

if TYPE_CHECKING:
    from collections.abc import Callable

MODEL = PixelModel(theta_on=0.15, theta_off=0.25, noise_rms=0.03, corner_hz=300.0)


def test_points_are_planned_in_the_thresholds_of_the_model(point: Callable[..., Any]) -> None:
    like = replace(point(0, 0.3), roi=Roi(600, 300, 48, 12), refractory_s=3e-3)
    protocol = [replace(p, ambient="shrouded") for p in load_protocol("on_family").protocol.expand()]
    found = planned_points(protocol, like, MODEL, 16)
    assert 20 < len(found) <= 36
    assert {p.roi for p in found} == {Roi(600, 300, 16, 12)}
    assert {p.refractory_s for p in found} == {3e-3}
    assert {p.attributes["ambient"] for p in found} == {"shrouded"}
    # The protocol prescribes 0.30 for ON: half of its contrasts are the same in thresholds.
    halves = np.array([0.5 * p.log_contrast for p in protocol])
    assert all(np.abs(halves - p.log_contrast).min() < 1e-12 for p in found)
    assert {p.baseline_lux for p in found} == {p.baseline_lux for p in protocol}
    for one in found:
        assert np.all(one.pulse_stop_s <= one.duration_s)
        assert one.n_events == 0


@pytest.mark.slow
def test_a_shroud_tells_stray_light_from_dark_current_and_nothing_tells_a_model_from_itself(
    point: Callable[..., Any], run_of: Callable[..., Any]
) -> None:
    lux_of_2_fa = 2.0 / 25.4  # about: what 2 fA is at 0.6 efficiency and 4.86 um
    asked = [point(i, c, lux) for i, (c, lux) in enumerate([(0.0, 0.1), (0.3, 0.1), (0.6, 0.1), (0.2, 10.0)])]
    run = run_of(asked, MODEL + DarkCurrent(2.0), 3)
    with open_session([run], MODEL + DarkCurrent(2.0), Workforce(1)) as session:
        fitted = session.fit(1)
        dim = [p for p in load_protocol("on_family").protocol.expand() if p.baseline_lux < 0.3][::6]
        shrouded = [replace(p, ambient="shrouded") for p in dim]
        points = planned_points(shrouded, run.taken[0], fitted.model, 16)
        same = apart_at(session.problem, fitted, fitted.model, points, 1.0, 5)
        stray = fitted.model.without("dark_current") + StrayLight(lux_of_2_fa)
        other = apart_at(session.problem, fitted, stray, points, 1.0, 5)
        opened = planned_points(dim, run.taken[0], fitted.model, 16)
        unshrouded = apart_at(session.problem, fitted, stray, opened, 1.0, 5)
    assert same == 0.0
    # Half of the light of these levels is dark light: without it they answer more often, and nothing else is known.
    assert other > 5.0
    assert unshrouded < 0.5 * other
