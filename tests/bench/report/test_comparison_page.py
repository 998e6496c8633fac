"""The page of a comparison: what stands in its figures, and what it says of the data."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from bench.diagnosis.comparison import Comparison
from bench.diagnosis.recorded.position import Pattern
from bench.diagnosis.telling.by_axis import by_axis, worst_places
from bench.report.comparison import write_comparison
from bench.report.figures import measured_predicted
from bench.report.figures.style import house_style
from sim_backend.pixel import PixelModel

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from bench.diagnosis.comparison import Residual
    from bench.diagnosis.result import Outcome


@pytest.fixture(name="comparison")
def compared(explained: Outcome, residuals_of: Callable[[float], tuple[Residual, ...]]) -> Comparison:
    found = residuals_of(88.0)
    return Comparison(("a-run",), (), explained.steps[0], found, np.eye(len(found)), PixelModel())


def test_every_statistic_stands_in_the_panel_of_its_view(comparison: Comparison) -> None:
    numbers = measured_predicted.prepare(comparison.residuals, {"response": "response probability"})
    assert numbers is not None
    assert [p.title for p in numbers.panels] == ["response probability", "latency"]
    for panel, view in zip(numbers.panels, ("response", "latency"), strict=True):
        mine = [r for r in comparison.residuals if r.view == view]
        shown = {(s.part, *row) for s in panel.sides for row in zip(s.measured, s.expected, s.sd, strict=True)}
        assert shown == {(r.part, r.observed, r.predicted, r.sigma) for r in mine}
        assert panel.low < min(min(r.observed, r.predicted) for r in mine)
        assert panel.high > max(max(r.observed, r.predicted) for r in mine)
    assert measured_predicted.prepare([], {}) is None


def test_rates_that_are_decades_apart_stand_on_a_logarithmic_axis(comparison: Comparison) -> None:
    one = comparison.residuals[0]
    apart = [replace(one, view="background", observed=v, predicted=v, sigma=0.1 * v) for v in (0.01, 3.0)]
    numbers = measured_predicted.prepare(apart, {})
    assert numbers is not None
    assert numbers.panels[0].scale == "log"
    same = [replace(one, observed=0.5, predicted=0.5, sigma=0.1)]
    alone = measured_predicted.prepare([*same, replace(one, observed=np.nan)], {})
    assert alone is not None  # what is not known stands nowhere; a single number has room around it
    assert alone.panels[0].low < 0.5 < alone.panels[0].high
    with house_style():
        axes = measured_predicted.draw(numbers).axes[0]
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    assert axes.get_xlim() == axes.get_ylim()


def test_the_page_says_where_the_model_fails_and_has_its_figures_beside_it(
    comparison: Comparison, tmp_path: Path
) -> None:
    told = replace(comparison, cautions=("the readout was the limit",))
    places, bins = worst_places(told.residuals, told.correlation), by_axis(told.residuals, told.correlation)
    page = write_comparison(told, bins, places, [Pattern("rows", 9.0, 0.2), Pattern("columns", 0.3, 0.1)], tmp_path)
    source = page.read_text(encoding="utf-8")
    assert re.search(r"Error 41.7, on unseen points 42.5, response rms 0.20\d, floor 1.00\.", source)
    assert "Fit to judge, but the readout was the limit." in source
    assert "Rows of pixels differ, by 0.2 rms" in source
    assert "olumns of pixels differ" not in source
    assert "ON response at 80 mlux" in source
    names = re.findall(r'<figure id="(\w+)"', source)
    assert names == ["comparison_views", "comparison_residuals", "comparison_map"]
    assert {p.name for p in (tmp_path / "figures").iterdir()} == {
        f"{n}.{kind}" for n in names for kind in ("png", "pdf")
    }
    assert not re.search(r"url\(|@import|https?://", source)
