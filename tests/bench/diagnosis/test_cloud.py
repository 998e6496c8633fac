"""Lines through a cloud of places: exact where there is no chance, and as uncertain as they say where there is."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pytest

from bench.diagnosis.fitting.cloud import Cloud, Place, around

if TYPE_CHECKING:
    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]

RNG = np.random.default_rng(8)
K, N = 3, 4000
SCALE = np.array([0.3, 0.7, 2.0])
MIDDLE = np.array([1.0, -2.0, 5.0])
SLOPE = RNG.standard_normal((N, K))


def place(at: Floats, chance: float = 0.0) -> Place:
    """Return what is expected on a plane, give or take."""
    value = 4.0 + SLOPE @ (at - MIDDLE) + chance * RNG.standard_normal(N)
    return Place(at, cast("Any", SimpleNamespace(value=value, value_or=lambda _: value)), 0.0)


def test_lines_through_a_plane_are_the_plane() -> None:
    cloud = Cloud([place(x) for x in (MIDDLE, *around(MIDDLE, SCALE, 0.1, 2 * K, RNG))])
    lines = cloud.lines(MIDDLE, SCALE, 0.5)
    assert lines.value == pytest.approx(np.full(N, 4.0), abs=1e-2)
    # The ridge makes slopes smaller by next to nothing.
    assert lines.slope == pytest.approx(SLOPE, rel=0.05, abs=1e-6)


def test_slopes_scatter_by_what_they_say() -> None:
    cloud = Cloud([place(x, 0.5) for x in (MIDDLE, *around(MIDDLE, SCALE, 0.4, 20, RNG))])
    lines = cloud.lines(MIDDLE, SCALE, 0.5)
    off = lines.slope - SLOPE
    # 4000 statistics with variance 0.25 each: variances are known to 2.2 %.
    assert np.mean(lines.scatter) == pytest.approx(0.25, rel=0.1)
    assert np.mean(off**2, axis=0) == pytest.approx(0.25 * np.diag(lines.chance), rel=0.12)


def test_what_a_place_says_nothing_about_is_no_value_of_zero() -> None:
    """Of no events there is no mean; that of the logarithms of others would not be zero."""
    places = [place(x) for x in (MIDDLE, *around(MIDDLE, SCALE, 0.1, 2 * K, RNG))]
    places[1].expected.value[:10] = np.nan
    lines = Cloud(places).lines(MIDDLE, SCALE, 0.5)
    # A zero would move the middle of 7 places by 4 / 7, and slopes by half of 4 / 0.1.
    assert lines.value == pytest.approx(np.full(N, 4.0), abs=0.1)
    assert lines.slope[10:] == pytest.approx(SLOPE[10:], rel=0.05, abs=1e-6)
    assert np.abs((lines.slope - SLOPE) * SCALE).max() < np.abs(SLOPE * SCALE).max()


def test_places_around_lie_in_opposite_pairs_at_right_angles() -> None:
    found = np.array(around(MIDDLE, SCALE, 0.1, 2 * K, RNG))
    away = (found - MIDDLE) / SCALE
    assert away[::2] == pytest.approx(-away[1::2])
    assert away[::2] @ away[::2].T == pytest.approx(0.01 * K * np.eye(K), abs=1e-12)
