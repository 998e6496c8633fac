"""The numbers that are fitted: scales, bounds, and that the catalogue names what the effects have."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from bench.diagnosis.expected.catalogue import candidates, free_of, probe_of, why_not
from bench.diagnosis.expected.parameters import base_parameters, move, put
from sim_backend.pixel import PixelModel
from sim_backend.pixel.effects import DarkCurrent, Effect, HighPass, Leak, LightRiseTime
from sim_backend.pixel.effects.registry import effects

ALL = sorted(effects())


@pytest.mark.parametrize("effect_id", ALL)
def test_every_effect_can_be_probed_and_its_numbers_come_back(effect_id: str) -> None:
    effect = effects()[effect_id]
    free = free_of(effect)
    assert free
    model = PixelModel() + probe_of(effect)
    for one in free:
        low, high = one.range
        coordinate = one.coordinate(one.probe)
        assert low <= coordinate <= high
        assert one.value(coordinate) == pytest.approx(one.probe)
        moved = move(one, coordinate)
        assert low <= moved <= high
        assert moved != coordinate
    changed = put(model, free, [move(one, one.coordinate(one.probe)) for one in free])
    assert changed != model
    assert changed.without(effect_id) == PixelModel()


def test_a_coordinate_out_of_bounds_gives_a_value_within_them() -> None:
    bandwidth = free_of(effects()["photoreceptor_bandwidth"])[0]
    assert bandwidth.value(-1.0) == math.inf
    spread = free_of(effects()["threshold_mismatch"])[0]
    assert spread.value(-1.0) == 0.0


def test_numbers_that_have_either_sign() -> None:
    signed = {one.key for effect in effects().values() for one in free_of(effect) if one.signed}
    assert signed == {
        "contrast_error.gain_error", "injection_offset.offset", "light_drift.rate_per_s", "nd_error.delta_od",
    }  # fmt: skip


def test_numbers_of_the_base_pixel_are_put_where_they_belong() -> None:
    free = base_parameters(refractory_known=True)
    model = put(PixelModel() + DarkCurrent(mean_fa=2.0), free, [math.log(v) for v in (0.2, 0.3, 0.04, 150.0, 5e-3)])
    assert (model.theta_on, model.theta_off) == pytest.approx((0.2, 0.3))
    assert (model.noise_rms, model.corner_hz, model.refractory_s) == pytest.approx((0.04, 150.0, 5e-3))
    assert model.effects == (DarkCurrent(mean_fa=2.0),)


def test_what_other_thresholds_would_do_too_is_not_proposed() -> None:
    proposed = {e.id for e in candidates(PixelModel(), [])}
    assert not proposed & {"contrast_error", "injection_offset", "nd_error"}
    assert "dark_current" in proposed
    assert "dark_current" not in {e.id for e in candidates(PixelModel() + DarkCurrent(), [])}


@pytest.mark.parametrize(
    ("effect_id", "has", "reason"),
    [
        ("leak", (Leak(),), "the model has it already"),
        ("contrast_error", (Leak(),), "other thresholds do the same, and they are fitted"),
        ("nd_error", (Leak(),), "no filter was in the light"),
        (
            "photoreceptor_bandwidth",
            (LightRiseTime(), HighPass()),
            "beside what the model has it is simulated sample by sample, for hours",
        ),
    ],
)
def test_why_an_effect_is_not_looked_for_is_said(effect_id: str, has: tuple[Effect, ...], reason: str) -> None:
    model = PixelModel(effects=has)
    assert why_not(effects()[effect_id], model, []) == reason
    assert why_not(effects()["dark_current"], model, []) is None


def test_a_filter_is_not_looked_at_where_nothing_depends_on_how_much_light_there_is() -> None:
    """There what is simulated with the error differs from what is without by chance alone."""
    filtered: Any = SimpleNamespace(nd_od=3.0, stored_roi=None)
    nothing = why_not(effects()["nd_error"], PixelModel() + Leak(), [filtered])
    assert nothing == "nothing in the model depends on how much light there is"
    assert why_not(effects()["nd_error"], PixelModel() + Leak() + DarkCurrent(), [filtered]) is None
