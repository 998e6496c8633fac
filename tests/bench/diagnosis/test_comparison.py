"""A model laid beside a run: numbers, residuals, and what is said of them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bench.diagnosis.comparison import Comparison, compare
from bench.diagnosis.recorded.position import patterns, pixel_map
from bench.diagnosis.telling.by_axis import by_axis, worst_places
from bench.diagnosis.telling.saving import comparison_dict, save_comparison
from bench.diagnosis.telling.wording import comparison_lines
from sim_backend.pixel import PixelModel, read_model_file

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

QUANTILES = ("latency_10", "latency_50", "latency_90")
PIXEL = PixelModel(noise_rms=0.045, corner_hz=150.0, theta_on=0.3, theta_off=0.25, refractory_s=8e-3)


@pytest.fixture(scope="module", name="told")
def what_is_told() -> list[str]:
    return []


@pytest.fixture(scope="module", name="comparison")
def compared(make: tuple[Callable[..., Any], Callable[..., Any]], told: list[str]) -> Comparison:
    """A small run of the base pixel itself, compared with it."""
    point, run_of = make
    points = [point(i, c, lux) for i, (c, lux) in enumerate(((0.3, 10.0), (0.6, 10.0), (0.3, 100.0), (0.6, 100.0)))]
    return compare([run_of([*points, point(4, 0.0)], PIXEL, 3)], PIXEL, seed=4, tell=told.append)


def test_the_true_model_is_not_far_off(comparison: Comparison, told: list[str]) -> None:
    assert told == ["looking at the events", "fitting the model", "looking closer"]
    z = np.array([r.z for r in comparison.residuals if r.view not in QUANTILES])
    # Some 80 statistics, of which those of a point depend on each other; five numbers were fitted.
    assert 40 < z.size < 150
    assert 0.3 < np.mean(z**2) < 2.0
    assert comparison.step.error.response_rmse < 0.1
    assert (comparison.findings, comparison.cautions) == ((), ())


def test_what_was_measured_is_in_the_residuals_with_its_error(comparison: Comparison) -> None:
    responses = [r for r in comparison.residuals if r.view == "response"]
    assert {(r.part, r.baseline_lux, r.log_contrast) for r in responses} == {
        (part, lux, c) for part in ("on", "off") for lux in (10.0, 100.0) for c in (0.3, 0.6)
    }  # fmt: skip
    for one in responses:
        # 64 pixels of 10 pulses: no better than half of one in 640, no worse than if the pulses of a pixel were one
        assert 7e-4 < one.sigma < 0.12
        if 0.1 < one.predicted < 0.9:
            assert (one.observed - one.predicted) / one.sigma == pytest.approx(one.z, abs=0.2 + 0.2 * abs(one.z))


def test_quantiles_of_the_latency_are_shown_beside_what_is_fitted(comparison: Comparison) -> None:
    by_view = {v: [r for r in comparison.residuals if r.view == v] for v in ("latency", *QUANTILES)}
    # ON and OFF of four points; that the sensor's answers come in other places of 24 is chance: 3.7 standard errors
    assert {len(mine) for mine in by_view.values()} == {8}
    assert max(abs(r.z) for view in QUANTILES for r in by_view[view]) < 3.7
    for early, middle, late in zip(*(by_view[view] for view in QUANTILES), strict=True):
        assert early.observed < middle.observed < late.observed
        assert early.predicted < middle.predicted < late.predicted
        assert (early.part, early.point, early.unit) == (late.part, late.point, "ln s")


def test_the_events_that_one_pulse_brings_are_those_of_all_pixels(comparison: Comparison) -> None:
    """64 pixels: those that answer, and the further events of each."""
    of = {(r.view, r.part, r.point): r for r in comparison.residuals}
    for (view, part, point), one in of.items():
        if view in ("background", "regularity", "intervals", "same_polarity"):
            continue
        if one.log_contrast > 0.0 and part != "both":
            more = of[("extra_events", part, point)].observed
            assert one.at_once == pytest.approx(64.0 * (of[("response", part, point)].observed + more))
    assert all(np.isnan(r.at_once) for r in comparison.residuals if r.log_contrast == 0.0)
    assert any(b.axis == "events at once" and b.high > 40.0 for b in by_axis(comparison.residuals))


def test_what_is_shown_alone_is_no_worst_place(comparison: Comparison) -> None:
    """It says again what others say."""
    places = worst_places(comparison.residuals, comparison.correlation, most=100, least_z=0.0)
    views = {p.worst.view for p in places}
    assert "latency" in views
    assert not views & set(QUANTILES)


def test_correlations_are_of_points_and_make_means_less_sharp(comparison: Comparison) -> None:
    mutual = comparison.correlation
    point = np.array([r.point for r in comparison.residuals])
    assert mutual.shape == (point.size, point.size)
    assert np.allclose(np.diag(mutual), 1.0)
    assert np.abs(mutual[point[:, None] != point[None, :]]).max() == 0.0
    assert np.linalg.eigvalsh(mutual).min() > -1e-9
    (everywhere, *_) = by_axis(comparison.residuals, mutual)
    assert everywhere.square_sd > np.sqrt(2.0 / point.size)


def test_a_comparison_goes_into_files_and_words(comparison: Comparison, tmp_path: Path) -> None:
    content = comparison_dict(comparison, ())
    save_comparison(comparison, content, tmp_path)
    assert {p.name for p in tmp_path.iterdir()} == {"comparison.json", "model.yaml", "residuals.csv", "by_axis.csv"}
    assert read_model_file(tmp_path / "model.yaml") == comparison.model
    assert len(content["residuals"]) == len(comparison.residuals)
    text = "\n".join(comparison_lines(comparison, (), ()))
    assert text.startswith("thresholds, noise floor, source follower bandwidth, refractory period   error ")
    assert "no statistic is off by more than chance" in text
    assert "        thresholds.on " in text


def test_what_is_to_be_known_stands_with_data_that_are_fit(comparison: Comparison) -> None:
    def quality(**changes: Any) -> dict[str, Any]:
        found: dict[str, Any] = comparison_dict(replace(comparison, **changes), ())["data_quality"]
        return found

    assert quality() == {"ok": True, "findings": []}
    assert quality(cautions=("the readout",)) == {"ok": True, "findings": ["the readout"]}
    assert quality(findings=("3 events",)) == {"ok": False, "findings": ["3 events"]}


def test_data_that_are_not_fit_are_compared_all_the_same(
    make: tuple[Callable[..., Any], Callable[..., Any]],
) -> None:
    point, run_of = make
    lossy = point(0, 0.6, periods=4, quality={"overflows": 3})
    comparison = compare([run_of([lossy], PIXEL, 3)], PIXEL, seed=4)
    assert comparison.findings == ("events were lost on the way, nobody knows when, in 1 of 1 points",)
    assert comparison.residuals
    lines = list(comparison_lines(comparison, (), ()))
    assert lines[0] == f"not fit to judge: {comparison.findings[0]}"
    assert lines[1].startswith("thresholds, ")


def test_a_run_without_an_event_is_compared(make: tuple[Callable[..., Any], Callable[..., Any]]) -> None:
    """Neither the sensor nor the model answers: all residuals are zero."""
    point, run_of = make
    deaf = replace(PIXEL, theta_on=1.5, theta_off=1.5)
    found = compare([run_of([point(0, 0.02), point(1, 0.03)], deaf, 3)], deaf, seed=4)
    assert {(r.observed, r.predicted) for r in found.residuals} == {(0.0, 0.0)}
    text = "\n".join(comparison_lines(found, (), ()))
    assert "no statistic is off by more than chance" in text


def test_patterns_of_a_simulated_sensor_are_chance(make: tuple[Callable[..., Any], Callable[..., Any]]) -> None:
    point, run_of = make
    found = patterns(pixel_map(list(run_of([point(0, 0.3), point(1, 0.27)], PIXEL, 5).points())))
    assert max(abs(p.z) for p in found) < 4.0
