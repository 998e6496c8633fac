"""Formulas near the dark limit, against published numbers and each other."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.characterize.cutoff import predicted_cutoff
from bench.characterize.weber import contrast_needed, dark_light, signal_of, threshold_of, weber
from bench.photometry.current import Photodiode
from bench.photometry.propagation import Known

#: Log contrasts that an ON event needs with 146.26 mlux of dark light and a threshold of 0.35.
TABLE = {0.076: 0.800, 0.1: 0.709, 0.152: 0.600, 0.2: 0.545, 0.304: 0.483, 0.6: 0.420, 3.0: 0.364, 30.0: 0.351}


def test_dark_light_of_the_published_curve() -> None:
    dark = dark_light(0.8, 0.076, 0.35)
    assert dark == pytest.approx(0.1463, abs=5e-5)
    diode = Photodiode(Known(1.0), Known(4.86e-6), Known(1.12e16))
    assert diode.current(Known(dark)).value == pytest.approx(6.199, abs=5e-4)


@pytest.mark.parametrize(("lux", "contrast"), TABLE.items())
def test_contrasts_that_levels_need(lux: float, contrast: float) -> None:
    assert contrast_needed(0.35, lux, 0.14626, "on") == pytest.approx(contrast, abs=1e-3)


def test_the_published_cutoff_implies_another_dark_light() -> None:
    dark = dark_light(math.log(2.0), 0.080, 0.25)
    assert dark == pytest.approx(0.2017, abs=5e-5)
    back = predicted_cutoff(math.log(2.0), Known(0.25), Known(dark))
    assert back is not None
    assert back.value == pytest.approx(0.080, rel=1e-9)


def test_no_step_down_is_large_enough_below_a_level() -> None:
    lowest = 0.14626 * math.expm1(0.35)
    assert lowest == pytest.approx(0.061, abs=5e-4)
    assert math.isinf(contrast_needed(0.35, 0.99 * lowest, 0.14626, "off"))
    assert math.isfinite(contrast_needed(0.35, 1.01 * lowest, 0.14626, "off"))


@given(
    st.floats(0.02, 2.0), st.floats(0.01, 1e3), st.floats(0.0, 2.0), st.sampled_from(["on", "off"])
)  # fmt: skip
def test_the_step_that_is_needed_changes_the_signal_by_the_threshold(
    theta: float, lux: float, dark: float, polarity: str
) -> None:
    step = contrast_needed(theta, lux, dark, polarity)  # type: ignore[arg-type]
    if math.isinf(step):
        assert weber(theta, "off") * (1.0 + dark / lux) >= 1.0
        return
    sign = 1.0 if polarity == "on" else -1.0
    changed = abs(math.log((lux * math.exp(sign * step) + dark) / (lux + dark)))
    assert changed == pytest.approx(theta, rel=1e-6)
    assert signal_of(step, lux, dark, polarity) == pytest.approx(theta, rel=1e-6)  # type: ignore[arg-type]
    assert threshold_of(weber(step, polarity), polarity) == pytest.approx(step, rel=1e-6)  # type: ignore[arg-type]


def test_sensitivities_near_the_dark_limit() -> None:
    base = dark_light(0.8, 0.076, 0.35)
    assert -0.10 < dark_light(0.8, 0.076, 0.36) / base - 1.0 < -0.05
    assert 0.025 < dark_light(0.81, 0.076, 0.35) / base - 1.0 < 0.08
