"""The list of cases: the same for the same seed, and with all that the study is to have."""

from __future__ import annotations

from collections import Counter

import pytest

from bench.diagnosis.expected.catalogue import NEEDS_KNOWN_THRESHOLDS
from benchmarks.planted.cases import KINDS, cases, dozen, plantable
from benchmarks.planted.strange_effects import STRANGE
from sim_backend.pixel.effects.registry import effects

STRANGE_IDS = {e.id for e in STRANGE}


def test_the_same_seed_gives_the_same_cases() -> None:
    assert cases(3) == cases(3)
    assert cases(3) != cases(4)


def test_a_case_does_not_depend_on_how_many_there_are() -> None:
    few = cases(1, {"single": 3, "several": 0, "none": 0, "outside": 5})
    every = {c.name: c for c in cases(1)}
    assert [every[c.name] for c in few] == few


def test_there_are_as_many_of_each_kind_as_the_study_is_to_have() -> None:
    assert Counter(c.kind for c in cases(1)) == {"single": 126, "several": 60, "none": 60, "outside": 60}
    assert KINDS["single"] >= 120


def test_every_effect_that_can_show_by_itself_is_planted_at_several_sizes() -> None:
    planted = Counter(c.planted[0] for c in cases(1) if c.kind == "single")
    assert set(planted) == set(effects()) - NEEDS_KNOWN_THRESHOLDS - {"nd_error"} - STRANGE_IDS
    assert min(planted.values()) >= 5


def test_each_kind_has_what_it_says() -> None:
    for case in cases(2):
        count = {"single": (1, 1), "several": (2, 3), "none": (0, 0), "outside": (1, 1)}[case.kind]
        assert count[0] <= len(case.planted) <= count[1], case.name
        assert case.left_out == (case.planted if case.kind == "outside" else ()), case.name


def test_what_no_built_in_can_express_is_among_those_from_outside_only() -> None:
    strange = Counter(c.planted[0] for c in cases(1) if set(c.planted) & STRANGE_IDS)
    assert set(strange) == STRANGE_IDS
    assert all(c.kind == "outside" for c in cases(1) if set(c.planted) & STRANGE_IDS)
    assert not STRANGE_IDS & set(plantable())


def test_the_base_pixel_is_within_what_was_asked() -> None:
    for case in cases(1):
        m = case.model
        assert 0.2 <= min(m.theta_on, m.theta_off) <= max(m.theta_on, m.theta_off) <= 0.4
        assert 0.02 <= m.noise_rms <= 0.06
        assert min(m.theta_on, m.theta_off) / m.noise_rms >= 4.5 - 1e-2  # rounded to four digits
        assert 60.0 <= m.corner_hz <= 400.0
        assert 1e-3 <= m.refractory_s <= 1e-2
        assert case.plan.points <= 40


def test_a_third_is_made_by_the_reference_engine_at_a_step_that_stamps_do_not_tell() -> None:
    found = [c for c in cases(1) if not set(c.planted) & STRANGE_IDS]
    assert sum(c.reference for c in found) / len(found) == pytest.approx(1 / 3, abs=0.02)
    for case in found:
        assert case.reference == (case.dt_s != 1e-5)
        assert not case.reference or not (case.dt_s * 1e6).is_integer()


def test_two_effects_that_are_the_same_at_the_pixel_are_not_planted_together() -> None:
    for case in cases(1):
        assert not {"dark_current", "stray_light"} <= set(case.planted)
        assert not {"leak", "light_drift"} <= set(case.planted)


def test_taking_an_effect_away_leaves_the_others() -> None:
    case = next(c for c in cases(1) if c.kind == "several")
    left = case.model.without(case.planted[0])
    assert tuple(e.id for e in left.effects) == case.planted[1:]


def test_the_dozen_is_a_dozen() -> None:
    assert len(dozen()) == 12
    assert len({c.name for c in dozen()}) == 12
    assert sum(c.kind == "none" for c in dozen()) == 2
