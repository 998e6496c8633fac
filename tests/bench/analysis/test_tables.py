"""Results as files and text."""

from __future__ import annotations

import csv
import json
import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bench.analysis import analyze
from bench.analysis.results import Analysis, Estimate, SCurve
from bench.analysis.tables import FORMAT, save, summary_lines, to_json, write_csv

if TYPE_CHECKING:
    from pathlib import Path


def _nothing(rows: Any) -> None:
    del rows


@pytest.fixture
def analysis(square: Any, point: Any, run: Any, events: Any) -> Analysis:
    made = []
    for index, contrast in enumerate((0.1, 0.2, 0.3, 0.4, 0.5)):
        answers = [(110_000 + 100_000 * k, 100 + x % 4, 50 + x // 4, 1 - k % 2) for k in range(10) for x in range(12)]
        made.append(square(contrast, index=index, stored=events(answers if contrast > 0.25 else [])))
    return analyze(run(*made, point(index=5)), theta_fit=_nothing)


def _read(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_tables_have_units_and_all_rows(analysis: Analysis, tmp_path: Path) -> None:
    responses, curves, background = (_read(p) for p in write_csv(analysis, tmp_path))
    assert (len(responses), len(curves), len(background)) == (10, 2, 2)
    assert {"baseline_lux", "log_contrast_ln", "latency_median_s"} <= set(responses[0])
    assert {"half_ln", "half_low_ln", "intercept_high_ln", "theta_ln", "pulse_width_s"} <= set(curves[0])
    assert {"rate_hz", "rate_low_hz", "pixel_seconds_s"} <= set(background[0])
    assert float(curves[0]["half_ln"]) == analysis.curves[0].half.value == pytest.approx(0.25)
    assert curves[0]["theta_ln"] == "", "what was not found is an empty cell"
    assert float(background[0]["rate_high_hz"]) == analysis.background[0].rate.high


def test_json_is_strict_and_whole(analysis: Analysis) -> None:
    found = json.loads(json.dumps(to_json(analysis), allow_nan=False))
    assert found["format"] == FORMAT
    assert len(found["curves"]) == 2
    assert found["curves"][0]["half"]["value"] == pytest.approx(0.25)
    assert found["curves"][0]["answered_resets"] is None
    assert found["responses"][0]["latency_median_s"] is None
    assert sum(found["responses"][-1]["latency_counts"]) == 60


def test_save_leaves_whole_files_and_nothing_else(analysis: Analysis, tmp_path: Path) -> None:
    for _ in range(2):  # a second time replaces them
        folder = save(analysis, tmp_path)
    assert folder == tmp_path / "analysis"
    names = {p.name for p in folder.iterdir()}
    assert names == {"analysis.json", "responses.csv", "curves.csv", "background.csv", "pixel_maps.npz"}
    with np.load(folder / "pixel_maps.npz") as maps:
        np.testing.assert_array_equal(maps["event_map"], analysis.event_map)
        assert [json.loads(k)["polarity"] for k in maps["keys"]] == [m.key.polarity for m in analysis.pixel_maps]
        np.testing.assert_array_equal(maps["half_ln_0"], analysis.pixel_maps[0].half)


def test_summary_shows_the_thresholds_and_says_what_is_doubtful(analysis: Analysis) -> None:
    text = "\n".join(summary_lines(analysis))
    assert "0.250 [0.200, 0.300]" in text
    assert "upper" not in text
    assert "which of the two it is, these data do not tell" in text
    assert "there is no theta" in text


def test_a_model_theta_has_its_own_column(analysis: Analysis) -> None:
    from dataclasses import replace

    theta = Estimate(0.271, 0.262, 0.281, "ln")
    curve: SCurve = replace(analysis.curves[0], theta=theta, noise_rms=Estimate(0.04, 0.03, 0.05, "ln"))
    text = "\n".join(summary_lines(replace(analysis, curves=(curve,))))
    assert "0.271 [0.262, 0.281]" in text
    assert "theta: fit of a noisy pixel" in text
    assert "there is no theta" not in text


def test_summary_of_an_empty_run_is_its_name(run: Any) -> None:
    lines = summary_lines(analyze(run(), theta_fit=_nothing))
    assert lines[0] == "run  by hand"
    assert not math.isnan(len(lines))
