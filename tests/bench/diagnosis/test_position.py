"""Rows and columns of pixels that answer alike."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bench.diagnosis.recorded.position import patterns, pixel_map
from protocols.points import Roi

if TYPE_CHECKING:
    from collections.abc import Callable


def z_of(share: Any) -> dict[str, float]:
    return {p.along: p.z for p in patterns(share)}


def test_random_pixels_have_no_pattern() -> None:
    rng = np.random.default_rng(1)
    deviates = np.array([list(z_of(rng.normal(0.0, 0.1, (12, 12))).values()) for _ in range(150)])
    # 150 draws: the mean of a normal deviate is known to 0.08, its standard deviation to 0.06
    assert np.abs(deviates.mean(axis=0)).max() < 0.33
    assert np.abs(deviates.std(axis=0) - 1.0).max() < 0.24


def test_a_row_a_column_and_a_gradient_are_found_each_as_what_it_is() -> None:
    rng = np.random.default_rng(2)
    noise = rng.normal(0.0, 0.05, (12, 12))
    row = noise.copy()
    row[4] += 0.3
    assert z_of(row)["rows"] > 3.5
    assert abs(z_of(row)["columns"]) < 3.0
    assert z_of(row.T)["columns"] > 3.5
    slope = noise + 0.2 * np.linspace(-0.5, 0.5, 12)[:, None]
    found = {p.along: p for p in patterns(slope)}
    assert found["from top to bottom"].z > 5.0
    assert found["from top to bottom"].size == pytest.approx(0.2, abs=0.05)
    assert abs(found["from left to right"].z) < 4.0


def test_one_hot_pixel_makes_no_row() -> None:
    share = np.random.default_rng(3).normal(0.0, 0.05, (12, 12))
    share[3, 3] = 1e6
    assert max(abs(z) for z in z_of(share).values()) < 3.5


def test_no_pattern_where_pixels_are_missing_or_all_alike() -> None:
    share = np.zeros((4, 4))
    assert all(z == 0.0 for z in z_of(share).values())
    share[0, 0] = np.nan
    assert patterns(share) == ()
    assert patterns(np.zeros((1, 8))) == ()


def test_the_map_is_by_how_much_more_often_a_pixel_answers(
    point: Callable[..., Any], recorded: Callable[..., Any]
) -> None:
    asked = point(0, 0.5, periods=2, roi=Roi(40, 30, 2, 2))
    edges = (asked.pulse_start_s[asked.pulse_kind == 0] * 1e6).astype(int)
    taken = recorded(asked, [(int(t) + 1000, 1, 0, 1) for t in edges])
    share = pixel_map([taken])
    # ON pulses: one pixel of four answers them all; OFF pulses: none answers. Mean over both.
    assert share.tolist() == [[-0.125, 0.375], [-0.125, -0.125]]
