"""Dark light from readings, and the errors that go into it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bench.analysis.results import Estimate
from bench.characterize.readings import Reading, Uncertainties, line_through, of_level
from bench.characterize.weber import contrast_needed
from bench.photometry.propagation import Known

Z = 1.6448536269514722
LEVELS = (0.076, 0.152, 0.304, 1.0, 10.0, 300.0)


def reading(lux: float, contrast: float, sd: float, nd_od: float = 0.0) -> Reading:
    return Reading(lux, nd_od, Estimate(contrast, contrast - Z * sd, contrast + Z * sd, "ln"))


@pytest.mark.parametrize("polarity", ["on", "off"])
def test_exact_readings_give_back_threshold_and_dark_light(polarity: str) -> None:
    lowest = 0.5 if polarity == "off" else 0.0
    taken = [
        reading(lux, contrast_needed(0.3, lux, 0.2, polarity), 0.001)  # type: ignore[arg-type]
        for lux in LEVELS
        if lux > lowest
    ]
    line = line_through(taken, polarity)  # type: ignore[arg-type]
    assert line is not None
    assert line.theta.value == pytest.approx(0.3, rel=1e-9)
    assert line.dark_lux.value == pytest.approx(0.2, rel=1e-9)
    assert line.chi2 == pytest.approx(0.0, abs=1e-12)


def test_the_interval_of_a_line_holds_the_truth_as_often_as_it_says() -> None:
    rng = np.random.default_rng(3)
    sd, runs, held = 0.005, 600, 0
    for _ in range(runs):
        taken = [reading(lux, contrast_needed(0.3, lux, 0.2, "on") + rng.normal(0.0, sd), sd) for lux in LEVELS]
        line = line_through(taken, "on")
        assert line is not None
        held += line.dark_lux.low <= 0.2 <= line.dark_lux.high
    # Widened where the levels scatter by chance, it holds a little more than 90 %; 4 standard errors are 5 %.
    assert 0.87 < held / runs < 0.98


def test_scatter_of_the_levels_widens_the_interval() -> None:
    off = [0.02, -0.02, 0.02, -0.02, 0.02, -0.02]
    taken = [
        reading(lux, contrast_needed(0.3, lux, 0.2, "on") + d, 0.002) for lux, d in zip(LEVELS, off, strict=True)
    ]
    calm = [reading(lux, contrast_needed(0.3, lux, 0.2, "on"), 0.002) for lux in LEVELS]
    wide, narrow = line_through(taken, "on"), line_through(calm, "on")
    assert wide is not None
    assert narrow is not None
    assert wide.chi2 / wide.dof > 10.0
    assert wide.dark_lux.high - wide.dark_lux.low > 3.0 * (narrow.dark_lux.high - narrow.dark_lux.low)


def test_one_level_is_no_line_and_unknown_readings_are_left_out() -> None:
    unknown = Reading(0.1, 0.0, Estimate(math.nan, math.nan, math.nan, "ln"))
    assert line_through([reading(1.0, 0.35, 0.01), unknown], "on") is None
    assert line_through([reading(1.0, 0.35, 0.01), reading(1.0, 0.36, 0.01, 3.0)], "on") is None


def test_the_parts_of_an_error_are_those_of_the_formula() -> None:
    theta, contrast, lux = 0.35, 0.8, 0.076
    beside = Uncertainties(light=0.05, contrast=0.01, nd_od=0.02)
    found = of_level(reading(lux, contrast, 0.004, nd_od=3.0), Known(theta, 0.01), "on", beside)
    r, w = math.exp(contrast), math.expm1(theta)
    dark = lux * (r - math.exp(theta)) / w
    by_theta = -lux * math.exp(theta) * (r - 1.0) / w**2
    assert found.value == pytest.approx(dark, rel=1e-9)
    assert found.parts["illuminance"] == pytest.approx(0.05 * dark, rel=1e-6)
    assert found.parts["filter"] == pytest.approx(-0.02 * math.log(10.0) * dark, rel=1e-4)
    assert found.parts["curve"] == pytest.approx(0.004 * lux * r / w, rel=1e-4)
    assert found.parts["contrast"] == pytest.approx(0.01 * lux * r / w, rel=1e-4)
    assert found.parts["theta"] == pytest.approx(0.01 * by_theta, rel=1e-3)
    assert found.sd == pytest.approx(math.hypot(*found.parts.values()), rel=1e-9)
