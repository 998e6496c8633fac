"""What a diagnosis is worth: effects alone and in tied groups, intervals, and the one line that says it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from bench import cli
from bench.challenge.draw import draw
from bench.challenge.folder import make_challenge, read_truth
from bench.challenge.score import read_diagnosis, score
from bench.challenge.truth import Truth
from bench.diagnosis.expected.parameters import base_parameters
from bench.diagnosis.result import Error, Outcome, Step, Value
from bench.station.bias_map import BiasCurve, BiasMap
from protocols.errors import InputError
from sim_backend.pixel.effects import effects

BIASES = BiasMap(
    tuple(
        BiasCurve(quantity, bias, "log", (-10, 0, 10), (value / 2, value, value * 2))
        for quantity, bias, value in (
            ("theta_on", "bias_diff_on", 0.3),
            ("theta_off", "bias_diff_off", 0.25),
            ("bandwidth_hz", "bias_fo", 200.0),
            ("refractory_s", "bias_refr", 3e-3),
        )
    )
)


def truth(**found: dict[str, float]) -> Truth:
    return Truth("blind", 0.04, BIASES, found)


LEAK = {"leak": {"rate_per_s": 0.1}}
DARK = {"dark_current": {"mean_fa": 4.0}}


def diagnosis(*missing: str, ties: dict[str, tuple[str, ...]] | None = None, **told: tuple[float, float]) -> Any:
    """Return the JSON of a diagnosis; `told` are intervals, with ``__`` for the dot in their names."""
    values = {key.replace("__", "."): Value((low + high) / 2, low, high, "") for key, (low, high) in told.items()}
    error = Error(1.0, 0.0, 1.0)
    steps = tuple(Step(k, None, (), error, values if k else {}, (), ()) for k in (0, 1))
    return Outcome(("run",), (), steps, "explained", missing, ties or {}).to_dict()


@pytest.mark.parametrize(
    ("there", "named", "ties", "right", "wrong", "missed", "line"),
    [
        ({}, (), {}, 0, 0, 0, "nothing was missing, and nothing was named"),
        ({}, ("leak",), {}, 0, 1, 0, "nothing was missing, but 1 named"),
        (LEAK, ("leak",), {}, 1, 0, 0, "found 1 of 1 effect, none named wrongly"),
        (LEAK, ("dark_current",), {}, 0, 1, 1, "found 0 of 1 effect, 1 named wrongly"),
        (LEAK, (), {}, 0, 0, 1, "found 0 of 1 effect, none named wrongly"),
        (DARK, ("stray_light",), {"stray_light": ("dark_current",)}, 1, 0, 0, "found 1 of 1 effect, none"),
        (LEAK | DARK, ("leak", "dark_current"), {}, 2, 0, 0, "found all 2 effects, none named wrongly"),
        (LEAK | DARK, ("leak", "crosstalk"), {}, 1, 1, 1, "found 1 of 2 effects, 1 named wrongly"),
        # one group stands for one effect only
        (LEAK | DARK, ("crosstalk",), {"crosstalk": ("leak", "dark_current")}, 1, 0, 1, "found 1 of 2 effects"),
        # the first group must leave dark_current to the second, though it comes first in it
        (
            LEAK | DARK,
            ("crosstalk", "stray_light"),
            {"crosstalk": ("dark_current", "leak"), "stray_light": ("dark_current",)},
            2,
            0,
            0,
            "found all 2 effects",
        ),
    ],
)
def test_effects(
    there: dict[str, dict[str, float]],
    named: tuple[str, ...],
    ties: dict[str, tuple[str, ...]],
    right: int,
    wrong: int,
    missed: int,
    line: str,
) -> None:
    found = score(truth(**there), diagnosis(*named, ties=ties))
    assert (len(found.right), len(found.wrong), len(found.missed)) == (right, wrong, missed)
    assert found.verdict.startswith(line)


def test_an_effect_that_is_named_alone_stands_for_itself() -> None:
    ties: dict[str, tuple[str, ...]] = {"leak": ("dark_current",), "dark_current": ("leak",)}
    found = score(truth(**LEAK, **DARK), diagnosis("leak", "dark_current", ties=ties))
    assert [(n.effect, n.truth) for n in found.named] == [("leak", "leak"), ("dark_current", "dark_current")]


def test_numbers_are_held_against_the_intervals_of_the_last_step() -> None:
    told = diagnosis("leak", thresholds__on=(0.29, 0.31), thresholds__off=(0.26, 0.28), leak__rate_per_s=(0.1, 0.2))
    told["steps"][-1]["parameters"]["noise_floor.rms"] = {"value": 0.04, "low": 0.03, "high": None, "unit": "ln"}
    found = score(truth(**LEAK), told)
    state = {n.key: n.inside if n.told else None for n in found.numbers}
    assert state == {
        "noise_floor.rms": True,
        "thresholds.on": True,
        "thresholds.off": False,
        "source_follower_bandwidth.corner_hz": None,
        "refractory_period.period_s": None,
        "leak.rate_per_s": True,
    }
    assert found.verdict.endswith("; 3 of 4 numbers that were told lie in their 90 % intervals")
    assert json.loads(json.dumps(found.to_dict()))["inside"] == 3


def test_numbers_have_the_names_that_a_diagnosis_gives_them() -> None:
    keys = {n.key: n.unit for n in truth(**LEAK).numbers()}
    assert {f.key: f.unit for f in base_parameters(refractory_known=True)} | {"leak.rate_per_s": "ln/s"} == keys


def test_several_settings_are_numbered() -> None:
    numbers = {n.key: n.value for n in truth().numbers([{}, {"bias_diff_on": 10}])}
    assert (numbers["thresholds.on@0"], numbers["thresholds.on@1"]) == (0.3, 0.6)
    assert numbers["noise_floor.rms"] == 0.04


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is no JSON"),
        ("[]", "is no diagnosis; expected the format evs-bench-diagnosis/1"),
        ('{"format": "evs-bench-diagnosis/2"}', "is no diagnosis"),
        ('{"format": "evs-bench-diagnosis/1"}', "was it written to its end"),
    ],
)
def test_what_is_no_diagnosis_is_said(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "d.json").write_text(text)
    with pytest.raises(InputError, match=message):
        read_diagnosis(tmp_path / "d.json")


def test_new_tells_nothing_and_reveal_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.run(["challenge", "new", "--seed", "3", "--effects-count", "2"]) == 0
    out, err = capfd.readouterr()
    folder = out.strip()
    assert folder == read_truth(Path(folder)).station
    assert not [name for name in effects() if name in out + err]
    hidden = read_truth(Path(folder))
    first, second = hidden.effects
    (tmp_path / "d.json").write_text(json.dumps(diagnosis(first, "crosstalk")))
    assert cli.run(["challenge", "reveal", folder]) == 0
    out, _ = capfd.readouterr()
    for number in hidden.numbers():
        assert f"{number.key} " in out
        assert f"{number.value:.4g}" in out
    assert cli.run(["challenge", "reveal", folder, "--diagnosis", "d.json"]) == 0
    out, _ = capfd.readouterr()
    for line in (f"{first}: right", "crosstalk: named wrongly", f"{second}: missed", "verdict: found 1 of 2 effects"):
        assert f"\n{line}" in out
    assert cli.run(["challenge", "reveal", folder, "--diagnosis", "d.json", "--json"]) == 0
    told = json.loads(capfd.readouterr().out)
    assert told["format"] == "evs-bench-challenge-reveal/1"
    assert told["truth"]["effects"] == [first, second]
    assert told["score"]["missed"] == [second]


def test_a_seed_that_nobody_gave_is_another_each_time(tmp_path: Path) -> None:
    assert cli.run(["challenge", "new", "--out", str(tmp_path / "a")]) == 0
    assert cli.run(["challenge", "new", "--out", str(tmp_path / "b")]) == 0
    assert read_truth(tmp_path / "a") != read_truth(tmp_path / "b")


def test_levels_and_numbers_reach_the_draw(tmp_path: Path) -> None:
    assert cli.run(["challenge", "new", "--seed", "3", "--level", "hard", "--out", str(tmp_path / "a")]) == 0
    assert read_truth(tmp_path / "a") == read_truth(make_challenge(3, "hard", out=tmp_path / "b"))
    for wrong in (["--effects-count", "4"], ["--effects-count", "1", "--may-be-nothing"]):
        assert cli.run(["challenge", "new", *wrong, "--out", str(tmp_path / "c")]) == 1
        assert not (tmp_path / "c").exists()


def test_there_is_an_effect_unless_there_may_be_nothing(tmp_path: Path) -> None:
    seed = next(seed for seed in range(100) if not draw(seed, may_be_nothing=True).effects)
    assert cli.run(["challenge", "new", "--seed", str(seed), "--out", str(tmp_path / "a")]) == 0
    assert len(read_truth(tmp_path / "a").effects) == 1
    new = ["challenge", "new", "--seed", str(seed), "--may-be-nothing", "--out", str(tmp_path / "b")]
    assert cli.run(new) == 0
    assert not read_truth(tmp_path / "b").effects
