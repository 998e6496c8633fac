"""What every clock does, real or simulated."""

from __future__ import annotations

import pytest

from drivers.interfaces import Clock


def test_is_a_clock(clock: Clock) -> None:
    assert isinstance(clock, Clock)


def test_never_goes_back(clock: Clock) -> None:
    times = [clock.now() for _ in range(100)]
    assert times == sorted(times)


def test_sleep_lets_time_pass(clock: Clock) -> None:
    begin_s = clock.now()
    clock.sleep(0.01)
    assert clock.now() - begin_s >= 0.00999
    clock.sleep(0.0)


def test_negative_sleep_is_refused(clock: Clock) -> None:
    before_s = clock.now()
    with pytest.raises(ValueError, match=r"sleep|negative"):
        clock.sleep(-1.0)
    assert clock.now() >= before_s
