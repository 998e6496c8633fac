"""A diagnosis goes into files and comes back."""

from __future__ import annotations

import csv
import json
import math
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from bench.diagnosis.result import Remainder
from bench.diagnosis.telling.by_axis import by_axis
from bench.diagnosis.telling.reading import read_bins, read_outcome
from bench.diagnosis.telling.saving import save_outcome
from bench.diagnosis.telling.wording import apart_line
from protocols.errors import InputError
from sim_backend.pixel import read_model_file

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from bench.diagnosis.comparison import Residual
    from bench.diagnosis.result import Outcome


def test_what_is_written_is_read(
    explained: Outcome, residuals_of: Callable[[float], tuple[Residual, ...]], tmp_path: Path
) -> None:
    why = {"nd_error": "no filter was in the light"}
    whole = replace(explained, remainder=(Remainder("time", "second half", 0.03, 6.1),), not_asked=why)
    save_outcome(whole, tmp_path, {0: (residuals_of(88.0), None), 1: (residuals_of(0.5), None)})
    assert {p.name for p in tmp_path.iterdir()} == {"diagnosis.json", "model.yaml", "residuals.csv", "by_axis.csv"}
    assert read_outcome(tmp_path / "diagnosis.json") == whole  # the model is not compared
    assert read_model_file(tmp_path / "model.yaml") == whole.model
    bins = read_bins(tmp_path / "by_axis.csv")
    expected = by_axis(residuals_of(88.0))
    assert list(bins) == [0, 1]
    assert [(b.axis, b.view, b.count) for b in bins[0]] == [(b.axis, b.view, b.count) for b in expected]
    assert bins[0][0].square == pytest.approx(expected[0].square, rel=1e-5)
    with (tmp_path / "residuals.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2 * len(residuals_of(1.0))
    assert (rows[0]["view"], rows[0]["baseline_lux"], rows[0]["unit"]) == ("response", "0.08", "1")
    with (tmp_path / "by_axis.csv").open() as file:
        units = {row["axis"]: row["unit"] for row in csv.DictReader(file)}
    assert (units["illuminance"], units["pulse width"], units["contrast"], units["polarity"]) == (
        "lux",
        "s",
        "ln",
        "",
    )


def test_numbers_that_are_not_finite_are_null_and_come_back_as_unknown(explained: Outcome, tmp_path: Path) -> None:
    first = explained.steps[0]
    open_end = {"photoreceptor_bandwidth.hz_per_fa": replace(first.parameters["thresholds.on"], high=math.inf)}
    save_outcome(replace(explained, steps=(replace(first, parameters=open_end),)), tmp_path)
    text = (tmp_path / "diagnosis.json").read_text()
    assert json.loads(text)["steps"][0]["parameters"]["photoreceptor_bandwidth.hz_per_fa"]["high"] is None
    (step,) = read_outcome(tmp_path / "diagnosis.json").steps
    assert math.isnan(step.parameters["photoreceptor_bandwidth.hz_per_fa"].high)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("{", "cannot be read as a diagnosis"),
        ("[]", "cannot be read as a diagnosis"),
        ('{"format": "evs-bench-diagnosis/2"}', "is of format 'evs-bench-diagnosis/2'; expected"),
        ('{"format": "evs-bench-diagnosis/1"}', "cannot be read as a diagnosis"),
    ],
)
def test_what_is_no_diagnosis_is_one_line(text: str, why: str, tmp_path: Path) -> None:
    (tmp_path / "diagnosis.json").write_text(text)
    with pytest.raises(InputError, match=r"diagnosis\.json: ") as caught:
        read_outcome(tmp_path / "diagnosis.json")
    assert why in str(caught.value)


def test_what_an_earlier_diagnosis_left_is_not_taken_for_this_one(explained: Outcome, tmp_path: Path) -> None:
    for name in ("residuals.csv", "by_axis.csv"):
        (tmp_path / name).write_text("of another diagnosis")
    save_outcome(explained, tmp_path)
    assert {p.name for p in tmp_path.iterdir()} == {"diagnosis.json", "model.yaml"}
    save_outcome(replace(explained, steps=(), model=None, verdict="data_not_fit_to_judge"), tmp_path)
    assert {p.name for p in tmp_path.iterdir()} == {"diagnosis.json"}


def test_that_no_protocol_helps_comes_back_and_that_none_was_looked_for_does_not(
    explained: Outcome, tmp_path: Path
) -> None:
    for one, said in (
        (replace(explained, next_measurement={}), "no protocol that is known here tells dark_current"),
        (replace(explained, next_measurement={}, stopped=True), "no protocol that is known here tells dark_current"),
        (replace(explained, next_measurement=None), None),
    ):
        save_outcome(one, tmp_path)
        read = read_outcome(tmp_path / "diagnosis.json")
        assert read == one
        line = apart_line(read)
        assert line is None if said is None else line is not None and line.startswith(said)


def test_a_search_that_was_stopped_is_read_as_one(explained: Outcome, tmp_path: Path) -> None:
    for stopped in (True, False):
        save_outcome(replace(explained, verdict="unexplained", stopped=stopped), tmp_path)
        assert read_outcome(tmp_path / "diagnosis.json").stopped is stopped


def test_a_file_that_cannot_be_written_leaves_the_old_one(
    explained: Outcome, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save_outcome(explained, tmp_path)
    before = (tmp_path / "diagnosis.json").read_bytes()

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("bench.store.durable.sync_file", full)
    with pytest.raises(OSError, match="No space"):
        save_outcome(replace(explained, verdict="unexplained"), tmp_path)
    assert (tmp_path / "diagnosis.json").read_bytes() == before
    assert {p.name for p in tmp_path.iterdir()} == {"diagnosis.json", "model.yaml"}


def test_tables_that_are_not_there_are_no_error_and_broken_ones_are(tmp_path: Path) -> None:
    assert read_bins(tmp_path / "by_axis.csv") == {}
    (tmp_path / "by_axis.csv").write_text("step,axis\n0,illuminance\n")
    with pytest.raises(InputError, match="diagnose the run again"):
        read_bins(tmp_path / "by_axis.csv")
