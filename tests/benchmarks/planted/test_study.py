"""The study as a whole: it goes on where it was stopped, and writes its page of what is finished."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest

from benchmarks.planted.report import write_report
from benchmarks.planted.results import append, finished, read
from benchmarks.planted.study import main, run_study, wanted
from benchmarks.planted.trial import Trial
from protocols.errors import InputError

if TYPE_CHECKING:
    from pathlib import Path


def record(trial: Trial) -> dict[str, Any]:
    """Return the record of a diagnosis that names what is planted from size 5 on, and is silent else."""
    case = trial.case
    sizes = {e: 2.0 + 8.0 * ((case.number + i) % 3) for i, e in enumerate(case.planted)}
    named = [e for e in case.planted if sizes[e] >= 5.0 and not case.left_out]
    errors = [30.0 / (1 + i) ** 3 for i in range(len(named))] + [1.0]
    return {
        "name": case.name,
        "study_seed": trial.study_seed,
        "revision": "abc",
        "truth": case.to_dict(),
        "sizes": {"size": sizes, "mimic": None, "beyond_mimic": 7.0 if case.left_out else None},
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


def tell_nobody(line: str) -> None:
    del line


def test_finished_cases_are_not_run_again(tmp_path: Path) -> None:
    results = tmp_path / "build" / "results.jsonl"
    chosen = wanted(1, limit=2)
    asked: list[str] = []

    def trial(one: Trial) -> dict[str, Any]:
        asked.append(one.case.name)
        return record(one)

    run_study(chosen[:3], results, 1, tell=tell_nobody, trial=trial)
    run_study(chosen, results, 1, tell=tell_nobody, trial=trial)
    assert sorted(asked) == sorted(c.name for c in chosen)
    assert finished(results, 1) == {c.name for c in chosen}


def test_sizes_are_found_once(tmp_path: Path) -> None:
    """A later study knows them, but for cases that are no longer what they were."""
    sizes = tmp_path / "sizes.jsonl"
    chosen = wanted(1, only=["single"], limit=2)
    run_study(chosen, tmp_path / "first.jsonl", 1, tell=tell_nobody, trial=record, sizes=sizes)
    known: dict[str, Any] = {}

    def trial(one: Trial) -> dict[str, Any]:
        known[one.case.name] = one.known
        return record(one)

    run_study(chosen, tmp_path / "second.jsonl", 1, tell=tell_nobody, trial=trial, sizes=sizes)
    assert {name: one.size for name, one in known.items()} == {
        c.name: record(Trial(c, 1, ""))["sizes"]["size"] for c in chosen
    }
    assert len(read(sizes)) == len(sizes.read_text().splitlines()) == 2
    changed = [replace(chosen[0], dt_s=2e-5), chosen[1]]
    run_study(changed, tmp_path / "third.jsonl", 1, tell=tell_nobody, trial=trial, sizes=sizes)
    assert known[chosen[0].name] is None
    assert known[chosen[1].name] is not None


def test_sizes_alone_are_found_again_where_a_case_has_changed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []

    def sizes(one: Trial) -> dict[str, Any]:
        asked.append(one.case.name)
        found = record(one)
        return {key: found[key] for key in ("name", "study_seed", "truth", "sizes")}

    monkeypatch.setattr("benchmarks.planted.study.run_sizes", sizes)
    arguments = ["--sizes-only", "--only", "single-000", "--results", str(tmp_path / "results.jsonl")]
    for seed in ("1", "1", "2", "1"):
        assert main([*arguments, "--seed", seed]) == 0
    assert asked == ["single-000"] * 3  # of the second seed it is another case, in the same file


def test_a_torn_line_is_ignored_and_its_case_run_again(tmp_path: Path) -> None:
    results = tmp_path / "results.jsonl"
    chosen = wanted(1, limit=1)
    run_study(chosen[:2], results, 1, tell=tell_nobody, trial=record)
    whole = results.read_bytes()
    results.write_bytes(whole[: len(whole) - 40])
    assert finished(results, 1) == {chosen[0].name}
    run_study(chosen[:2], results, 1, tell=tell_nobody, trial=record)
    assert finished(results, 1) == {c.name for c in chosen[:2]}
    assert results.read_bytes().count(b"\n") == 3  # the torn line stays, by itself


def test_a_case_that_fails_does_not_end_the_study_and_is_tried_again(tmp_path: Path) -> None:
    results = tmp_path / "results.jsonl"
    chosen = wanted(1, limit=1)
    told: list[str] = []

    def fails(one: Trial) -> dict[str, Any]:
        if one.case.name == chosen[1].name:
            raise ValueError("no such luck")
        return record(one)

    assert run_study(chosen, results, 1, tell=told.append, trial=fails) == 1
    assert any(f"{chosen[1].name}: failed: ValueError: no such luck" in line for line in told)
    assert finished(results, 1) == {c.name for c in chosen} - {chosen[1].name}
    assert run_study(chosen, results, 1, tell=tell_nobody, trial=record) == 0
    assert finished(results, 1) == {c.name for c in chosen}


def test_results_of_another_seed_are_not_mixed_in(tmp_path: Path) -> None:
    results = tmp_path / "results.jsonl"
    run_study(wanted(1, limit=1)[:1], results, 1, tell=tell_nobody, trial=record)
    with pytest.raises(InputError, match="holds cases of seed 1, not 2"):
        run_study(wanted(2, limit=1), results, 2, tell=tell_nobody, trial=record)


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
    results = tmp_path / "results.jsonl"
    run_study(wanted(1, limit=22), results, 1, tell=tell_nobody, trial=record)
    page = write_report(read(results), tmp_path / "docs").read_text()
    assert "seed 1 and revision abc" in page
    assert (
        "| one effect of size 5 or more is named first, alone or in its tied group | 95 % or more | 14 of 14" in page
    )
    assert "| with nothing missing, nothing is named | 95 % or more | 22 of 22" in page
    numbers = json.loads((tmp_path / "docs" / "planted-study" / "planted-study.json").read_text())
    assert numbers["finished"] == {"single": 22, "several": 22, "none": 22, "outside": 22}
    assert [(b["k"], b["n"]) for b in numbers["detection"]] == [(0, 8), (14, 14)]
    assert all(row["planted"] == row["named"] for row in numbers["confusion"])
    for name in ("detection", "confusion"):
        assert (tmp_path / "docs" / "planted-study" / f"{name}.png").stat().st_size > 10_000


def test_a_report_of_nothing_is_an_error_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--report", "--results", str(tmp_path / "none.jsonl"), "--docs", str(tmp_path)]) == 2
    assert capsys.readouterr().err == f"error: {tmp_path / 'none.jsonl'}: no finished cases\n"
