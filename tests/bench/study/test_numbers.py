"""What is concluded from the grids, on numbers made by hand."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

from bench.analysis.results import Estimate
from bench.compute import Workforce
from bench.study.claim_schema import Claim
from bench.study.claims import Verdict, judge
from bench.study.loading import load_study
from bench.study.numbers import BiasPoint, ResetPoint, acceptable_noise, recommendations
from bench.study.run import run_study

if TYPE_CHECKING:
    from bench.study.schema import Study


@pytest.fixture(scope="module")
def study() -> Study:
    return load_study("paper")


def estimate(value: float, reach: float = 0.01) -> Estimate:
    return Estimate(value, value - reach, value + reach, "1")


def bias(noise_rms: float, rate: float, value: float) -> BiasPoint:
    return BiasPoint("square", 50.0, 0.27, noise_rms, estimate(rate), estimate(value))


def reset(axis: str, value: float, bias: float, plateau: float, rearmed: float) -> ResetPoint:
    return ResetPoint(axis, value, estimate(bias), estimate(plateau), rearmed)


def test_noise_is_acceptable_up_to_the_last_place_within_five_per_cent() -> None:
    points = [bias(0.05, 0.1, -0.04), bias(0.03, 0.0, 0.01), bias(0.06, 1.0, -0.08)]
    (line,) = acceptable_noise(points)
    assert line == "square wave, 50 Hz, OFF threshold 0.27: up to rms 0.05 (background 0.1 Hz)"


def test_little_noise_may_be_too_little() -> None:
    (line,) = acceptable_noise([bias(0.03, 0.001, 0.08), bias(0.05, 0.1, 0.02), bias(0.06, 1.0, -0.08)])
    assert line.endswith("from rms 0.05 (background 0.1 Hz) to rms 0.05 (background 0.1 Hz)")


def test_noise_in_between_that_is_not_acceptable_is_left_out() -> None:
    """The bias rises from nothing, beyond five per cent, and falls through zero again."""
    values = [(0.01, 0.01), (0.02, 0.03), (0.03, 0.09), (0.04, math.nan), (0.05, 0.02), (0.06, -0.08)]
    (line,) = acceptable_noise([bias(rms, 0.1, value) for rms, value in values])
    up_to, between = line.split(": ")[1].split(", and ")
    assert up_to == "up to rms 0.02 (background 0.1 Hz)"
    assert between == "from rms 0.05 (background 0.1 Hz) to rms 0.05 (background 0.1 Hz)"


def test_a_place_without_an_intercept_is_not_the_least_bias() -> None:
    (line,) = acceptable_noise([bias(0.03, 0.1, math.nan), bias(0.05, 0.3, -0.2)])
    assert line.endswith("nowhere; the least bias is -20%, at rms 0.05 (background 0.3 Hz)")
    (line,) = acceptable_noise([bias(0.03, 0.1, math.nan)])
    assert line.endswith("no intercept was found")


def test_a_rate_of_nothing_is_given_as_its_limit_and_the_end_of_the_grid_is_said() -> None:
    (line,) = acceptable_noise([bias(0.03, 0.0, 0.01)])
    assert line.endswith("up to rms 0.03 (background less than 0.01 Hz), the most that was taken")


def test_noise_that_is_too_much_everywhere_is_said_with_the_least_bias() -> None:
    (line,) = acceptable_noise([bias(0.03, 0.2, -0.1), bias(0.05, 0.3, -0.2)])
    assert line.endswith("nowhere; the least bias is -10%, at rms 0.03 (background 0.2 Hz)")


def test_the_smallest_reset_that_rearms_is_chosen_and_the_window_with_the_least_bias() -> None:
    points = [
        reset("reset_contrast", 0.3, 0.0, 0.98, 0.90),
        reset("reset_contrast", 0.5, -0.05, 1.0, 0.999),
        reset("reset_contrast", 0.7, -0.05, 1.0, 1.0),
        reset("window_s", 0.01, 0.4, 1.0, 1.0),
        reset("window_s", 0.05, 0.02, 1.0, 1.0),
        reset("window_s", 0.2, -0.07, 1.0, 1.0),
    ]
    amplitude, window = recommendations(points)
    assert amplitude.startswith("reset amplitude (linear): 0.5 or more: 99.9% of the resets")
    assert window == "response window, s: 0.05: the intercept is off by +2.0%; at 0.2 by -7.0%"


def test_a_window_that_loses_answers_is_not_chosen_for_its_bias() -> None:
    points = [reset("window_s", 0.01, 0.0, 0.9, 1.0), reset("window_s", 0.2, -0.07, 1.0, 1.0)]
    assert recommendations(points)[0].startswith("response window, s: 0.2:")


def claim(**limits: float) -> Claim:
    return Claim.model_validate(
        {
            "name": "ratio",
            "by": "us",
            "source": "here",
            "says": "a ratio of 1",
            "quantity": "dark_light_ratio",
            "steps": [{"lux": 1.0, "log_contrast": 1.0, "theta": 0.5}] * 2,
            "unit": "1",
            "otherwise": "never",
            **limits,
        }
    )


@pytest.mark.parametrize(
    ("limits", "verdict"),
    [
        ({"expected": 1.0, "tolerance": 0.1}, "agrees"),
        ({"expected": 1.5, "factor": 1.6}, "agrees"),
        ({"expected": 1.5, "factor": 1.4}, "does not agree"),
        ({"above": 1.1}, "does not agree"),
        ({"below": 1.1}, "agrees"),
    ],
)
def test_each_form_of_expectation(study: Study, limits: dict[str, float], verdict: Verdict) -> None:
    (finding,) = judge(study.model_copy(update={"claims": (claim(**limits),)}), {})
    assert finding.measured.value == pytest.approx(1.0)
    assert finding.verdict == verdict


@pytest.mark.slow
def test_processes_change_nothing(study: Study) -> None:
    one, two = (run_study(study, seed=5, quick=True, only=["ideal_linear"], workforce=Workforce(n)) for n in (1, 2))
    for key, outcome in one.outcomes.items():
        for a, b in zip(outcome.curves, two.outcomes[key].curves, strict=True):
            assert (a.half, a.plateau) == (b.half, b.plateau)
            assert math.isfinite(a.half.value)
