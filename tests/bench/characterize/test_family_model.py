"""What a family is expected to be: how mismatch shows in the answers of single pixels, of either sign by chance."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from bench.analysis.results import CurveKey
from bench.characterize.family_model import Family, expected
from bench.characterize.levels import Level, Reset

if TYPE_CHECKING:
    from bench.analysis.results import ResponsePolarity

SENSOR = Family(
    theta=0.3, noise_rms=0.04, mismatch2=0.0, ln_tau=math.log(8e-4), delay_s=0.0, dark_lux=0.05, dark_spread2=0.0,
    shot_lux=0.0, slow_s_lux=0.0, filter_od=0.0,
)  # fmt: skip
OFF_NOISE = replace(SENSOR, shot_lux=2e-4)  # as the light falls its noise grows, and blurs the curve beyond mismatch


def level(polarity: ResponsePolarity) -> Level:
    contrast = np.linspace(0.2, 0.5, 8)
    return Level(
        key=CurveKey("reset_test", polarity, baseline_lux=1.0, nd_od=0.0, pulse_width_s=0.05, settings=""),
        contrast=contrast, pulses=np.full(8, 100.0), share=np.zeros((4, 8)), timed=np.array([5, 6]),
        latency_s=np.zeros(2), latency_sd_s=np.ones(2), window_s=0.05, grid_s=1e-5,
        reset=Reset(contrast=0.6, gap_s=0.05, dead_s=0.01),
    )  # fmt: skip


def by_slopes(sensor: Family, polarity: ResponsePolarity) -> float:
    """Return, for a unit of variance, the covariance that slopes lead to: that of a small mismatch."""
    step = 1e-3
    up, down = (expected(level(polarity), replace(sensor, theta=0.3 + s), 0.8).share for s in (step, -step))
    slope = (up - down) / (2.0 * step)
    return float(slope[::2].sum() * slope[1::2].sum())


@pytest.mark.parametrize("sensor", [SENSOR, OFF_NOISE])
@pytest.mark.parametrize("polarity", ["on", "off"])
@pytest.mark.parametrize("mismatch2", [1e-5, -1e-5])
def test_mismatch_makes_answers_agree_by_its_variance(
    sensor: Family, polarity: ResponsePolarity, mismatch2: float
) -> None:
    found = expected(level(polarity), replace(sensor, mismatch2=mismatch2), 0.8)
    # Second order: mismatch is 3e-3, a tenth of the noise.
    assert found.frozen == pytest.approx(mismatch2 * by_slopes(sensor, polarity), rel=0.1)
    assert np.all(found.spread >= 0.0)
    assert bool(found.spread.max() > 0.0) == (mismatch2 > 0.0)


def test_without_mismatch_pixels_agree_by_chance_alone() -> None:
    found = expected(level("on"), SENSOR, 0.8)
    assert abs(found.frozen) < 1e-9
    assert found.spread.max() < 1e-9
