"""The installed command: exit codes, where output goes, and how quickly it answers."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from bench import cli

COMMANDS = (
    "demo",
    "protocols",
    "check",
    "run",
    "resume",
    "rerun",
    "analyze",
    "compare",
    "diagnose",
    "report",
    "import",
    "events",
    "challenge",
    "effects",
    "calibrate-noise",
    "calibrate-biases",
    "photometry",
    "devices",
    "selftest",
)
EVS_BENCH = str(Path(sys.executable).parent / "evs-bench")

FIVE_MISTAKES = """\
format: evs-bench-protocol/1
title: five mistakes
roi: {x: 632, y: 352, width: 0, height: 16}
expect: {theta_on: 0.3, theta_off: 0.25, dark_light_lux: 0.146, bandwidth_hz: 200}
measurements:
  - name: "on"
    stimulus: {kind: reset_test, polarity: on, gap_s: -1, reset_s: 0.04, test_s: 0.04, windw_s: 0.04,
               reset_contrast: {scale: linear, value: 1.2}}
    pulses: many
    sweep:
      iluminance_lux: [100]
      contrast: {scale: log, values: [0.2, 0.3]}
"""


def evs_bench(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run the installed command, without a terminal."""
    return subprocess.run(
        [EVS_BENCH, *arguments], cwd=cwd, capture_output=True, text=True, timeout=250, stdin=subprocess.DEVNULL
    )


def test_help_names_every_command(tmp_path: Path) -> None:
    done = evs_bench("--help", cwd=tmp_path)
    assert done.returncode == 0
    assert all(name in done.stdout for name in COMMANDS)
    assert done.stderr == ""


def test_each_command_has_help_and_loads_nothing_heavy(tmp_path: Path) -> None:
    code = (
        "import sys\n"
        "from bench.cli import run\n"
        "for command in sys.argv[1:]:\n"
        "    code = run([command, '--help'])\n"
        "    heavy = {'numba', 'matplotlib', 'scipy', 'h5py', 'pydantic'} & set(sys.modules)\n"
        "    if code or heavy:\n"
        "        sys.exit(f'{command}: exit code {code}, {heavy} were loaded')\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, *COMMANDS], cwd=tmp_path, capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stderr
    told = [line for line in done.stdout.splitlines() if line.startswith("Usage: evs-bench ")]
    assert [line.split()[2] for line in told] == list(COMMANDS)


def test_a_look_at_a_protocol_loads_nothing_that_takes_or_analyses_points(tmp_path: Path) -> None:
    code = (
        "import sys\n"
        "from bench.cli import run\n"
        "code = run(['check', 'quick_look'])\n"
        "of_no_use = {'numba', 'matplotlib', 'scipy', 'h5py', 'pandas', 'sqlite3', 'starlette', 'rich', 'dask',\n"
        "    'multiprocessing', 'bench.run.runner', 'bench.run.protocol_run', 'bench.run.measuring',\n"
        "    'bench.alignment', 'bench.analysis'}\n"
        "sys.exit(code or ', '.join(sorted(of_no_use & set(sys.modules))) or 0)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.endswith("this can be taken\n")


@pytest.mark.parametrize(
    "arguments",
    [
        ("frobnicate",),
        ("run",),
        ("run", "no_such_protocol"),
        ("check", "quick_look", "--station", "no_such_station"),
        ("analyze", "no_such_run"),
        ("compare", "no_such_run"),
        ("diagnose", "no_such_run"),
        ("report", "no_such_run"),
        ("events", "no_such_file.raw"),
        ("import", "no_such_folder", "--out", "x"),
        ("protocols", "copy", "no_such_protocol"),
        ("rerun", "no_such_run"),
        ("resume", "no_such_run"),
        ("run", "quick_look", "--workers", "0"),
        ("run", "quick_look", "--workers", "2", "--cluster", "tcp://localhost:1"),
        ("effects", "no_such_effect"),
        ("challenge", "reveal", "no_such_folder"),
        ("challenge", "new", "--seed", "x"),
        ("photometry", "spectrum", "no_such_spectrum"),
        ("photometry", "meter", "no_such_file.csv"),
        ("photometry", "efficiency", "5.55", "--pitch-um", "4.86", "--photons-per-lux", "1.12e16"),
    ],
    ids=" ".join,
)
def test_bad_input_is_one_line_and_exit_code_1(
    arguments: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.run(list(arguments)) == 1
    out, err = capfd.readouterr()
    assert out == ""
    assert len(err.splitlines()) == 1, err
    assert err.startswith("evs-bench: ")
    assert list(tmp_path.iterdir()) == []


def test_the_installed_command_gives_its_exit_code_and_one_line(tmp_path: Path) -> None:
    done = evs_bench("run", "no_such_protocol", cwd=tmp_path)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (1, "", 1)
    assert done.stderr.startswith("evs-bench: ")
    assert list(tmp_path.iterdir()) == []


def test_five_mistakes_make_five_lines_and_take_nothing(tmp_path: Path) -> None:
    (tmp_path / "five.yaml").write_text(FIVE_MISTAKES)
    for command in ("check", "run"):
        done = evs_bench(command, "five.yaml", cwd=tmp_path)
        lines = done.stderr.splitlines()
        assert done.returncode == 1
        assert len(lines) == 5, done.stderr
        places = [line.removeprefix("evs-bench: ").split(": ")[0] for line in lines]
        assert [place.split(":")[1] for place in places] == ["3", "7", "7", "9", "11"], done.stderr
        assert "did you mean 'illuminance_lux'" in done.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["five.yaml"]


def test_protocols_lists_and_copies_without_overwriting(tmp_path: Path) -> None:
    listing = json.loads(evs_bench("protocols", "--json", cwd=tmp_path).stdout)
    assert listing["format"] == "evs-bench-protocols/1"
    assert {"quick_look", "on_family", "off_family"} <= {p["name"] for p in listing["protocols"]}
    assert evs_bench("protocols", "copy", "quick_look", cwd=tmp_path).returncode == 0
    again = evs_bench("protocols", "copy", "quick_look", cwd=tmp_path)
    assert again.returncode == 1
    assert "exists already" in again.stderr


def test_effects_are_listed_and_explained(capfd: pytest.CaptureFixture[str]) -> None:
    def told(*arguments: str) -> str:
        assert cli.run(["effects", *arguments]) == 0
        return capfd.readouterr().out

    listing = json.loads(told("--json"))
    assert listing["format"] == "evs-bench-effects/1"
    names = [effect["id"] for effect in listing["effects"]]
    assert {"dark_current", "leak", "shot_noise", "trail_filter"} <= set(names)
    table = told()
    assert all(name in table for name in names)
    leak = told("leak")
    for part in ("rate_per_s", "ln/s", "D = V - V_ref + rate (t - t_reset)", "Source: ", "First sign: ON noise"):
        assert part in leak
    assert cli.run(["effects", "dark_curent"]) == 1
    assert "did you mean dark_current?" in capfd.readouterr().err


def test_a_closed_pipe_is_not_an_error(tmp_path: Path) -> None:
    with subprocess.Popen(
        [EVS_BENCH, "protocols", "show", "on_family"], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        if process.stdout is None or process.stderr is None:
            pytest.fail("the pipes were not opened")
        process.stdout.close()
        complaint = process.stderr.read()
    assert complaint == b""
    assert process.returncode == 0


def test_interrupt_stops_at_a_safe_moment_with_130(tmp_path: Path) -> None:
    with subprocess.Popen(
        [EVS_BENCH, "run", "quick_look", "--out", "run"],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        deadline = time.monotonic() + 60
        while not list(tmp_path.glob("run/points/*.h5")):
            assert time.monotonic() < deadline
            assert process.poll() is None
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=60)
    assert process.returncode == 130
    journal = [json.loads(line) for line in (tmp_path / "run/journal.jsonl").read_text().splitlines()]
    assert journal[-1]["state"] == "run_aborted"
    done = [entry for entry in journal if entry["state"] == "done"]
    assert len(done) == len(list(tmp_path.glob("run/points/*.h5")))
    assert not list(tmp_path.glob("run/points/*.part"))


def test_a_bug_is_one_line_with_the_traceback_in_the_log(tmp_path: Path) -> None:
    code = (
        "import bench.commands.devices as d\n"
        "def broken(*a, **k): raise RuntimeError('something is broken')\n"
        "d.command.callback = broken\n"
        "import sys; from bench.cli import run; sys.exit(run(['devices']))"
    )
    environment = {**os.environ, "XDG_STATE_HOME": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 70
    assert len(done.stderr.splitlines()) == 1
    assert "something is broken" in done.stderr
    assert "Traceback" in (tmp_path / "evs-bench" / "evs-bench.log").read_text()


BROKEN_LAMP = """\
from drivers.errors import DeviceTimeout
from sim_backend.devices.light import SimulatedLightSource


class BrokenLamp(SimulatedLightSource):
    def _play(self, waveform):
        {fault}
"""


@pytest.mark.parametrize(
    ("fault", "told"),
    [
        ("raise DeviceTimeout(self.name, 'OUT 120', 'no answer within 1 s', 'is it switched on?')", "OUT 120"),
        ("raise BrokenPipeError(32, 'connection lost')", "connection lost"),
    ],
)
def test_a_device_that_fails_is_one_line_and_exit_code_2(fault: str, told: str, tmp_path: Path) -> None:
    (tmp_path / "broken_lamp.py").write_text(BROKEN_LAMP.format(fault=fault))
    shipped = (Path(__file__).parents[2] / "bench" / "stations" / "simulated.yaml").read_text()
    station = shipped.replace("sim_backend.devices.light:SimulatedLightSource", "broken_lamp:BrokenLamp")
    assert station != shipped
    (tmp_path / "broken.yaml").write_text(station)
    done = subprocess.run(
        [EVS_BENCH, "run", "quick_look", "--station", "broken.yaml", "--out", "run"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 2, done.stderr
    complaints = [line for line in done.stderr.splitlines() if line.startswith("evs-bench: ")]
    assert len(complaints) == 1
    assert told in complaints[0]
    journal = [json.loads(line) for line in (tmp_path / "run/journal.jsonl").read_text().splitlines()]
    assert [entry["state"] for entry in journal[-2:]] == ["failed", "run_aborted"]
    assert not list((tmp_path / "run" / "points").iterdir())
