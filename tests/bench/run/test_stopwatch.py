"""How much is left of a run: trials that failed cost time, pauses do not count."""

from __future__ import annotations

import pytest

from bench.run.progress import Stopwatch


class _Clock:
    now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def test_the_time_left_follows_from_what_the_points_cost() -> None:
    clock = _Clock()
    watch = Stopwatch([1.0, 1.0, 2.0], clock)
    assert watch.status(0, "").left_s is None
    clock.now_s = 10.0
    assert watch.status(1, "").left_s == pytest.approx(30.0)


def test_a_trial_that_failed_does_not_make_the_rest_look_longer() -> None:
    clock = _Clock()
    watch = Stopwatch([1.0, 1.0], clock)
    clock.now_s = 20.0
    watch.again(1.0)
    assert watch.status(1, "").left_s == pytest.approx(10.0)


def test_a_pause_is_left_out_of_account() -> None:
    clock = _Clock()
    watch = Stopwatch([1.0, 1.0], clock)
    clock.now_s = 10.0
    with watch.standing():
        clock.now_s = 5000.0
    status = watch.status(1, "", 1)
    assert status.left_s == pytest.approx(10.0)
    assert status.skipped == 1
