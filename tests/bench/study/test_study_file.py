"""A study file is strict: what is wrong in it is said with its place."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from bench.study.loading import load_study, studies
from protocols.errors import InputError

if TYPE_CHECKING:
    from pathlib import Path

GOOD = """\
format: evs-bench-study/1
title: A small one
effort: {window: 4, pulses: 4, recordings: 1}
quick: {window: 2, pulses: 2, recordings: 1}
stimuli:
  square: {protocol: paper_square, measurement: equal_thresholds}
  reset_test: {protocol: paper_reset_test, measurement: equal_thresholds}
variants:
  - name: plain
    title: noise-free
    stimuli: [square]
    pixel: {noise_rms: 0.0, corner_hz: 2000.0}
grids:
  - name: gaps
    title: gaps
    stimuli: [reset_test]
    pixel: {noise_rms: 0.05}
    axes: {gap_s: [0.1, 0.2], noise_rms: [0.03, 0.04, 0.05]}
    quick: {gap_s: [0.2]}
claims:
  - name: step
    by: us
    source: here
    says: it steps
    quantity: half
    of: [plain/square/on]
    unit: threshold
    expected: 1.0
    tolerance: 0.1
    otherwise: it does not
"""


def written(tmp_path: Path, text: str) -> str:
    path = tmp_path / "study.yaml"
    path.write_text(text)
    return str(path)


def test_a_good_one_is_read(tmp_path: Path) -> None:
    study = load_study(written(tmp_path, GOOD))
    assert [v.name for v in study.variants] == ["plain"]
    assert study.claims[0].limits == (0.9, 1.1)


def test_a_grid_is_every_combination_and_its_quick_form_takes_the_first_of_what_is_not_named(tmp_path: Path) -> None:
    grid = load_study(written(tmp_path, GOOD)).grids[0]
    places = [tuple(v.at.values()) for v in grid.variants(quick=False)]
    assert places == [(g, r) for g in (0.1, 0.2) for r in (0.03, 0.04, 0.05)]
    assert [v.at for v in grid.variants(quick=True)] == [{"gap_s": 0.2, "noise_rms": 0.03}]
    first = grid.variants(quick=False)[0]
    assert (first.reset.gap_s, first.pixel["noise_rms"]) == (0.1, 0.03)


@pytest.mark.parametrize(
    ("before", "after", "line", "says"),
    [
        ("tolerance: 0.1", "tolerence: 0.1", 29, "tolerence"),
        ("noise_rms: 0.0,", "noise_rms: -1.0,", 12, "noise_rms"),
        ("noise_rms: 0.0,", "noise: 0.0,", 12, "noise"),
        ("of: [plain/square/on]", "of: [plain/reset_test/on]", 26, "is not shown 'reset_test'"),
        ("of: [plain/square/on]", "of: [other/square/on]", 26, "no variant 'other'"),
        ("stimuli: [square]", "stimuli: [sqare]", 11, "no stimulus 'sqare'"),
        ("gap_s: [0.1, 0.2]", "gab_s: [0.1, 0.2]", 18, "is no axis"),
        ("{protocol: paper_square, measurement: equal_thresholds}", "{protocol: no_such}", 9, "no_such"),
        (
            "measurement: equal_thresholds}\nvariants",
            "measurement: nothing}\nvariants",
            14,
            "no measurement 'nothing'",
        ),
    ],
)
def test_what_is_wrong_is_said_with_its_line(tmp_path: Path, before: str, after: str, line: int, says: str) -> None:
    assert before in GOOD
    path = written(tmp_path, GOOD.replace(before, after))
    with pytest.raises(InputError) as error:
        load_study(path)
    problem = error.value.problems[0]
    assert says in problem.message
    assert (problem.file, problem.line) == (path, line)


def test_an_unknown_name_is_said_with_what_there_is() -> None:
    assert "paper" in studies()
    with pytest.raises(InputError, match="shipped are paper"):
        load_study("papre")


def test_every_claim_of_the_paper_is_judged_by_something_that_is_measured() -> None:
    study = load_study("paper")
    assert len(study.claims) > 80
    assert {c.by for c in study.claims} == {"paper", "us"}
    assert all(low < high for low, high in (c.limits for c in study.claims))
