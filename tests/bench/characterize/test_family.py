"""The fit of a family, on runs whose truth is known; `benchmarks/dark_light` does it a hundred times for each."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

from bench.analysis.whole import analyze
from bench.characterize.characterize import characterize
from bench.characterize.export import model_numbers, v2e_options
from bench.characterize.families import families_in
from bench.characterize.family_result import family_result
from bench.characterize.readings import Uncertainties
from bench.characterize.saving import save, to_dict
from bench.characterize.wording import summary_lines
from bench.models.characterized import characterized_model_text
from bench.plain import json_text
from benchmarks.dark_light.runs import simulate
from benchmarks.dark_light.settings import SENSOR, SETTINGS, Setting

if TYPE_CHECKING:
    from pathlib import Path

    from bench.analysis.results import Estimate
    from bench.characterize.result import FamilyResult


def setting(name: str) -> Setting:
    return next(s for s in SETTINGS if s.name == name)


def result_of(name: str, seed: int = 11) -> FamilyResult:
    run = simulate(setting(name), seed)
    analysis = analyze(run, pixel_maps=False, theta_fit=lambda _: None)
    (family,) = families_in(analysis)
    return family_result(family, run.taken, analysis.run_id, Uncertainties(), 0.25 / 0.30)


def off_by(found: Estimate, truth: float) -> float:
    """Return by how many standard errors an estimate misses."""
    return abs(found.value - truth) / ((found.high - found.low) / (2.0 * 1.6448536269514722))


@pytest.mark.parametrize("name", ["plain-5.5fA", "filter-5.5fA", "mismatch-15fA"])
def test_dark_light_and_threshold_are_found(name: str) -> None:
    found = result_of(name)
    # Two numbers in three sensors: 3.5 standard errors are passed by chance once in 350 times.
    assert off_by(found.dark_lux, setting(name).dark_lux) < 3.5
    assert off_by(found.theta, 0.30) < 3.5
    assert found.constant is not None
    assert found.constant.p_value > 1e-4
    assert found.filter_break is not None
    assert found.filter_break.seen == name.startswith("filter")
    assert not found.fit.sees_slow if found.fit else False
    if name.startswith("filter"):
        assert off_by(found.filter_break.delta_od, 0.1) < 3.5


@pytest.mark.slow
def test_a_slow_photoreceptor_is_not_mistaken_for_dark_light() -> None:
    found = result_of("bandwidth-5.5fA")
    truth = setting("bandwidth-5.5fA")
    assert found.fit is not None
    assert found.fit.sees_slow
    assert found.by_intercept is not None
    assert found.by_intercept.dark_lux.value > 1.2 * truth.dark_lux
    assert abs(found.dark_lux.value / truth.dark_lux - 1.0) < 0.05
    hz_per_lux = 2.0 * truth.dark_fa / truth.dark_lux
    assert 1.0 / (2.0 * math.pi * found.fit.family.slow_s_lux) == pytest.approx(hz_per_lux, rel=0.1)
    corner_hz = found.fit.at(0.076, 3.0)[1]
    assert corner_hz == pytest.approx(hz_per_lux * (0.076 + truth.dark_lux), rel=0.1)


def test_everything_that_is_said_and_written(tmp_path: Path) -> None:
    found = characterize(
        [simulate(setting("mismatch-5.5fA"), 3)], Uncertainties(light=0.03, contrast=0.002, eta=0.05)
    )
    assert found.dark is not None
    assert found.dark.current_fa is not None
    assert off_by(found.dark.current_fa, 5.5) < 3.5
    assert set(found.dark.parts) == {"chance", "illuminance", "contrast"}
    assert found.dark.parts["illuminance"] == pytest.approx(0.03 * found.dark.lux.value)
    (mismatch,) = found.mismatch
    assert off_by(mismatch.sigma, 0.03) < 3.5
    text = "\n".join(summary_lines(found))
    for part in (
        "Equivalent dark illuminance",
        "Dark current",
        "one threshold holds",
        "Mismatch of the ON",
        "no break",
    ):
        assert part in text
    assert json_text(to_dict(found)).startswith("{")
    folder = save(found, tmp_path / "characterization")
    assert {p.name for p in folder.iterdir()} == {
        "characterization.json", "levels.csv", "pixel_thresholds_on.npz",
    }  # fmt: skip
    numbers = model_numbers(found, SENSOR)
    assert numbers["theta_on"] == found.families[0].theta.value
    assert numbers["effects"]["dark_current"]["mean_fa"] == found.dark.current_fa.value
    assert "threshold_mismatch" in characterized_model_text(numbers)
    options = v2e_options(found)
    assert f"--pos_thres {found.families[0].theta.value:.4f}" in options
    assert "# --neg_thres: no OFF curves were taken" in options
    assert "--refractory_period 0.01" in options
