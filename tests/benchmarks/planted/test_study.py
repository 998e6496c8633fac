"""The study as a whole: it goes on where it was stopped, and writes its page of what is finished."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest

from benchmarks.planted.report import write_report
from benchmarks.planted.results import append, finished, joined, read
from benchmarks.planted.study import main, run_study, wanted
from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from benchmarks.planted.cases import Case
    from benchmarks.planted.trial import Trial


def sizes_of(case: Case) -> dict[str, float]:
    return {e: 2.0 + 8.0 * ((case.number + i) % 3) for i, e in enumerate(case.planted)}


def head(trial: Trial) -> dict[str, Any]:
    truth = json.loads(json.dumps(trial.case.to_dict()))
    return {"name": trial.case.name, "study_seed": trial.study_seed, "revision": "abc", "truth": truth}


def measured(trial: Trial) -> dict[str, Any]:
    """Return the record of the sizes of a case."""
    beyond = 7.0 if trial.case.left_out else None
    return {**head(trial), "sizes": {"size": sizes_of(trial.case), "mimic": None, "beyond_mimic": beyond}}


def diagnosed(trial: Trial) -> dict[str, Any]:
    """Return the record of a diagnosis that names what is planted from size 5 on, and is silent else."""
    case = trial.case
    named = [e for e, size in sizes_of(case).items() if size >= 5.0 and not case.left_out]
    errors = [30.0 / (1 + i) ** 3 for i in range(len(named))] + [1.0]
    return {
        **head(trial),
        "seconds": 12.0,
        "diagnosis": {
            "verdict": "unexplained" if case.left_out else "explained" if named else "nothing_missing",
            "missing": named,
            "ties": {},
            "noise_floor": 1.0,
            "steps": [
                {"error": {"deviance_per_dof": e, "heldout_deviance_per_dof": e}, "parameters": {}} for e in errors
            ],
        },
    }


WORK = {"sizes.jsonl": measured, "cases.jsonl": diagnosed}


def tell_nobody(line: str) -> None:
    del line


def names_in(path: Path) -> set[str]:
    return {r["name"] for r in read(path)}


def test_what_is_finished_is_not_run_again(tmp_path: Path) -> None:
    chosen = wanted(1, limit=2)
    asked: list[tuple[str, str]] = []

    def noted(name: str) -> Callable[[Trial], dict[str, Any]]:
        def work(one: Trial) -> dict[str, Any]:
            asked.append((one.case.name, name))
            return WORK[name](one)

        return work

    work = {name: noted(name) for name in WORK}
    run_study(chosen[:3], tmp_path / "build", 1, tell=tell_nobody, work=work)
    run_study(chosen, tmp_path / "build", 1, tell=tell_nobody, work=work)
    assert sorted(asked) == sorted((c.name, name) for c in chosen for name in WORK)
    assert {r["name"] for r in joined(tmp_path / "build" / "cases.jsonl", tmp_path / "build" / "sizes.jsonl")} == {
        c.name for c in chosen
    }
    changed = [replace(chosen[0], dt_s=2e-5), *chosen[1:]]
    asked.clear()
    run_study(changed, tmp_path / "build", 1, tell=tell_nobody, work=work)
    assert sorted(asked) == sorted((chosen[0].name, name) for name in WORK)


def test_sizes_and_diagnoses_are_made_apart(tmp_path: Path) -> None:
    chosen = wanted(1, only=["single"], limit=3)
    diagnoses, sizes = tmp_path / "cases.jsonl", tmp_path / "sizes.jsonl"
    run_study(chosen, tmp_path, 1, tell=tell_nobody, work={"cases.jsonl": diagnosed})
    assert not sizes.exists()
    assert joined(diagnoses, sizes) == []
    run_study(chosen[:2], tmp_path, 1, tell=tell_nobody, work={"sizes.jsonl": measured})
    assert [r["name"] for r in joined(diagnoses, sizes)] == [c.name for c in chosen[:2]]
    assert joined(diagnoses, sizes)[0]["sizes"]["size"] == sizes_of(chosen[0])
    # Sizes of a case that is no longer what it was are not those of its diagnosis.
    changed = replace(chosen[0], dt_s=2e-5)
    run_study([changed], tmp_path, 1, tell=tell_nobody, work={"cases.jsonl": diagnosed})
    assert [r["name"] for r in joined(diagnoses, sizes)] == [chosen[1].name]


def test_the_options_choose_what_is_done(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("benchmarks.planted.study._WORK", WORK)
    arguments = ["--only", "single-000", "--results", str(tmp_path), "--docs", str(tmp_path / "docs")]
    assert main([*arguments, "--sizes-only"]) == 0
    assert [p.name for p in tmp_path.iterdir()] == ["sizes.jsonl"]
    assert main([*arguments, "--diagnoses-only"]) == 0
    assert names_in(tmp_path / "cases.jsonl") == {"single-000"}
    assert (tmp_path / "docs" / "planted-study.md").exists()


def test_what_the_truth_leaves_is_asked_for_where_more_is_left_than_is_usual(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    last = {"single-000": 1.15, "single-001": 1.15, "single-002": 1.05}

    def ends_at(trial: Trial) -> dict[str, Any]:
        record = diagnosed(trial)
        record["diagnosis"]["verdict"] = "unexplained" if trial.case.name == "single-001" else "explained"
        record["diagnosis"]["steps"][-1]["error"]["deviance_per_dof"] = last[trial.case.name]
        return record

    monkeypatch.setattr("benchmarks.planted.study._WORK", {**WORK, "cases.jsonl": ends_at})
    monkeypatch.setattr(
        "benchmarks.planted.study._AFTERWARDS", {"floors.jsonl": lambda one: {**head(one), "floor": 1.12}}
    )
    only = [part for name in last for part in ("--only", name)]
    assert main([*only, "--results", str(tmp_path), "--docs", str(tmp_path / "docs")]) == 0
    assert names_in(tmp_path / "floors.jsonl") == {"single-000"}
    page = (tmp_path / "docs" / "planted-study.md").read_text()
    assert "the last error is within 10 % of the floor | all | 2 of 2" in page
    planted = wanted(1, only=["single-000"])[0].planted[0]
    assert any(
        row.startswith(f"| single-000 | {planted} (2) |") and row.endswith("| 1.150 | 1.120 |")
        for row in page.splitlines()
    )


def test_a_torn_line_is_ignored_and_its_case_run_again(tmp_path: Path) -> None:
    results = tmp_path / "cases.jsonl"
    chosen = wanted(1, limit=1)
    run_study(chosen[:2], tmp_path, 1, tell=tell_nobody, work=WORK)
    whole = results.read_bytes()
    results.write_bytes(whole[: len(whole) - 40])
    assert finished(results, 1, chosen) == {chosen[0].name}
    run_study(chosen[:2], tmp_path, 1, tell=tell_nobody, work=WORK)
    assert finished(results, 1, chosen) == {c.name for c in chosen[:2]}
    assert results.read_bytes().count(b"\n") == 3  # the torn line stays, by itself


def test_a_case_that_fails_does_not_end_the_study_and_is_tried_again(tmp_path: Path) -> None:
    chosen = wanted(1, limit=1)
    told: list[str] = []

    def fails(one: Trial) -> dict[str, Any]:
        if one.case.name == chosen[1].name:
            raise ValueError("no such luck")
        return diagnosed(one)

    assert run_study(chosen, tmp_path, 1, tell=told.append, work={"cases.jsonl": fails}) == 1
    assert any(f"{chosen[1].name}: failed: ValueError: no such luck" in line for line in told)
    assert names_in(tmp_path / "cases.jsonl") == {c.name for c in chosen} - {chosen[1].name}
    assert run_study(chosen, tmp_path, 1, tell=tell_nobody, work=WORK) == 0
    assert names_in(tmp_path / "cases.jsonl") == {c.name for c in chosen}


def test_results_of_another_seed_are_not_mixed_in(tmp_path: Path) -> None:
    run_study(wanted(1, limit=1)[:1], tmp_path, 1, tell=tell_nobody, work=WORK)
    with pytest.raises(InputError, match="holds cases of seed 1, not 2"):
        run_study(wanted(2, limit=1), tmp_path, 2, tell=tell_nobody, work=WORK)


def test_the_last_line_of_a_case_counts(tmp_path: Path) -> None:
    path = tmp_path / "results.jsonl"
    append(path, {"name": "a", "n": 1})
    append(path, {"name": "a", "n": 2})
    assert read(path) == [{"name": "a", "n": 2}]
    assert read(tmp_path / "none.jsonl") == []


def test_kinds_come_in_turn_so_that_a_stopped_study_has_some_of_each() -> None:
    order = [c.kind for c in wanted(1)[:20]]
    assert set(order) == {"single", "several", "none", "outside"}
    assert {c.kind for c in wanted(1, only=["none"])} == {"none"}
    assert [c.name for c in wanted(1, only=["single-003"])] == ["single-003"]
    with pytest.raises(InputError, match="no cases 'nun'"):
        wanted(1, only=["nun"])


def test_the_page_and_the_numbers_are_written_of_what_is_finished(tmp_path: Path) -> None:
    run_study(wanted(1, limit=22), tmp_path, 1, tell=tell_nobody, work=WORK)
    records = joined(tmp_path / "cases.jsonl", tmp_path / "sizes.jsonl")
    page = write_report(records, tmp_path / "docs").read_text()
    assert "seed 1 and revision abc" in page
    assert (
        "| one effect of size 5 or more is named first, alone or in its tied group | 95 % or more | 14 of 14" in page
    )
    assert "| with nothing missing, nothing is named | 95 % or more | 22 of 22, 100 % (85 to 100) | yes |" in page
    assert "| with nothing missing, the verdict is `nothing_missing` |  | 22 of 22, 100 % (85 to 100) | - |" in page
    assert "| a diagnosis took 30 s or less |  | 88 of 88," in page
    assert "A diagnosis took 12 s in the median, nine of ten 12 s or less, the longest\n12 s." in page
    assert "| 14 single | 30.0, 30.0, 30.0 | 1.00, 1.00, 1.00 | 30.0, 30.0, 30.0 | 1.00, 1.00, 1.00 |" in page
    numbers = json.loads((tmp_path / "docs" / "planted-study" / "planted-study.json").read_text())
    met = {c["what"]: c["met"] for c in numbers["claims"]}
    assert met["with nothing missing, nothing is named"] is True
    assert met["with nothing missing, the verdict is `nothing_missing`"] is None
    assert [f["kind"] for f in numbers["falls"]] == ["single", "several"]
    assert numbers["falls"][0]["before"] == [30.0, 30.0, 30.0]
    assert numbers["finished"] == {"single": 22, "several": 22, "none": 22, "outside": 22}
    assert [(b["k"], b["n"]) for b in numbers["detection"]] == [(0, 8), (14, 14)]
    assert all(row["planted"] == row["named"] for row in numbers["confusion"])
    for name in ("detection", "confusion"):
        assert (tmp_path / "docs" / "planted-study" / f"{name}.png").stat().st_size > 10_000


def test_a_report_of_nothing_is_an_error_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--report", "--results", str(tmp_path / "none"), "--docs", str(tmp_path)]) == 2
    assert capsys.readouterr().err == f"error: {tmp_path / 'none'}: no finished cases\n"
