"""What is drawn for a challenge: kinds, sizes and base pixels, and that a seed fixes them."""

from __future__ import annotations

import math

import pytest

from bench.challenge.draw import LEVELS, Level, draw
from bench.challenge.sizes import ALIKE, NOT_TO_BE_FOUND, SIZES
from bench.diagnosis.expected.catalogue import free_of
from sim_backend.pixel.effects import effect_from_dict, effects

SEEDS = range(300)


def test_every_effect_has_a_size_or_cannot_be_found() -> None:
    assert set(SIZES) | NOT_TO_BE_FOUND == set(effects())
    assert not set(SIZES) & NOT_TO_BE_FOUND


@pytest.mark.parametrize("effect_id", SIZES)
def test_both_ends_are_allowed_and_what_a_diagnosis_looks_for_lies_between_them(effect_id: str) -> None:
    for strength in (0.0, 1.0):
        effect_from_dict(effect_id, {s.name: s.at(strength) for s in SIZES[effect_id]})
    ranges = {s.name: sorted((s.faint, s.gross)) for s in SIZES[effect_id]}
    described = effects()[effect_id].parameters()
    usual = {p.name: (p.default, p.default) for p in described if p.default is not None}  # no challenge changes them
    for free in free_of(effects()[effect_id]):
        low, high = {**usual, **ranges}[free.name]
        assert low <= free.probe <= high


def test_a_size_grows_evenly_in_its_logarithm() -> None:
    (size,) = SIZES["photoreceptor_bandwidth"]
    assert (size.at(0.0), size.at(1.0)) == (50.0, 1.0)
    assert size.at(0.5) == pytest.approx(math.sqrt(50.0), rel=1e-3)


@pytest.mark.parametrize(("level", "counts"), [("easy", {1}), ("medium", {1, 2}), ("hard", {1, 2, 3})])
def test_a_level_has_so_many_effects(level: Level, counts: set[int]) -> None:
    drawn = [draw(seed, level) for seed in SEEDS]
    assert {len(d.effects) for d in drawn} == counts
    # 300 draws of one effect or more: each of 22 kinds is expected 13 times or more, and missed with p < 1e-4
    assert {effect for d in drawn for effect in d.effects} == set(SIZES)
    assert not any(len(group.intersection(d.effects)) > 1 for d in drawn for group in ALIKE)


@pytest.mark.parametrize("level", LEVELS)
def test_there_may_be_none_where_that_is_asked_for(level: Level) -> None:
    both = [(draw(seed, level), draw(seed, level, may_be_nothing=True)) for seed in SEEDS]
    # 300 draws, each none with 15 or 20 %: 45 or 60 times, and 5 standard deviations
    assert 14 < sum(not may_be.effects for _, may_be in both) < 95
    assert all(may_be == always for always, may_be in both if may_be.effects)


def test_the_number_of_effects_can_be_given() -> None:
    for number in range(4):
        assert {len(draw(seed, "easy", number).effects) for seed in range(20)} == {number}


def strengths(level: Level) -> list[float]:
    """Return how strong the effects of many draws are, from 0, barely visible, to 1, gross."""
    sizes = {(effect, s.name): s for effect, all_of_it in SIZES.items() for s in all_of_it if not s.kind}
    return [
        math.log(abs(value) / sizes[effect, name].faint)
        / math.log(sizes[effect, name].gross / sizes[effect, name].faint)
        for seed in SEEDS
        for effect, values in draw(seed, level, 2).effects.items()
        for name, value in values.items()
        if (effect, name) in sizes
    ]


@pytest.mark.parametrize(("level", "faintest"), [("easy", 0.6), ("medium", 0.3), ("hard", 0.0)])
def test_sizes_go_from_the_faintest_of_the_level_to_gross(level: Level, faintest: float) -> None:
    found = strengths(level)
    assert min(found) == pytest.approx(faintest, abs=0.02)
    assert max(found) == pytest.approx(1.0, abs=0.02)
    assert min(found) >= faintest - 1e-3  # four figures


def test_base_pixels_are_in_range_and_calm() -> None:
    for seed in SEEDS:
        base = draw(seed).base
        assert 0.2 <= min(base["theta_on"], base["theta_off"]) <= max(base["theta_on"], base["theta_off"]) <= 0.4
        assert 0.02 <= base["noise_rms"] <= 0.06
        assert min(base["theta_on"], base["theta_off"]) / base["noise_rms"] > 4.99
        assert 50.0 <= base["corner_hz"] <= 500.0
        assert 1e-3 <= base["refractory_s"] <= 10e-3


def test_signs_go_both_ways() -> None:
    found = [draw(seed, "easy", 3).effects.get("nd_error", {}).get("delta_od", 0.0) for seed in SEEDS]
    assert min(found) < 0.0 < max(found)


def test_a_seed_fixes_all_and_another_changes_it() -> None:
    drawn = {level: [draw(seed, level) for seed in range(20)] for level in LEVELS}
    for level in LEVELS:
        assert drawn[level] == [draw(seed, level) for seed in range(20)]
        assert len({repr(d) for d in drawn[level]}) == 20
