"""`evs-bench reproduce`: what it prints, what it leaves, how it ends."""

from __future__ import annotations

import csv
import json
from typing import TYPE_CHECKING

import pytest

from bench.cli import run

if TYPE_CHECKING:
    from pathlib import Path

TINY = """\
format: evs-bench-study/1
title: Tiny
effort: {window: 4, pulses: 4, recordings: 1}
quick: {window: 4, pulses: 4, recordings: 1}
stimuli:
  square: {protocol: paper_square, measurement: equal_thresholds}
variants:
  - name: ideal
    title: noise-free
    stimuli: [square]
    pixel: {noise_rms: 0.0, corner_hz: 1.0e+6, refractory_s: 0.0001}
  - name: other
    title: never run here
    stimuli: [square]
    pixel: {noise_rms: 0.0, corner_hz: 1.0e+6, refractory_s: 0.0001, theta_on: 0.4, theta_off: 0.4}
claims:
  - &step
    name: right
    by: us
    source: here
    says: it steps at the threshold
    quantity: half
    of: [ideal/square/on]
    unit: threshold
    expected: 1.0
    tolerance: 0.05
    otherwise: it does not
  - {<<: *step, name: wrong, says: it steps elsewhere, expected: 1.5}
  - {<<: *step, name: elsewhere, of: [other/square/on]}
figures:
  - name: step
    title: The step
    caption: What is seen.
    panels:
      - {title: Square wave, curves: [{of: ideal/square/on, label: ON}]}
      - {title: Beside it, curves: [{of: other/square/on, label: ON}]}
  - name: left_out
    title: Not run
    caption: Nothing.
    panels: [{title: Square wave, curves: [{of: other/square/on, label: ON}]}]
"""


@pytest.fixture
def study(tmp_path: Path) -> str:
    path = tmp_path / "tiny.yaml"
    path.write_text(TINY)
    return str(path)


def test_a_claim_that_does_not_hold_is_a_finding_not_a_failure(
    study: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert run(["reproduce", study, "--only", "ideal", "--out", str(out), "--workers", "1", "--json"]) == 0
    payload = json.loads(capsys.readouterr().out)
    verdicts = {claim["claim"]: claim["verdict"] for claim in payload["claims"]}
    assert verdicts == {"right": "agrees", "wrong": "does not agree", "elsewhere": "not run"}
    page = (out / "report.html").read_text()
    assert "does not agree" in page
    assert "it does not" in page
    assert sorted(p.name for p in (out / "figures").iterdir()) == ["step.pdf", "step.png"]
    with (out / "tables" / "claims.csv").open() as file:
        rows = {row["claim"]: row for row in csv.DictReader(file)}
    assert rows["elsewhere"]["measured"] == ""
    assert abs(float(rows["right"]["measured"]) - 1.0) < 0.05


def test_the_same_seed_gives_the_same_report(study: str, tmp_path: Path) -> None:
    pages = []
    for name in ("a", "b"):
        out = tmp_path / name
        assert run(["reproduce", study, "--only", "ideal", "--out", str(out), "--workers", "1"]) == 0
        pages.append([(out / "tables" / t).read_bytes() for t in ("claims.csv", "curves.csv")])
    assert pages[0] == pages[1]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["reproduce", "papr"], "there is no study 'papr'"),
        (["reproduce", "paper", "--only", "idael_fine"], "did you mean 'ideal_fine'?"),
    ],
)
def test_a_wrong_name_is_one_line(
    arguments: list[str],
    says: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(arguments) == 1
    error = capsys.readouterr().err.strip().splitlines()
    assert len(error) == 1
    assert says in error[0]
    assert not any(tmp_path.iterdir())


def test_a_folder_that_cannot_be_made_is_told_before_the_work(
    study: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").touch()
    assert run(["reproduce", study, "--quick", "--out", str(tmp_path / "file" / "report")]) != 0
    error = capfd.readouterr().err
    assert "simulations done" not in error
    assert "report" in error
