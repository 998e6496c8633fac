"""Scores of diagnoses that were written by hand."""

from __future__ import annotations

import math
from typing import Any

import pytest

from benchmarks.planted.score import Score, score, share, wilson

MODEL = {"theta_on": 0.3, "theta_off": 0.25, "noise_rms": 0.04, "corner_hz": 120.0, "refractory_s": 8e-3}


def truth(*planted: str, left_out: tuple[str, ...] = ()) -> dict[str, Any]:
    effects = {e: {"rate_per_s": 0.1, "spread": 0.0} for e in planted}
    return {"model": {**MODEL, "effects": effects}, "left_out": list(left_out)}


def diagnosis(
    *missing: str,
    verdict: str = "explained",
    ties: dict[str, list[str]] | None = None,
    errors: tuple[float | None, ...] = (40.0, 1.02),
    parameters: dict[str, Any] | None = None,
) -> Any:
    steps = [
        {
            "error": {"deviance_per_dof": e, "heldout_deviance_per_dof": None if e is None else e + 0.1},
            "parameters": parameters or {},
        }
        for e in errors
    ]
    return {"verdict": verdict, "missing": list(missing), "ties": ties or {}, "steps": steps, "noise_floor": 1.0}


def test_a_single_effect_that_is_named() -> None:
    found = score(truth("leak"), diagnosis("leak"))
    assert (found.first_right, found.all_named, found.false) == (True, True, 0)
    assert found.at_floor
    assert found.falls


def test_a_tied_group_counts_if_it_holds_the_effect() -> None:
    found = score(truth("stray_light"), diagnosis("dark_current", ties={"dark_current": ["stray_light"]}))
    assert found.groups == (("dark_current", "stray_light"),)
    assert (found.first_right, found.all_named, found.false) == (True, True, 0)


def test_the_right_one_named_second_is_named_but_not_first() -> None:
    found = score(truth("leak"), diagnosis("shot_noise", "leak", errors=(40.0, 20.0, 1.0)))
    assert (found.first_right, found.all_named, found.false) == (False, True, 1)


def test_of_several_each_needs_a_group_of_its_own() -> None:
    tied = {"leak": ["light_drift", "shot_noise"]}
    one = score(truth("leak", "shot_noise"), diagnosis("leak", ties=tied))
    assert (one.first_right, one.all_named, one.false) == (True, False, 0)
    # The first group could stand for either; it is taken so that most are named.
    two = score(truth("leak", "shot_noise"), diagnosis("leak", "leak_of_another", ties={
        "leak": ["shot_noise"], "leak_of_another": ["leak"]}))  # fmt: skip
    assert (two.all_named, two.false) == (True, 0)


def test_an_effect_named_twice_is_named_once_too_often() -> None:
    found = score(truth("leak"), diagnosis("leak", "light_drift", ties={"light_drift": ["leak"]}))
    assert (found.all_named, found.false) == (True, 1)


def test_nothing_planted_and_nothing_named() -> None:
    silent = score(truth(), diagnosis(verdict="nothing_missing", errors=(1.0,)))
    assert (silent.first_right, silent.all_named, silent.false, silent.groups) == (False, True, 0, ())
    loud = score(truth(), diagnosis("leak"))
    assert loud.false == 1


def test_what_the_diagnosis_was_not_told_of_cannot_be_named_right() -> None:
    outside = truth("leak", left_out=("leak",))
    silent = score(outside, diagnosis(verdict="unexplained", errors=(3.0,)))
    assert (silent.unexplained, silent.false, silent.first_right) == (True, 0, False)
    assert score(outside, diagnosis("light_drift", verdict="unexplained")).false == 1


def test_intervals_that_contain_the_truth() -> None:
    fitted = {
        "thresholds.on": {"value": 0.31, "low": 0.305, "high": 0.32},
        "thresholds.off@1": {"value": 0.25, "low": 0.24, "high": 0.26},
        "leak.rate_per_s": {"value": 0.2, "low": 0.05, "high": None},
        "dark_current.mean_fa": {"value": 1.0, "low": 0.9, "high": 1.1},
        "alignment.time_offset_s": {"value": 0.0, "low": -1e-5, "high": 1e-5},
    }
    found = score(truth("leak"), diagnosis("leak", parameters=fitted))
    assert found.coverage == {"thresholds.on": False, "thresholds.off@1": True, "leak.rate_per_s": True}


@pytest.mark.parametrize(
    ("errors", "at_floor", "falls"),
    [
        ((40.0, 1.1), True, True),
        ((40.0, 1.11), False, True),
        ((1.0, 1.05), True, False),
        ((40.0, None), False, False),
    ],
)
def test_the_fall_of_the_error(errors: tuple[float | None, ...], at_floor: bool, falls: bool) -> None:
    found: Score = score(truth("leak"), diagnosis("leak", errors=errors))
    assert (found.at_floor, found.falls) == (at_floor, falls)


def test_the_floor_is_what_the_true_model_leaves_but_no_less_than_one() -> None:
    above = diagnosis("leak", errors=(40.0, 1.15))
    assert not score(truth("leak"), above).at_floor
    assert score(truth("leak"), above, floor=1.06).at_floor
    assert not score(truth("leak"), above, floor=1.04).at_floor
    assert score(truth("leak"), diagnosis("leak", errors=(40.0, 1.05)), floor=0.8).at_floor


def test_data_that_are_not_fit_to_judge_have_no_steps() -> None:
    found = score(truth("leak"), diagnosis(verdict="data_not_fit_to_judge", errors=()))
    assert (found.errors, found.coverage, found.first_right) == ((), {}, False)


def test_wilson_is_as_in_tables() -> None:
    # Newcombe (1998), Statistics in Medicine 17, table I: 81 of 263, and 0 of 20.
    assert wilson(81, 263) == pytest.approx((0.2553, 0.3662), abs=5e-5)
    assert wilson(0, 20) == pytest.approx((0.0, 0.1611), abs=5e-5)
    assert wilson(0, 0) == (0.0, 1.0)
    assert all(math.isfinite(e) for e in wilson(5, 5))


def test_a_share_is_told_with_its_interval() -> None:
    assert str(share([True] * 19 + [False])) == "19 of 20, 95 % (76 to 99)"
    assert str(share([])) == "0 of 0"
