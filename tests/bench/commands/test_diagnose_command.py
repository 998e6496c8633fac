"""`evs-bench diagnose`: what goes to stdout, to stderr, and into files. A stub stands for the diagnosis itself."""

from __future__ import annotations

import json
import os
import signal
import time
from dataclasses import replace
from importlib.resources import files
from typing import TYPE_CHECKING, Any, ClassVar

import pytest
from click.testing import CliRunner

from bench import cli
from bench.commands.diagnose import command
from bench.diagnosis.telling.reading import read_outcome
from protocols.errors import InputError
from sim_backend.pixel import read_model_file

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from bench.diagnosis.result import Outcome, Step

PROTOCOL = """\
format: evs-bench-protocol/1
title: dark
roi: {x: 10, y: 20, width: 3, height: 2}
measurements:
  - name: dark
    stimulus: {kind: constant, duration_s: 0.1}
    sweep: {illuminance_lux: [100]}
"""


class Stub:
    """Stands for the stepwise diagnosis; it finds what `found` says."""

    found: ClassVar[Any]
    asked: ClassVar[dict[str, Any]]

    def __init__(self, runs: Any, model: Any, **options: Any) -> None:
        type(self).asked = {"runs": runs, "model": model, **options}
        options["tell"]("fitting the model")
        self.findings = self.found.findings
        self.shortened = "the beginning of 1 of 2 recordings: 3 of 10 s"
        self.cautions = self.found.cautions
        self.problem, self.fits = None, ()
        self._steps: tuple[Step, ...] = self.found.steps[:1]
        self.begun = True

    def __enter__(self) -> Stub:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    @property
    def steps(self) -> tuple[Step, ...]:
        return self._steps

    @property
    def proposal(self) -> str | None:
        return "dark_current" if len(self._steps) == 1 else None

    def add(self, effect_id: str) -> Step:
        self._steps = (*self._steps, replace(self.found.steps[1], added=effect_id))
        return self._steps[-1]

    def undo(self) -> Step:
        self._steps = self._steps[:-1]
        return self._steps[-1]

    def run(self, most: int) -> Outcome:
        type(self).asked["most"] = most
        return self.found  # type: ignore[no-any-return]

    def outcome(self, *, measure_next: bool = True) -> Outcome:
        type(self).asked["measure_next"] = measure_next
        missing = tuple(s.added for s in self._steps if s.added is not None)
        return replace(self.found, steps=self._steps, missing=missing)  # type: ignore[no-any-return]


def stop(*_: object) -> Outcome:
    """Stand for a person who presses Ctrl-C."""
    raise KeyboardInterrupt


def search_long(*_: object) -> Outcome:
    time.sleep(30)
    pytest.fail("nothing ended the search")


def killed(*_: object) -> Outcome:
    """Stand for a search that a batch system ends."""
    os.kill(os.getpid(), signal.SIGTERM)
    return search_long()


def nothing_begun(stub: Stub) -> Stub:
    stub.begun = False
    return stub


@pytest.fixture(name="folder", scope="module")
def small_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("diagnose")
    (folder / "dark.yaml").write_text(PROTOCOL)
    assert cli.run(["run", str(folder / "dark.yaml"), "--out", str(folder / "run")]) == 0
    return folder / "run"


@pytest.fixture(name="diagnose")
def diagnose_command(
    folder: Path, tmp_path: Path, explained: Outcome, monkeypatch: pytest.MonkeyPatch
) -> Callable[..., Any]:
    """Run the command on a small run, with a stub; the results go to a folder of their own."""
    Stub.found = explained
    monkeypatch.setattr("bench.diagnosis.diagnosis.Diagnosis", Stub)
    monkeypatch.setattr("bench.report.diagnosis.diagnosis_pictures", lambda *_: ())

    def run(*arguments: str, **options: Any) -> Any:
        done = CliRunner().invoke(command, [str(folder), "--out", str(tmp_path), *arguments], **options)
        if done.exception is not None and not isinstance(done.exception, SystemExit):
            raise done.exception
        return done

    return run


def test_the_result_goes_to_stdout_and_what_is_being_done_to_stderr(
    diagnose: Callable[..., Any], tmp_path: Path, explained: Outcome
) -> None:
    done = diagnose("--max-effects", "2", "--seed", "7", "--workers", "1")
    lines = done.stdout.splitlines()
    assert lines[0] == "run 2026-11-20-on-family   1 point, 6 pixels, fit to judge"
    assert lines[1].startswith("step 0  thresholds")
    assert lines[-1].startswith("to tell the two apart")
    assert "fitting the model" in done.stderr
    assert (Stub.asked["most"], Stub.asked["seed"], Stub.asked["model"]) == (2, 7, None)
    assert {p.name for p in (tmp_path / "diagnosis").iterdir()} == {
        "diagnosis.json", "model.yaml", "diagnosis.html", "figures",
    }  # fmt: skip
    assert read_model_file(tmp_path / "diagnosis/model.yaml") == explained.model


def test_json_is_all_of_stdout_and_the_same_as_the_file(diagnose: Callable[..., Any], tmp_path: Path) -> None:
    told = json.loads(diagnose("--json").stdout)
    assert told["format"] == "evs-bench-diagnosis/1"
    assert told["missing"] == ["dark_current"]
    assert told == json.loads((tmp_path / "diagnosis/diagnosis.json").read_text())


def test_by_hand_the_picked_effects_are_what_is_written(diagnose: Callable[..., Any], tmp_path: Path) -> None:
    done = diagnose("--interactive", input="leek\n\nu\nstray_light\nq\n")
    assert "leek: no such effect; did you mean leak?" in done.stdout
    assert "ENTER adds dark_current" in done.stderr
    assert done.stdout.startswith("looked at the beginning of 1 of 2 recordings: 3 of 10 s\n")
    written = json.loads((tmp_path / "diagnosis/diagnosis.json").read_text())
    assert written["missing"] == ["stray_light"]
    assert [s["added"] for s in written["steps"]] == [None, "stray_light"]


@pytest.mark.parametrize("options", [(), ("--json",), ("--interactive",)])
def test_ctrl_c_keeps_what_was_found_so_far(
    diagnose: Callable[..., Any], folder: Path, tmp_path: Path, explained: Outcome, monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str], options: tuple[str, ...],
) -> None:  # fmt: skip
    so_far = replace(explained, verdict="unexplained", stopped=True)
    monkeypatch.setattr(Stub, "found", so_far)
    monkeypatch.setattr(Stub, "run", stop)
    monkeypatch.setattr(Stub, "proposal", property(stop))
    code = cli.run(["diagnose", str(folder), "--out", str(tmp_path), *options])
    out, err = capfd.readouterr()
    written = json.loads((tmp_path / "diagnosis/diagnosis.json").read_text())
    assert code == cli.EXIT_STOPPED
    assert Stub.asked["measure_next"] is False  # that would take as long as the search
    assert (written["verdict"], written["stopped"], written["missing"]) == ("unexplained", True, [])
    assert "stopping, with what was found so far" in err
    assert err.splitlines()[-1].startswith("evs-bench: stopped; model, tables and figures are in ")
    assert json.loads(out) == written if options == ("--json",) else "verdict: unexplained so far" in out


def test_ctrl_c_before_anything_was_found_writes_nothing(
    diagnose: Callable[..., Any], folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Stub, "run", stop)
    monkeypatch.setattr(Stub, "__enter__", nothing_begun)
    assert cli.run(["diagnose", str(folder), "--out", str(tmp_path)]) == cli.EXIT_STOPPED
    assert not (tmp_path / "diagnosis").exists()


def test_a_search_ends_with_its_time(
    diagnose: Callable[..., Any], folder: Path, tmp_path: Path, explained: Outcome, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Stub, "found", replace(explained, verdict="unexplained", stopped=True))
    monkeypatch.setattr(Stub, "run", search_long)
    done = diagnose("--minutes", "0.002")
    assert done.exit_code == 0  # as was asked for
    assert "stopped after 0.002 min, with what was found so far" in done.stderr
    assert "verdict: unexplained so far" in done.stdout
    assert json.loads((tmp_path / "diagnosis/diagnosis.json").read_text())["stopped"] is True


def test_a_time_too_short_for_anything_is_said_to_be(
    diagnose: Callable[..., Any], folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.setattr(Stub, "run", search_long)
    monkeypatch.setattr(Stub, "__enter__", nothing_begun)
    assert cli.run(["diagnose", str(folder), "--out", str(tmp_path), "--minutes", "0.002"]) == cli.EXIT_STOPPED
    assert capfd.readouterr().err.endswith("evs-bench: stopped after 0.002 min, before the model was fitted\n")
    assert not (tmp_path / "diagnosis").exists()


def test_a_polite_kill_keeps_what_was_found_so_far(
    diagnose: Callable[..., Any], folder: Path, tmp_path: Path, explained: Outcome, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Stub, "found", replace(explained, verdict="unexplained", stopped=True))
    monkeypatch.setattr(Stub, "run", killed)
    before = signal.getsignal(signal.SIGTERM)
    assert cli.run(["diagnose", str(folder), "--out", str(tmp_path)]) == cli.EXIT_STOPPED
    assert json.loads((tmp_path / "diagnosis/diagnosis.json").read_text())["stopped"] is True
    assert signal.getsignal(signal.SIGTERM) is before


def test_by_hand_with_json_keeps_the_tables_off_stdout(diagnose: Callable[..., Any]) -> None:
    done = diagnose("--interactive", "--json", input="\n")  # and then nobody answers any more
    assert json.loads(done.stdout)["missing"] == ["dark_current"]
    assert "step 1  + dark_current" in done.stderr


def test_the_model_to_start_from_is_read_from_its_file(
    diagnose: Callable[..., Any], tmp_path: Path, explained: Outcome
) -> None:
    diagnose()
    diagnose("--model", str(tmp_path / "diagnosis/model.yaml"))
    assert Stub.asked["model"] == explained.model


def test_data_that_are_not_fit_have_a_verdict_and_no_steps(diagnose: Callable[..., Any], explained: Outcome) -> None:
    Stub.found = replace(
        explained, findings=("too few events",), verdict="data_not_fit_to_judge", steps=(), missing=(),
        next_measurement=None, model=None,
    )  # fmt: skip
    done = diagnose()
    assert "not fit to judge" in done.stdout
    assert done.stdout.endswith("verdict: the data are not fit to be judged: too few events\n")
    assert "the reasons are in " in done.stderr


@pytest.mark.parametrize("options", [(), ("--json",)])
def test_by_hand_data_that_are_not_fit_are_looked_at_and_nothing_but_the_reasons_is_written(
    diagnose: Callable[..., Any], tmp_path: Path, explained: Outcome, options: tuple[str, ...]
) -> None:
    diagnose()
    assert (tmp_path / "diagnosis/model.yaml").exists()
    unfit: dict[str, Any] = {
        "findings": ("too few events",),
        "verdict": "data_not_fit_to_judge",
        "not_asked": {"leak": "-"},
    }
    Stub.found = replace(explained, **unfit)
    done = diagnose("--interactive", *options, input="\nq\n")
    told = done.stderr if options else done.stdout
    assert "not fit to judge: too few events\n" in told
    assert "step 1  + dark_current" in told
    left = {p.name for p in (tmp_path / "diagnosis").rglob("*") if p.is_file()}
    assert left == {"diagnosis.json", "diagnosis.html"}
    written = json.loads((tmp_path / "diagnosis/diagnosis.json").read_text())
    assert (written["verdict"], written["steps"], written["missing"]) == ("data_not_fit_to_judge", [], [])
    assert written["data_quality"] == {"ok": False, "findings": ["too few events"]}
    assert written["not_asked"] == {}
    assert not options or json.loads(done.stdout) == written


def test_a_run_without_an_event_is_looked_at_by_hand(tmp_path: Path) -> None:
    sweep = "sweep: {illuminance_lux: [100], contrast: {scale: log, values: [0.02, 0.03]}}"
    stimulus = f"stimulus: {{kind: square, frequency_hz: 10}}\n    {sweep}"
    text = PROTOCOL[: PROTOCOL.index("stimulus:")] + stimulus + "\npulses: 3\n"
    (tmp_path / "faint.yaml").write_text(text)
    ideal = str(files("bench") / "stations" / "simulated_ideal.yaml")
    assert cli.run(["run", str(tmp_path / "faint.yaml"), "--station", ideal, "--out", str(tmp_path / "run")]) == 0
    done = CliRunner().invoke(command, [str(tmp_path / "run"), "--interactive", "--workers", "1"], input="q\n")
    assert done.exit_code == 0, done.output
    assert "not fit to judge: 0 events" in done.stdout
    assert "step 0  " in done.stdout


@pytest.mark.parametrize("options", [(), ("--interactive",)])
def test_what_is_to_be_known_of_data_that_are_fit_is_told_above(
    diagnose: Callable[..., Any], tmp_path: Path, explained: Outcome, options: tuple[str, ...]
) -> None:
    Stub.found = replace(explained, cautions=("the readout was the limit",))
    lines = diagnose(*options, input="q\n").stdout.splitlines()
    assert "fit to judge, but the readout was the limit" in lines[:2]
    assert "not fit to judge" not in lines[0]
    written = json.loads((tmp_path / "diagnosis/diagnosis.json").read_text())
    assert written["data_quality"] == {"ok": True, "findings": ["the readout was the limit"]}
    read = read_outcome(tmp_path / "diagnosis/diagnosis.json")
    assert (read.findings, read.cautions) == ((), ("the readout was the limit",))


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["no_such_run"], "no_such_run"),
        ([], "Missing argument"),
        (["RUN", "--model", "no_model.yaml"], "no_model.yaml"),
        (["RUN", "--effects", "no_effects.py"], "no_effects.py"),
    ],
)
@pytest.mark.parametrize("name", ["compare", "diagnose"])
def test_bad_input_is_one_line(
    name: str, arguments: list[str], complaint: str, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert cli.run([name, *(str(folder) if a == "RUN" else a for a in arguments)]) == 1
    out, err = capfd.readouterr()
    assert (out, len(err.splitlines())) == ("", 1), err
    assert complaint in err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("option", ["--max-effects", "--minutes"])
def test_who_picks_says_when_it_is_enough(diagnose: Callable[..., Any], option: str) -> None:
    done = diagnose("--interactive", option, "2")
    assert done.exit_code == 2
    assert f"{option} says nothing with --interactive" in done.stderr
    diagnose()
    assert Stub.asked["most"] == 3


def test_what_stands_in_the_way_of_the_results_is_told_at_once(diagnose: Callable[..., Any], tmp_path: Path) -> None:
    (tmp_path / "diagnosis").write_text("notes")
    Stub.asked.clear()
    with pytest.raises(InputError, match="diagnosis: is a file; expected a folder"):
        diagnose()
    assert not Stub.asked
    assert (tmp_path / "diagnosis").read_text() == "notes"
