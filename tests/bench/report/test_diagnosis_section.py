"""The diagnosis in the report: its numbers, its figures, and the page."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bench.diagnosis.telling.by_axis import Bin, by_axis
from bench.diagnosis.telling.saving import save_outcome
from bench.report import write_report
from bench.report.diagnosis import diagnosis_pictures, diagnosis_section, write_diagnosis
from bench.report.figures import error_fall, misfit_map, ranking, residual_axes
from protocols.errors import InputError

if TYPE_CHECKING:
    from pathlib import Path

    from bench.analysis.results import Analysis
    from bench.diagnosis.comparison import Residual
    from bench.diagnosis.result import Outcome

Maker = Callable[..., Any]
LABELS = {0: "start", 1: "+ dark current"}


@pytest.fixture(name="bins")
def bins_before_and_after(residuals_of: Callable[[float], tuple[Residual, ...]]) -> dict[int, tuple[Bin, ...]]:
    return {0: by_axis(residuals_of(88.0)), 1: by_axis(residuals_of(0.5))}


def test_the_fall_has_every_step(explained: Outcome) -> None:
    numbers = error_fall.prepare(explained)
    assert numbers is not None
    assert numbers.labels == ("start", "+ dark current")
    assert numbers.error.tolist() == [41.7, 1.06]
    assert numbers.unseen == pytest.approx([42.534, 1.0812])
    assert error_fall.prepare(replace(explained, steps=())) is None


def test_residuals_stand_on_every_axis_that_was_varied(bins: dict[int, tuple[Bin, ...]]) -> None:
    numbers = residual_axes.prepare(bins, LABELS)
    assert numbers is not None
    assert [p.title for p in numbers.panels] == [
        "illuminance on chip", "log contrast", "polarity", "points in their order",
    ]  # fmt: skip
    light = numbers.panels[0]
    assert light.labels == ("80 mlux", "300 mlux", "1 lux", "10 lux", "100 lux")
    before, after = light.rms
    assert before[0] > 30.0
    assert before[-1] == pytest.approx(0.5)
    assert after.max() < 1.0
    assert ((light.low < 1.0) & (light.high > 1.0)).all()
    assert residual_axes.prepare({}, LABELS) is None


def test_the_map_has_the_direction_of_the_misfit(bins: dict[int, tuple[Bin, ...]]) -> None:
    numbers = misfit_map.prepare(bins, LABELS)
    assert numbers is not None
    assert (numbers.views, numbers.titles) == (("response", "latency"), ("start", "+ dark current"))
    assert numbers.maps[0].shape == (2, 5)
    assert numbers.maps[0][0, 0] < -30.0
    assert np.isfinite(numbers.maps[1]).all()


def test_the_ranking_names_what_was_added_first(explained: Outcome) -> None:
    numbers = ranking.prepare(explained)
    assert numbers is not None
    first, last = numbers.steps
    assert first.effects[:2] == ("dark current", "stray light")
    assert (first.added, first.tied) == ("dark current", ("stray light",))
    assert first.found[:2].tolist() == [40.6, 40.5]
    assert (last.added, last.effects[0]) == (None, "leak")
    bare = replace(explained, steps=tuple(replace(s, candidates=()) for s in explained.steps))
    assert ranking.prepare(bare) is None


def test_a_diagnosis_without_tables_has_the_other_figures(explained: Outcome) -> None:
    assert [p.name for p in diagnosis_pictures(explained, {})] == ["diagnosis_error", "diagnosis_ranking"]


@pytest.fixture(name="folder")
def diagnosed(explained: Outcome, residuals_of: Callable[[float], tuple[Residual, ...]], tmp_path: Path) -> Path:
    folder = tmp_path / "diagnosis"
    folder.mkdir()
    save_outcome(explained, folder, {0: (residuals_of(88.0), None), 1: (residuals_of(0.5), None)})
    return folder


def test_the_page_says_what_was_missing_and_has_its_figures_beside_it(folder: Path) -> None:
    page = write_diagnosis(folder)
    source = page.read_text(encoding="utf-8")
    assert "One effect was missing, dark_current (or stray_light)." in source
    assert "To tell the two apart" in source
    assert "5.41 to 5.63" in source  # the interval of what was added
    names = re.findall(r'<figure id="(\w+)"', source)
    assert names == ["diagnosis_error", "diagnosis_residuals", "diagnosis_map", "diagnosis_ranking"]
    assert {p.name for p in (folder / "figures").iterdir()} == {
        f"{n}.{kind}" for n in names for kind in ("png", "pdf")
    }
    assert not re.search(r"url\(|@import|https?://", source)
    assert "nan" not in re.sub(r"data:image[^\"]*|[a-z]*nan[a-z]+|[a-z]+nan[a-z]*", "", source.lower())


def test_the_report_of_a_run_has_the_section_if_there_is_a_diagnosis(
    constant: Analysis, constant_run_of: Maker, nothing_missing: Outcome, tmp_path: Path
) -> None:
    run = constant_run_of("dark")
    save_outcome(nothing_missing, tmp_path)
    text = write_report(run, constant, tmp_path / "with", diagnosis=tmp_path).read_text(encoding="utf-8")
    assert text.index('<section id="diagnosis">') < text.index("<h2>Tables</h2>")
    assert "figures/diagnosis_error.png" in text
    assert (tmp_path / "with/figures/diagnosis_error.pdf").exists()
    bare = write_report(run, constant, tmp_path / "without", diagnosis=tmp_path / "nowhere").read_text(
        encoding="utf-8"
    )
    assert "Diagnosis" not in bare


def test_nothing_missing_shows_what_would_have_been_seen(nothing_missing: Outcome, tmp_path: Path) -> None:
    save_outcome(nothing_missing, tmp_path)
    section = diagnosis_section(tmp_path, tmp_path / "figures")
    assert section is not None
    assert section.smallest is not None
    assert [[c.text for c in row] for row in section.smallest.rows] == [["leak", "0.021 ln/s (rate_per_s)"]]


def test_the_page_says_that_recordings_were_looked_at_in_part(explained: Outcome, tmp_path: Path) -> None:
    shortened = "the beginning of 9 of 12 recordings: 80 s of 300 s; 64 x 64 of 100 x 100 pixels"
    save_outcome(replace(explained, shortened=shortened), tmp_path)
    source = write_diagnosis(tmp_path).read_text(encoding="utf-8")
    assert "Looked at the beginning of 9 of 12 recordings: 80 s of 300 s." in source
    assert "Looked at 64 x 64 of 100 x 100 pixels." in source


def test_data_that_are_not_fit_have_a_page_without_figures(explained: Outcome, tmp_path: Path) -> None:
    bad = replace(
        explained, verdict="data_not_fit_to_judge", findings=("saturated",), steps=(), next_measurement=None
    )
    save_outcome(bad, tmp_path)
    source = write_diagnosis(tmp_path).read_text(encoding="utf-8")
    assert "The data are not fit to be judged: saturated" in source
    assert "<figure" not in source


def test_text_of_files_is_escaped(explained: Outcome, tmp_path: Path) -> None:
    evil = "<script>alert('x')</script>"
    bad = replace(explained, verdict="data_not_fit_to_judge", findings=(evil,), steps=(), runs=(evil,))
    save_outcome(bad, tmp_path)
    assert "<script" not in write_diagnosis(tmp_path).read_text(encoding="utf-8")


def test_a_page_without_a_diagnosis_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"has no diagnosis\.json"):
        write_diagnosis(tmp_path)
