"""What reference runs say of drift."""

from __future__ import annotations

import csv
import math
from typing import TYPE_CHECKING

import numpy as np
import pytest

from bench.queueing.drift import Reading, drift_of, drift_rows, write_drift

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path


def readings(values: Sequence[float], error: float, name: str = "theta") -> list[Reading]:
    half = 1.6449 * error
    return [Reading(n, "t", name, "ln", v, v - half, v + half) for n, v in enumerate(values, start=1)]


def test_a_steady_quantity_has_a_chi_square_of_one() -> None:
    rng = np.random.default_rng(3)
    (drift,) = drift_of(readings(list(0.3 + 0.002 * rng.standard_normal(2000)), 0.002))
    assert drift.chi2_per_dof == pytest.approx(1.0, abs=0.1)
    assert drift.runs == 2000


def test_a_drift_is_seen_with_its_size_and_error() -> None:
    (drift,) = drift_of(readings(list(np.linspace(0.30, 0.33, 7)), 0.002))
    assert drift.change == pytest.approx(0.03)
    assert drift.change_error == pytest.approx(0.002 * math.sqrt(2))
    assert drift.chi2_per_dof > 20.0
    assert drift_rows([drift]) == [
        ("theta", "ln", "7", "0.3000 +- 0.0020", "0.3300 +- 0.0020", "+0.0300 +- 0.0028", "29.17")
    ]


def test_small_counts_do_not_look_like_drift() -> None:
    """The interval of a count of few events is lopsided; a symmetric error would see drift where there is none."""
    from scipy.special import gammaincinv

    def interval(count: int) -> tuple[float, float]:
        return (float(gammaincinv(count, 0.05)) if count else 0.0), float(gammaincinv(count + 1, 0.95))

    counts = np.random.default_rng(5).poisson(4.0, size=400)
    rows = [Reading(n, "t", "rate", "Hz", float(c), *interval(int(c))) for n, c in enumerate(counts)]
    (drift,) = drift_of(rows)
    assert 0.4 < drift.chi2_per_dof < 1.3


def test_one_reading_has_no_change_and_what_is_not_determined_is_left_out() -> None:
    one = readings([0.3, math.nan], 0.01)
    (drift,) = drift_of(one)
    assert (drift.runs, math.isnan(drift.change), math.isnan(drift.chi2_per_dof)) == (1, True, True)
    assert drift_rows([drift])[0][2:] == ("1", "0.300 +- 0.010", "0.300 +- 0.010", "", "")
    assert drift_of([]) == []


def test_all_readings_go_into_a_table(tmp_path: Path) -> None:
    path = write_drift(readings([0.3, math.nan], 0.01), tmp_path)
    rows = list(csv.DictReader(path.read_text().splitlines()))
    assert [row["run"] for row in rows] == ["1", "2"]
    assert rows[0]["value"] == "0.3"
    assert rows[1]["value"] == ""
