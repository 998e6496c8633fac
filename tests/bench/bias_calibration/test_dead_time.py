"""The dead time from what cameras read back."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import pytest

from bench.bias_calibration.dead_time import dead_time_table

if TYPE_CHECKING:
    from bench.store.data import PointData

MAP = {"refractory_s": {"bias": "bias_refr", "calibrated": False, "table": [[-20, 0.02], [0, 0.005], [60, 0.001]]}}
BENCH: dict[str, Any] = {"world": None, "sealed_world": None, "calibration": {"bias_map": MAP}}


def points(*read: tuple[int, float]) -> list[PointData]:
    made = [SimpleNamespace(bias={"bias_refr": float(offset)}, refractory_s=value) for offset, value in read]
    return cast("list[PointData]", made)


def test_the_mean_of_each_offset_with_its_scatter() -> None:
    found = dead_time_table("bias_refr", points((-20, 0.0212), (0, 0.0051), (0, 0.0053), (60, 0.0011)), BENCH)
    assert [(row.offset, row.value) for row in found.rows] == [(-20, 0.0212), (0, 0.0052), (60, 0.0011)]
    assert found.rows[1].sd == pytest.approx(0.0001 / 0.0052, rel=1e-3)
    assert found.rows[2].sd == pytest.approx(1e-6 / math.sqrt(12.0) / 0.0011)  # a microsecond, rounded
    assert found.usable


def test_what_is_only_the_map_again_was_not_measured() -> None:
    again = points((-20, 0.02), (0, 0.005), (60, 0.001))
    found = dead_time_table("bias_refr", again, BENCH)
    assert not found.rows
    assert "the camera did not measure them" in found.remarks[0]
    # Of a simulated station the map is what the camera does, so that the same values were read back.
    assert dead_time_table("bias_refr", again, {**BENCH, "world": {"class": "a:B"}}).usable
    assert dead_time_table("bias_refr", points((-20, 0.02), (0, 0.00501)), BENCH).usable
    assert dead_time_table("bias_refr", again, {"name": "blind"}).usable


def test_nothing_read_back_and_nothing_swept() -> None:
    unread = dead_time_table("bias_refr", points((-20, math.nan), (0, math.nan)), BENCH)
    assert "does not read its dead time back" in unread.remarks[0]
    assert "several offsets of bias_refr" in dead_time_table("bias_refr", points((0, 0.01)), BENCH).remarks[0]
