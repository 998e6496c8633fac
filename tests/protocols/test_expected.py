"""Expected contrasts, against published figures and against the condition for an event itself."""

from __future__ import annotations

import math

import pytest

from protocols.expected import (
    Expected,
    log_response,
    off_impossible_at_lux,
    off_log_contrast,
    on_log_contrast,
    rearm_log_contrast,
    reset_return,
)
from protocols.points import Point, ResetTestTiming, Roi, Settings


@pytest.mark.parametrize(
    ("lux", "log_contrast"),
    [
        (0.076, 0.800),
        (0.100, 0.709),
        (0.152, 0.600),
        (0.200, 0.545),
        (0.304, 0.483),
        (0.600, 0.420),
        (3.0, 0.364),
        (30.0, 0.351),
    ],
)
def test_on_contrast_near_the_dark_limit(lux: float, log_contrast: float) -> None:
    # A dark light of 146.26 mlux and a threshold of 0.35: figures of the measured camera, to three digits.
    assert on_log_contrast(lux, 0.35, 0.14626) == pytest.approx(log_contrast, abs=6e-4)


@pytest.mark.parametrize("dark", [0.0, 0.02, 0.146])
@pytest.mark.parametrize("lux", [0.076, 1.0, 300.0])
@pytest.mark.parametrize("theta", [0.1, 0.3])
def test_contrasts_solve_the_condition_for_an_event(lux: float, theta: float, dark: float) -> None:
    up = lux * math.exp(on_log_contrast(lux, theta, dark))
    down = lux * math.exp(-off_log_contrast(lux, theta, dark))
    assert log_response(lux, up, dark) == pytest.approx(theta, rel=1e-12)
    assert log_response(lux, down, dark) == pytest.approx(-theta, rel=1e-12)
    assert off_log_contrast(lux, theta, dark) >= on_log_contrast(lux, theta, dark) >= theta * (1 - 1e-12)


def test_no_off_event_from_below_a_level() -> None:
    limit = off_impossible_at_lux(0.35, 0.14626)
    assert limit == pytest.approx(0.061, abs=5e-4)
    assert math.isinf(off_log_contrast(limit * 0.999, 0.35, 0.14626))
    assert math.isfinite(off_log_contrast(limit * 1.001, 0.35, 0.14626))
    assert log_response(limit, 0.0, 0.14626) == pytest.approx(-0.35, rel=1e-12)


@pytest.mark.parametrize(("lux", "linear"), [(0.076, 0.83), (0.152, 0.56)])
def test_the_reset_that_an_off_return_of_a_quarter_needs(lux: float, linear: float) -> None:
    needed = rearm_log_contrast("up", lux, 0.35, 0.25, 0.146)
    assert math.expm1(needed) == pytest.approx(linear, abs=5e-3)


def test_the_return_of_a_reset_of_half_near_the_dark_limit() -> None:
    point = reset_point("up", math.log(1.5))
    assert reset_return(point, 0.146) == pytest.approx(0.158, abs=5e-4)
    assert reset_return(point, 0.0) == pytest.approx(math.log(1.5), rel=1e-12)


@pytest.mark.parametrize("direction", ["up", "down"])
def test_rearming_contrast_gives_the_opposite_threshold_on_return(direction: str) -> None:
    theta_on, theta_off = 0.2, 0.3
    up = direction == "up"
    needed = rearm_log_contrast("up" if up else "down", 0.076, theta_on, theta_off, 0.146)
    back = reset_return(reset_point("up" if up else "down", needed), 0.146)
    assert back == pytest.approx(theta_off if up else theta_on, rel=1e-12)


def test_only_reset_test_points_have_a_reset() -> None:
    from protocols.points import ConstantTiming

    point = Point(0, "m", "constant", "both", 1.0, 0.0, 0, ConstantTiming(1.0), Roi(0, 0, 1, 1))
    with pytest.raises(TypeError, match="no reset pulse"):
        reset_return(point, 0.1)


def test_what_settings_prescribe_goes_before_what_is_believed() -> None:
    believed = Expected(theta_on=0.3, theta_off=0.25, dark_light_lux=0.1, bandwidth_hz=200.0, refractory_s=0.001)
    asked = Settings(theta_on=0.4, refractory_s=0.01)
    assert believed.under(asked) == Expected(0.4, 0.25, 0.1, 200.0, 0.01)


def reset_point(direction: str, log_contrast: float) -> Point:
    timing = ResetTestTiming(0.1, 0.1, log_contrast, "up" if direction == "up" else "down", 0.1, 0.1)
    return Point(0, "m", "reset_test", "on", 0.076, 0.5, 1, timing, Roi(0, 0, 1, 1))
