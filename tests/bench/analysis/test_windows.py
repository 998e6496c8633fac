"""Response windows and reset windows: which pulses count, from which edge, and for how long."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from bench.analysis.windows import kept_pulses, microseconds, reset_windows
from bench.analysis.windows import test_windows as windows_of


def test_microseconds_are_the_first_at_or_after() -> None:
    assert microseconds([0.103, 0.1030001, 1e-6, 0.0]).tolist() == [103000, 103001, 1, 0]


def test_square_wave_has_two_groups_and_its_halves_follow_each_other(square: Any) -> None:
    found = windows_of(square(0.3, periods=3, half_s=0.1))
    assert [(g.polarity, g.pulses, g.log_contrast) for g in found.groups] == [("on", 3, 0.3), ("off", 3, 0.3)]
    assert [g.width_s for g in found.groups] == pytest.approx([0.1, 0.1])
    assert found.start_us.tolist() == [100_000 * (i + 1) for i in range(6)]
    assert found.polarity.tolist() == [1, 0] * 3
    assert found.follows.tolist() == [False] + [True] * 5


def test_invalid_cut_off_and_gapped_pulses_do_not_count(square: Any) -> None:
    valid = np.array([True, False, True, True, True, True])
    point = square(0.3, periods=3, half_s=0.1, pulse_valid=valid, gaps_s=np.array([[0.35, 0.36]]), duration_s=0.65)
    assert kept_pulses(point).tolist() == [0, 3, 4]
    found = windows_of(point)
    assert found.left_out == 3
    assert found.follows.tolist() == [False, False, True], "with a pulse missing between them two do not follow"


def test_a_gap_that_only_touches_a_window_spares_it(square: Any) -> None:
    point = square(0.3, periods=1, half_s=0.1, gaps_s=np.array([[0.05, 0.1]]))
    assert kept_pulses(point).tolist() == [0, 1]


def test_pulses_of_different_contrast_are_groups_of_their_own(square: Any) -> None:
    point = square(0.3, periods=2, half_s=0.1, pulse_log_contrast=np.array([0.1, 0.1, 0.2, 0.2]))
    assert {(g.polarity, g.log_contrast) for g in windows_of(point).groups} == {
        ("on", 0.1),
        ("on", 0.2),
        ("off", 0.1),
        ("off", 0.2),
    }


@pytest.mark.parametrize(("kind", "rearming"), [(0, 0), (1, 1)])
def test_the_return_of_a_reset_rearms_with_the_other_polarity(reset_test: Any, kind: int, rearming: int) -> None:
    point = reset_test(0.3, pulses=2, kind=kind, reset=0.4)
    tests = windows_of(point)
    found = reset_windows(point, tests)
    assert found.start_us.tolist() == [500_000, 1_300_000]
    assert found.stop_us.tolist() == [600_000, 1_400_000]
    assert found.polarity.tolist() == [rearming] * 2
    assert tests.groups[0].width_s == pytest.approx(0.2)
    assert tests.groups[0].window_s == pytest.approx(0.04)
    assert tests.groups[0].reset_log_contrast == pytest.approx(0.4 if kind == 0 else -0.4)


def test_a_reset_the_other_way_is_rearmed_by_the_direction_of_its_return(reset_test: Any) -> None:
    point = reset_test(0.3, pulses=2, kind=0, reset=-0.4)
    assert reset_windows(point, windows_of(point)).polarity.tolist() == [1, 1]


def test_a_window_that_begins_before_its_pulse_counts_latency_from_the_edge(reset_test: Any) -> None:
    starts = np.array([0.59, 1.39])
    point = reset_test(0.3, pulses=2, pulse_start_s=starts, pulse_stop_s=starts + 0.05)
    assert windows_of(point).edge_us.tolist() == [600_000, 1_400_000]


def test_without_a_stimulus_the_window_stands_for_the_pulse(square: Any) -> None:
    empty = np.zeros(0)
    found = windows_of(square(0.3, periods=2, half_s=0.1, stimulus_t_s=empty, stimulus_lux=empty))
    assert found.edge_us.tolist() == found.start_us.tolist()
    assert found.groups[0].width_s == pytest.approx(0.1)


def test_overlapping_windows_are_noticed(square: Any) -> None:
    point = square(0.3, periods=3, half_s=0.1)
    wide = square(0.3, periods=3, half_s=0.1, pulse_stop_s=np.minimum(point.pulse_start_s + 0.25, point.duration_s))
    assert not windows_of(point).overlapping
    assert windows_of(wide).overlapping
