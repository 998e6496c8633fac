"""What every filter wheel does, real or simulated."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from drivers.errors import WrongState

if TYPE_CHECKING:
    from tests.contract.conftest import WheelRig


def test_says_what_it_has(wheel_rig: WheelRig) -> None:
    filters = wheel_rig.wheel.filters
    names = [f.name for f in filters]
    assert filters
    assert len(set(names)) == len(names)
    assert all(f.nd_od >= 0.0 for f in filters)


def test_a_filter_is_in_after_connect(wheel_rig: WheelRig) -> None:
    wheel_rig.wheel.connect()
    assert wheel_rig.wheel.selected() in [f.name for f in wheel_rig.wheel.filters]


def test_each_filter_can_be_selected_and_is_in_the_light(wheel_rig: WheelRig) -> None:
    wheel = wheel_rig.wheel
    wheel.connect()
    for f in (*wheel.filters, *reversed(wheel.filters)):
        wheel.select(f.name)
        assert wheel.selected() == f.name
        assert wheel_rig.transmission() == pytest.approx(10.0**-f.nd_od)


def test_unknown_filter_is_refused_and_nothing_moves(wheel_rig: WheelRig) -> None:
    wheel = wheel_rig.wheel
    wheel.connect()
    wheel.select(wheel.filters[-1].name)
    with pytest.raises(WrongState, match=f"^{wheel.name}: .*no such filter; it has .*{wheel.filters[0].name}"):
        wheel.select("no such")
    assert wheel.selected() == wheel.filters[-1].name


def test_a_move_takes_time_and_staying_does_not(wheel_rig: WheelRig) -> None:
    wheel, clock = wheel_rig.wheel, wheel_rig.clock
    wheel.connect()
    wheel.select(wheel.filters[0].name)
    begin_s = clock.now()
    wheel.select(wheel.filters[-1].name)
    moved_s = clock.now() - begin_s
    wheel.select(wheel.filters[-1].name)
    assert moved_s > 0.0
    assert clock.now() - begin_s - moved_s < moved_s


def test_needs_a_connection(wheel_rig: WheelRig) -> None:
    with pytest.raises(WrongState, match="not connected"):
        wheel_rig.wheel.select(wheel_rig.wheel.filters[0].name)
    with pytest.raises(WrongState, match="not connected"):
        wheel_rig.wheel.selected()
