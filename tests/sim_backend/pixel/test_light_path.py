"""What source, filter and surroundings make of the commanded light."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from protocols.errors import InputError
from protocols.points import Roi
from sim_backend.pixel import LightHistory, PixelModel, build_chain
from sim_backend.pixel.light_path import ChipLight

if TYPE_CHECKING:
    import numpy.typing as npt

PLAIN = build_chain(PixelModel(), Roi(0, 0, 1, 1), 0)
DT_S = 1e-3
LIGHT = LightHistory(np.array([0.0, 0.002, 0.004]), np.array([3.0, 7.0, 1.0]), nd_od=np.array([0.0, 3.0, 3.0]))
ROOM = LightHistory(LIGHT.t_s, LIGHT.lux + 0.5, nd_od=LIGHT.nd_od, room_lux=0.5)


def on_chip(light: LightHistory, samples: int = 6, seed: int = 1, **changes: Any) -> npt.NDArray[np.float64]:
    return ChipLight(dataclasses.replace(PLAIN, **changes), light, DT_S, seed).lux(0, samples)


def test_a_plain_chain_leaves_the_light_alone() -> None:
    assert on_chip(LIGHT).tolist() == [3.0, 3.0, 7.0, 7.0, 1.0, 1.0]
    assert on_chip(ROOM).tolist() == [3.5, 3.5, 7.5, 7.5, 1.5, 1.5]


@pytest.mark.parametrize(("light", "room_lux"), [(LIGHT, 0.0), (ROOM, 0.5)])
def test_each_change_is_that_of_its_definition_and_spares_the_room(light: LightHistory, room_lux: float) -> None:
    t_s = np.arange(6) * DT_S
    source = np.array([3.0, 3.0, 7.0, 7.0, 1.0, 1.0])
    expected: dict[str, Any] = {
        "contrast_gain": (2.0, 3.0 * (source / 3.0) ** 2),
        "drift_per_s": (0.5, source * (1.0 + 0.5 * t_s)),
        "nd_error_od": (0.1, source * np.where(t_s < 0.002, 1.0, 10.0**-0.1)),
    }
    for name, (value, lux) in expected.items():
        changed: dict[str, Any] = {name: value}
        assert on_chip(light, **changed) == pytest.approx(lux + room_lux, rel=1e-12)
    assert on_chip(light, stray_lux=0.25) == pytest.approx(source + room_lux + 0.25, rel=1e-12)


def test_the_order_is_drift_flicker_filter_stray() -> None:
    t_s = np.arange(6) * DT_S
    lux = on_chip(
        LIGHT, drift_per_s=1.0, flicker_depth=0.3, flicker_hz=70.0, flicker_phase=0.4, nd_error_od=0.2, stray_lux=0.1
    )
    source = np.array([3.0, 3.0, 7.0, 7.0, 1.0, 1.0]) * (1.0 + t_s)
    source *= 1.0 + 0.3 * np.sin(2.0 * math.pi * 70.0 * t_s + 0.4)
    assert lux == pytest.approx(source * np.where(t_s < 0.002, 1.0, 10.0**-0.2) + 0.1, rel=1e-12)


def test_the_rise_comes_before_the_drift_and_after_the_contrast() -> None:
    light = LightHistory(np.array([0.0, 0.002]), np.array([1.0, 3.0]), rise_tau_s=1e-3)
    lux = on_chip(light, contrast_gain=2.0, drift_per_s=10.0)
    since = np.maximum(np.arange(6) - 2.0, 0.0)
    assert lux == pytest.approx((9.0 - 8.0 * np.exp(-since)) * (1.0 + 0.01 * np.arange(6)), rel=1e-12)


def test_a_light_that_drifts_away_is_off_and_not_negative() -> None:
    light = LightHistory.constant(2.0)
    assert on_chip(light, samples=5, drift_per_s=-500.0).tolist() == [2.0, 1.0, 0.0, 0.0, 0.0]


def test_the_phase_of_flicker_belongs_to_the_recording() -> None:
    light = LightHistory.constant(2.0)
    ripple: dict[str, Any] = {"flicker_depth": 0.5, "flicker_hz": 100.0}
    one, again, other = (on_chip(light, seed=s, **ripple) for s in (1, 1, 2))
    assert np.array_equal(one, again)
    assert not np.allclose(one, other)
    starts = [on_chip(light, samples=1, seed=s, **ripple)[0] for s in range(500)]
    assert np.mean(starts) == pytest.approx(2.0, abs=4.0 * math.sqrt(0.5 / 500))
    assert np.var(starts) == pytest.approx(0.5, rel=0.15)


def test_the_baseline_of_the_contrast_is_the_first_level_that_lasts_and_is_lit() -> None:
    for t_s, lux in (([0.0, 0.0, 0.002], [9.0, 1.0, 2.0]), ([0.0, 0.001, 0.002], [0.0, 1.0, 2.0])):
        light = LightHistory(np.array(t_s), np.array(lux))
        assert on_chip(light, samples=4, contrast_gain=2.0)[1:].tolist() == pytest.approx([1.0, 4.0, 4.0])


def test_two_rise_times_are_refused() -> None:
    light = LightHistory(np.zeros(1), np.ones(1), rise_tau_s=1e-3)
    with pytest.raises(InputError, match="both given"):
        on_chip(light, rise_tau_s=1e-3)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"nd_od": -1.0}, "optical density"),
        ({"nd_od": np.ones(2)}, "optical density"),
        ({"room_lux": 2.0}, "light of the room"),
        ({"room_lux": np.nan}, "light of the room"),
    ],
)
def test_nonsense_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        LightHistory(LIGHT.t_s, LIGHT.lux, **changes)
