"""A run that used an effect of a user's own says which, and is repeated with the same file only."""

from __future__ import annotations

import hashlib
import pickle
import shutil
from importlib.resources import files
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np
import pytest
import yaml

from bench import cli
from bench.commands.running import workforce_of
from bench.models.effect_sources import require_sources
from bench.store import Run
from protocols.errors import InputError
from sim_backend.pixel.effects import effects, forget_effect_files, load_effect_files

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

EFFECT = '''\
from dataclasses import dataclass
from sim_backend.pixel.effects import Effect
from sim_backend.pixel.parameters import parameter


@dataclass(frozen=True, slots=True)
class LightRefractory(Effect):
    """The dead time follows the light: ``period (1 + half_fa / I)``."""

    id = "light_refractory"
    stage = "refractory"
    sign = "The second event of a large step vanishes as the light falls."

    half_fa: float = parameter("fA", (0.0, 1e6), 10.0, 0.0, "photocurrent at which the dead time is twice as long")

    def refractory(self, period_s, current_fa, z):
        return period_s * (1.0 + self.half_fa / current_fa)
'''
PROTOCOL = """\
format: evs-bench-protocol/1
title: two lights
roi: {x: 632, y: 352, width: 2, height: 2}
expect: {theta_on: 0.3, theta_off: 0.25, refractory_period_s: 0.005, bandwidth_hz: 200, dark_light_lux: 0.001}
pulses: 3
measurements:
  - name: square
    stimulus: {kind: square, frequency_hz: 5}
    sweep:
      illuminance_lux: [1, 100]
      contrast: {scale: log, values: [0.9]}
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Return a folder with an effect, a station that names it, and a protocol; commands run in it."""
    shipped = files("bench").joinpath("stations", "simulated_ideal.yaml").read_text(encoding="utf-8")
    pixel = "noise_rms: 0.0\n"
    assert pixel in shipped
    named = "      effects: {leak: {rate_per_s: 0.01}, light_refractory: {half_fa: 10.0}}\n"
    (tmp_path / "station.yaml").write_text(shipped.replace(pixel, pixel + named))
    (tmp_path / "protocol.yaml").write_text(PROTOCOL)
    (tmp_path / "my_effect.py").write_text(EFFECT)
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    forget_effect_files()


def run(*arguments: str) -> int:
    """Run a command as in a process of its own: it knows no files of earlier ones."""
    forget_effect_files()
    return cli.run(list(arguments))


def events_of(folder: Path) -> list[Any]:
    """Return the events of each point."""
    found = []
    for point in Run.open(folder).points():
        with h5py.File(point.path) as file:
            found.append(np.stack([file[f"events/{name}"][()] for name in "txyp"], axis=1))
    return found


@pytest.fixture
def taken(folder: Path) -> Path:
    """Return the folder, with a run in it."""
    arguments = ("protocol.yaml", "--station", "station.yaml", "--effects", "my_effect.py")
    assert run("check", *arguments) == 0
    assert run("run", *arguments, "--out", "run") == 0
    return folder


def test_the_run_says_what_it_used(taken: Path) -> None:
    (source,) = Run.open(taken / "run").header.everything["software"]["effects"]
    sha256 = hashlib.sha256(EFFECT.encode()).hexdigest()
    assert source == {
        "name": "my_effect.py",
        "loaded": "file",
        "sha256": sha256,
        "effects": ["light_refractory"],
        "text": EFFECT,
    }


@pytest.mark.slow
def test_the_run_is_repeated_with_the_same_file_only(taken: Path, capfd: pytest.CaptureFixture[str]) -> None:
    capfd.readouterr()
    assert run("analyze", "run", "--no-pixel-maps") == 0
    assert run("rerun", "run", "--out", "again") == 1
    (line,) = (line for line in capfd.readouterr().err.splitlines() if line.startswith("evs-bench: "))
    assert "run.yaml: was taken with the effect light_refractory of my_effect.py (SHA-256 " in line
    assert line.endswith("name that file with --effects")

    assert run("rerun", "run", "--out", "again", "--effects", "my_effect.py") == 0
    first, second = events_of(taken / "run"), events_of(taken / "again")
    assert sum(map(len, first)) > 20
    for a, b in zip(first, second, strict=True):
        assert np.array_equal(a, b)

    (taken / "my_effect.py").write_text(EFFECT.replace("10.0", "11.0"))
    assert run("rerun", "run", "--out", "third", "--effects", "my_effect.py") == 1
    assert ", but my_effect.py is another (" in capfd.readouterr().err
    assert not (taken / "third").exists()


def test_a_worker_takes_no_other_file_than_the_run_was_begun_with(folder: Path) -> None:
    """A worker that starts late, in place of one that died or on another machine, reads the file anew."""
    file = folder / "my_effect.py"
    load_effect_files([file])
    setup = pickle.dumps(workforce_of(2, None).setup)
    forget_effect_files()
    pickle.loads(setup)()  # noqa: S301 - our own
    assert "light_refractory" in effects()
    file.write_text(EFFECT.replace("1.0 +", "2.0 +"))
    with pytest.raises(InputError, match=r"my_effect.py: is another file for this worker \(SHA-256 [0-9a-f]{12}\)"):
        pickle.loads(setup)()  # noqa: S301 - our own


def test_without_its_file_nothing_is_taken(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    for command in ("check", "run"):
        assert run(command, "protocol.yaml", "--station", "station.yaml") == 1
        assert "unknown effect 'light_refractory'" in (said := capfd.readouterr().err)
        assert "an effect of your own is known once its file is named with --effects" in said
    assert not (folder / "runs").exists()


def test_a_file_with_an_error_is_one_line(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (folder / "my_effect.py").write_text(EFFECT.replace("self.half_fa", "self.half"))
    assert run("run", "protocol.yaml", "--station", "station.yaml", "--effects", "my_effect.py") == 1
    said = capfd.readouterr().err
    assert said.startswith("evs-bench: my_effect.py:")
    assert "refractory cannot be compiled: Unknown attribute 'half'" in said
    assert said.count("\n") == 1


def test_the_effect_is_listed_and_explained(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert run("effects", "--effects", "my_effect.py") == 0
    assert "light_refractory" in capfd.readouterr().out
    assert run("effects", "light_refractory", "--effects", "my_effect.py") == 0
    told = capfd.readouterr().out
    assert told.startswith("light_refractory, stage: refractory, from my_effect.py\n")
    assert "period (1 + half_fa / I)" in told
    assert "photocurrent at which the dead time is twice as long" in told
    assert run("effects", "leak") == 0
    assert capfd.readouterr().out.startswith("leak, stage: change detector, built in\n")


def test_a_run_that_used_none_says_nothing(folder: Path) -> None:
    assert (
        run("run", "protocol.yaml", "--station", "simulated_ideal", "--effects", "my_effect.py", "--out", "run") == 0
    )
    assert "effects" not in Run.open(folder / "run").header.everything["software"]


def test_what_a_run_says_may_be_damaged(folder: Path) -> None:
    for nothing in (None, "text", [], ["text"], [{"name": "my_effect.py"}]):
        require_sources(nothing, "run.yaml")
    package = {"name": "x", "loaded": "entry point", "effects": ["mine"], "package": "my-evs-effects 1.0"}
    with pytest.raises(
        InputError, match=r"run\.yaml: was taken with the effect mine of x, an entry point of my-evs-e"
    ):
        require_sources([package], "run.yaml")


def test_effects_are_found_by_what_the_station_names(taken: Path) -> None:
    """A run whose record was lost is told from the station's text."""
    shutil.copytree(taken / "run", taken / "copy")
    content = yaml.safe_load((taken / "copy/run.yaml").read_text())
    del content["software"]
    (taken / "copy/run.yaml").write_text(yaml.safe_dump(content))
    assert run("rerun", "copy", "--out", "again") == 1
    assert run("rerun", "copy", "--out", "again", "--effects", "my_effect.py") == 0
