"""What every light source does, real or simulated."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from drivers.errors import OutOfRange, WrongState
from drivers.interfaces import Waveform

if TYPE_CHECKING:
    from tests.contract.conftest import LightRig


def steps(rig: LightRig, period_s: float = 0.05) -> Waveform:
    """Return ten levels between the lowest and three times that."""
    lowest = rig.light.limits.lowest
    return Waveform(np.arange(10, dtype=np.float64) * period_s, np.array([lowest, 3.0 * lowest] * 5), 10 * period_s)


def test_says_what_it_is(light_rig: LightRig) -> None:
    light = light_rig.light
    assert light.timing in ("host", "device")
    assert 0.0 < light.limits.lowest < light.limits.highest
    assert light.limits.unit
    assert light.edge_time_s >= 0.0
    assert light.settling_s >= 0.0


def test_is_dark_after_connect(light_rig: LightRig) -> None:
    light_rig.light.connect()
    assert light_rig.light.level() == 0.0
    assert light_rig.is_dark()


def test_level_is_read_back(light_rig: LightRig) -> None:
    light = light_rig.light
    light.connect()
    for level in (light.limits.lowest, light.limits.highest, 0.0):
        light.set_level(level)
        assert light.level() == pytest.approx(level, rel=1e-3)
        assert light_rig.is_dark() == (level == 0.0)


@pytest.mark.parametrize("factor", [0.5, -1.0, 2.0, float("inf"), float("nan")])
def test_level_out_of_range_is_refused_and_changes_nothing(light_rig: LightRig, factor: float) -> None:
    light = light_rig.light
    light.connect()
    light.set_level(2.0 * light.limits.lowest)
    before = light.level()
    bad = factor * (light.limits.lowest if factor < 1.0 else light.limits.highest)
    with pytest.raises(OutOfRange) as caught:
        light.set_level(bad)
    assert str(caught.value) == (
        f"{light.name}: set level to {bad:g} {light.limits.unit}: "
        f"allowed is {light.limits.lowest:g} to {light.limits.highest:g} {light.limits.unit}"
    )
    assert light.level() == before


def test_waveform_out_of_range_is_refused_before_it_begins(light_rig: LightRig) -> None:
    light, before_s = light_rig.light, light_rig.clock.now
    light.connect()
    light.set_level(2.0 * light.limits.lowest)
    level, now = light.level(), before_s()
    bad = Waveform(np.array([0.0, 0.1]), np.array([light.limits.lowest, 2.0 * light.limits.highest]), 0.2)
    with pytest.raises(OutOfRange, match="allowed is"):
        light.play(bad)
    assert light.level() == level
    assert light_rig.clock.now() - now < 0.1


def test_play_returns_a_time_for_each_edge(light_rig: LightRig) -> None:
    light, waveform = light_rig.light, steps(light_rig)
    light.connect()
    played = light.play(waveform)
    assert len(played.t_s) == len(waveform.t_s)
    assert np.all(np.diff(played.t_s) > 0.0)
    if light.timing == "device":
        assert played.t_s[0] == 0.0
        np.testing.assert_allclose(played.t_s, waveform.t_s, atol=1e-6)
    for times in (played.t_written_s, played.t_acknowledged_s, played.t_settled_s):
        assert times is None or len(times) == len(waveform.t_s)
    if played.t_written_s is not None:
        assert np.all(played.t_written_s <= played.t_s)
        assert np.all(played.t_written_s >= waveform.t_s - 1e-6)
    if played.t_settled_s is not None:
        assert np.all(played.t_settled_s >= played.t_s)


def test_play_takes_its_time_and_ends_at_the_last_level(light_rig: LightRig) -> None:
    light, waveform = light_rig.light, steps(light_rig)
    light.connect()
    begin_s = light_rig.clock.now()
    light.play(waveform)
    assert light_rig.clock.now() - begin_s == pytest.approx(waveform.duration_s, abs=0.02)
    assert light.level() == pytest.approx(waveform.level[-1], rel=1e-3)


def test_a_single_level_can_be_played(light_rig: LightRig) -> None:
    light = light_rig.light
    light.connect()
    begin_s = light_rig.clock.now()
    played = light.play(Waveform(np.zeros(1), np.array([light.limits.lowest]), 0.3))
    assert len(played.t_s) == 1
    assert light_rig.clock.now() - begin_s == pytest.approx(0.3, abs=0.02)


def test_is_dark_after_an_error_and_safe_state(light_rig: LightRig) -> None:
    light = light_rig.light
    light.connect()
    light.set_level(light.limits.highest)
    with pytest.raises(OutOfRange):
        light.set_level(2.0 * light.limits.highest)
    light.safe_state()
    assert light.level() == 0.0
    light.safe_state()
    assert light_rig.is_dark()


def test_is_dark_after_close(light_rig: LightRig) -> None:
    light_rig.light.connect()
    light_rig.light.set_level(light_rig.light.limits.highest)
    light_rig.light.close()
    assert light_rig.is_dark()


def test_needs_a_connection(light_rig: LightRig) -> None:
    light = light_rig.light
    with pytest.raises(WrongState, match="not connected"):
        light.set_level(light.limits.lowest)
    with pytest.raises(WrongState, match="not connected"):
        light.level()
    with pytest.raises(WrongState, match="not connected"):
        light.play(steps(light_rig))
    assert light_rig.is_dark()
