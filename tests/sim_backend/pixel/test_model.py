"""The pixel model: description, bounds, effects, and its form in a file."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
import yaml

from protocols.errors import InputError
from protocols.points import Roi
from sim_backend.pixel import Photoconversion, PixelModel, build_chain
from sim_backend.pixel.chain import PixelDraws
from sim_backend.pixel.effects import (
    STAGES,
    DarkCurrent,
    LightRiseTime,
    StrayLight,
    ThresholdMismatch,
    effect_class,
    effects,
)

ROI = Roi(100, 200, 8, 4)
FULL = (
    PixelModel(noise_rms=0.04, corner_hz=120.0, theta_on=0.3, theta_off=0.25, refractory_s=8e-3)
    + DarkCurrent(mean_fa=8.0, spread=0.3)
    + ThresholdMismatch(sigma_on=0.035, sigma_off=0.03)
    + StrayLight(illuminance_lux=0.02)
    + LightRiseTime(tau_s=1e-3)
)


def test_photoconversion_is_42_4_fa_per_lux_times_eta_at_4_86_um() -> None:
    assert Photoconversion(eta=0.5, pitch_m=4.86e-6).gain_fa_per_lux == pytest.approx(0.5 * 42.4, rel=1e-3)


def test_a_model_survives_yaml() -> None:
    text = yaml.safe_dump(FULL.to_dict())
    assert PixelModel.from_dict(yaml.safe_load(text)) == FULL


def test_a_file_may_name_only_what_differs() -> None:
    model = PixelModel.from_dict({"theta_on": 0.2, "effects": {"dark_current": None}})
    assert model == PixelModel(theta_on=0.2) + DarkCurrent()


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({"effects": {"dark_curent": {}}}, "did you mean dark_current"),
        ({"effects": {"zzz": {}}}, "known are comparator_delay, "),
        ({"effects": {"dark_current": {"mean": 3}}}, "did you mean mean_fa"),
        ({"theta_onn": 0.3}, "did you mean theta_on"),
        ({"photoconversion": {"etta": 0.3}}, "did you mean eta"),
        ({"photoconversion": {"eta": 1.3}}, "expected a number from 1e-06 to 1"),
        ({"theta_on": "0.3"}, "theta_on is '0.3'; expected a number"),
        ({"noise_rms": True}, "noise_rms is True; expected a number"),
        ({"corner_hz": float("nan")}, "corner_hz is nan"),
        ({"effects": {"dark_current": {"mean_fa": -1}}}, "effect dark_current: mean_fa is -1"),
        ({"effects": ["dark_current"]}, "expected names with values"),
    ],
)
def test_what_is_wrong_is_named(data: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        PixelModel.from_dict(data)


def test_all_bad_values_are_reported_at_once() -> None:
    with pytest.raises(InputError) as caught:
        PixelModel(theta_on=-1.0, corner_hz=0.0)
    assert len(caught.value.problems) == 2


def test_an_effect_is_added_once_and_can_be_taken_away() -> None:
    with pytest.raises(InputError, match="dark_current is there more than once"):
        FULL + DarkCurrent()
    assert FULL.effect("dark_current") == DarkCurrent(mean_fa=8.0, spread=0.3)
    assert FULL.without("dark_current").effect("dark_current") is None
    weaker = DarkCurrent(mean_fa=1.0)
    assert FULL.changed(weaker).effects == tuple(weaker if e.id == "dark_current" else e for e in FULL.effects)
    assert PixelModel().changed(weaker) == PixelModel()
    with pytest.raises(TypeError):
        PixelModel() + 3  # type: ignore[operator]


def test_effects_act_in_the_order_of_the_signal() -> None:
    assert [e.stage for e in FULL.effects] == ["light", "light", "photocurrent", "comparators"]
    assert PixelModel() + DarkCurrent() + StrayLight() == PixelModel() + StrayLight() + DarkCurrent()


@pytest.mark.parametrize("effect_id", sorted(effects()))
def test_every_effect_describes_itself(effect_id: str) -> None:
    cls = effect_class(effect_id)
    assert cls.id == effect_id
    assert cls.stage in STAGES
    assert cls.__doc__
    assert "Source:" in cls.__doc__
    assert cls.sign.endswith(".")
    names = [f.name for f in dataclasses.fields(cls)]  # type: ignore[arg-type]
    assert [p.name for p in cls.parameters()] == names
    for p in cls.parameters():
        assert p.default is None or p.bounds[0] <= p.default <= p.bounds[1]
        assert p.null is None or p.bounds[0] <= p.null <= p.bounds[1]
        assert p.unit
        assert p.doc
    assert cls().values() == {p.name: p.default for p in cls.parameters()}


@pytest.mark.parametrize("effect_id", sorted(effects()))
def test_an_effect_at_its_null_value_leaves_the_chain_alone(effect_id: str) -> None:
    model = PixelModel()
    null = effect_class(effect_id).null()
    roi = Roi(0, 0, 100, 50)  # large enough for a hot pixel
    same, changed = (build_chain(m, roi, 1) for m in (model + null, model + effect_class(effect_id)()))
    base = build_chain(model, roi, 1)
    differs = []
    for field in dataclasses.fields(base):
        before, after = getattr(base, field.name), getattr(same, field.name)
        assert np.array_equal(before, after), field.name
        differs.append(not np.array_equal(before, getattr(changed, field.name)))
    assert any(differs)


def test_a_pixel_is_the_same_in_every_window() -> None:
    whole = build_chain(FULL, Roi(98, 198, 20, 10), 7)
    part = build_chain(FULL, ROI, 7)
    where = {(x, y): i for i, (x, y) in enumerate(zip(whole.x, whole.y, strict=True))}
    index = [where[xy] for xy in zip(part.x, part.y, strict=True)]
    for name in ("dark_fa", "theta_on", "theta_off"):
        assert np.array_equal(getattr(whole, name)[index], getattr(part, name))
        assert not np.array_equal(getattr(build_chain(FULL, ROI, 8), name), getattr(part, name))


def test_the_window_is_taken_row_by_row() -> None:
    chain = build_chain(PixelModel(), Roi(5, 9, 3, 2), 0)
    assert chain.x.tolist() == [5, 6, 7, 5, 6, 7]
    assert chain.y.tolist() == [9, 9, 9, 10, 10, 10]
    assert chain.pixels == 6


def test_spreads_over_the_pixels() -> None:
    chain = build_chain(FULL, Roi(0, 0, 300, 200), 3)
    n = chain.pixels
    log = np.log(chain.dark_fa)
    assert chain.dark_fa.mean() == pytest.approx(8.0, abs=4 * chain.dark_fa.std() / np.sqrt(n))
    assert log.std() == pytest.approx(0.3, abs=4 * 0.3 / np.sqrt(2 * n))
    assert chain.theta_on.mean() == pytest.approx(0.3, abs=4 * 0.035 / np.sqrt(n))
    assert chain.theta_on.std() == pytest.approx(0.035, rel=4 / np.sqrt(2 * n))
    assert chain.theta_off.std() == pytest.approx(0.03, rel=4 / np.sqrt(2 * n))
    assert abs(np.corrcoef(chain.theta_on, chain.theta_off)[0, 1]) < 4 / np.sqrt(n)
    assert chain.stray_lux == 0.02
    assert chain.rise_tau_s == 1e-3


def test_thresholds_are_at_least_a_hundredth() -> None:
    model = PixelModel(theta_on=0.02) + ThresholdMismatch(sigma_on=0.5)
    chain = build_chain(model, Roi(0, 0, 50, 50), 3)
    assert chain.theta_on.min() == 0.01


def test_even_draws_have_the_share_that_is_asked_for() -> None:
    """Of 10 x 10 pixels 3.7 % are three or four, 3.7 on average, and never another number; of real sensors not so."""
    y, x = (axis.ravel().astype(np.uint16) for axis in np.mgrid[:10, :10])
    even = np.array([np.sum(PixelDraws(x, y, seed, even=True).uniform("hot") < 0.037) for seed in range(400)])
    drawn = np.array([np.sum(PixelDraws(x, y, seed).uniform("hot") < 0.037) for seed in range(400)])
    assert set(even) == {3, 4}
    assert np.mean(even) == pytest.approx(3.7, abs=4.0 * np.sqrt(0.7 * 0.3 / 400))
    assert np.var(drawn) == pytest.approx(100 * 0.037 * 0.963, rel=4.0 * np.sqrt(2.2 / 400))


def test_even_draws_keep_the_order_of_the_pixels() -> None:
    """Another share adds pixels, or takes some out: differences between models are sharp."""
    y, x = (axis.ravel().astype(np.uint16) for axis in np.mgrid[:8, :8])
    plain, even = PixelDraws(x, y, 5).uniform("hot"), PixelDraws(x, y, 5, even=True).uniform("hot")
    np.testing.assert_array_equal(np.argsort(plain), np.argsort(even))
    assert 0.0 <= even.min() < even.max() < 1.0
