"""A run on a blind station tells what was measured, and nothing of what the station is."""

from __future__ import annotations

import json
import re
import shutil
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np
import pytest
import yaml

from bench import cli
from bench.analysis import analyze
from bench.analysis.tables import to_json
from bench.challenge.folder import make_challenge, read_truth
from bench.challenge.score import score
from bench.challenge.truth import Truth, biases_of
from bench.diagnosis.diagnosis import Diagnosis
from bench.run import rerun, resume, run_protocol
from bench.run.by_workers import require_simulated
from bench.station import load_station, station_from
from bench.store import Run
from protocols import load_protocol, parse_protocol
from protocols.errors import InputError
from sim_backend.pixel.effects import effects

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from bench.station import Station

#: Three effects, none of them slow to simulate.
SEED, OTHER_SEED, EFFECTS = 5, 3, 3

PROTOCOL = """\
format: evs-bench-protocol/1
title: a look at a sensor
seed: 5
roi: {x: 10, y: 20, width: 4, height: 3}
pulses: 5
measurements:
  - name: square
    stimulus: {kind: square, frequency_hz: 5}
    sweep:
      illuminance_lux: [0.2, 100]
      nd_od: {od: 3.0, below_lux: 0.9}
      contrast: {scale: log, values: [0.5]}
  - name: constant
    stimulus: {kind: constant, duration_s: 2}
    sweep: {illuminance_lux: 100}
    settings: SETTINGS
"""

#: A small run in which a dark current is found: a level of light at which it counts, and one at which it does not.
SMALL = """\
format: evs-bench-protocol/1
title: two levels of light
seed: 5
roi: {x: 10, y: 20, width: 8, height: 8}
pulses: 5
measurements:
  - name: square
    stimulus: {kind: square, frequency_hz: 5}
    sweep: {illuminance_lux: [1, 100], contrast: {scale: log, values: [0.5]}}
"""
#: The true effect, its twin, and another: with all of them a diagnosis takes 15 s.
THOUGHT_OF = {"dark_current", "stray_light", "leak"}

#: Of a station's arguments, and of its world.
OF_A_STATION = ("sealed", "world", "OpticalBench", "SimulatedCamera", "noise_rms", "sensor_seed", "bias_map", "table")


def take(station: Station, out: Path, settings: str = "{}") -> Path:
    return run_protocol(parse_protocol(PROTOCOL.replace("SETTINGS", settings), "look.yaml"), station, out).folder


@pytest.fixture(scope="module", name="challenge")
def a_challenge(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_challenge(SEED, "hard", EFFECTS, tmp_path_factory.mktemp("blind") / "challenge")


@pytest.fixture(scope="module", name="run")
def a_run(challenge: Path) -> Path:
    return take(load_station(challenge / "station.yaml"), challenge.parent / "run")


def texts(folder: Path) -> Iterator[str]:
    """Yield all that a run says: files, HDF5 names, and HDF5 attributes."""
    for path in sorted(p for p in folder.rglob("*") if p.is_file()):
        yield path.name
        if path.suffix != ".h5":
            yield path.read_bytes().decode("utf-8")
        else:
            yield from _objects(path)


def _objects(path: Path) -> list[str]:
    """Return the names of all groups, datasets and attributes of an HDF5 file, and the attributes themselves."""
    found: list[str] = []

    def look(name: str, item: Any) -> None:
        found.append(name)
        found.extend(f"{key}: {value!r} {value}" for key, value in item.attrs.items())

    with h5py.File(path) as file:
        look("/", file)
        file.visititems(look)
    return found


def secrets_of(truth: Truth) -> set[str]:
    """Return the texts that would tell something: names of effects, arguments of a station, true numbers."""
    told = {"refractory_period.period_s"}  # a camera measures its own dead time
    numbers = {repr(n.value) for n in truth.numbers() if n.key not in told}
    return {*effects(), "effects", *OF_A_STATION, *numbers}


def found_in(folder: Path, secrets: set[str]) -> set[str]:
    everything = "\n".join(texts(folder))
    return {secret for secret in secrets if secret in everything}


def test_nothing_in_the_run_folder_tells_what_the_station_is(challenge: Path, run: Path) -> None:
    truth = read_truth(challenge)
    assert len(truth.effects) == EFFECTS
    assert found_in(run, secrets_of(truth)) == set()
    assert yaml.safe_load((run / "run.yaml").read_text())["station"] == {"name": truth.station}


def test_the_same_station_with_open_eyes_would_be_found_out(challenge: Path, tmp_path: Path) -> None:
    """Otherwise the test before this one looks in the wrong places."""
    seeing = station_from(load_station(challenge / "station.yaml").resolved, "here")
    truth = read_truth(challenge)
    found = found_in(take(seeing, tmp_path / "run"), secrets_of(truth))
    assert {*truth.effects, "noise_rms", "sensor_seed", "OpticalBench", repr(truth.noise_rms)} <= found


def test_the_station_file_and_the_sealed_file_do_not_tell_either(challenge: Path) -> None:
    truth = read_truth(challenge)
    secrets = {*effects(), *(repr(n.value) for n in truth.numbers()), "sensor_seed", "noise_rms"}
    assert found_in(challenge, secrets) == set()


def without_station(run: Path, bare: Path) -> Path:
    """Return a copy of a run that does not say of its station what it is: no world, no devices, no arguments."""
    shutil.copytree(run, bare)
    header = yaml.safe_load((bare / "run.yaml").read_text())
    (bare / "run.yaml").write_text(yaml.safe_dump({k: v for k, v in header.items() if k != "station"}))
    return bare


def test_without_its_station_a_run_gives_the_same_results(run: Path, tmp_path: Path) -> None:
    bare = without_station(run, tmp_path / "run")
    assert to_json(analyze(Run.open(bare))) == to_json(analyze(Run.open(run)))


def diagnosed(run: Path) -> dict[str, Any]:
    """Return what `evs-bench diagnose --json` prints, of few effects; it names a run by its id."""
    with Diagnosis(run, seed=3, without=effects().keys() - THOUGHT_OF) as diagnosis:
        told: dict[str, Any] = json.loads(json.dumps(diagnosis.run(most=1).to_dict()))
    return told


def test_without_its_station_a_run_gets_the_same_diagnosis(tmp_path: Path) -> None:
    challenge = make_challenge(SEED, "hard", 1, tmp_path / "challenge")
    seeing = station_from(load_station(challenge / "station.yaml").resolved, "here")
    run = run_protocol(parse_protocol(SMALL, "small.yaml"), seeing, tmp_path / "run").folder
    bare = without_station(run, tmp_path / "bare")
    told_by_it = {"dark_current", "OpticalBench", "SimulatedCamera", "noise_rms", "sensor_seed", "bias_map"}
    assert found_in(run, told_by_it) == told_by_it
    assert found_in(bare, told_by_it) == set()
    told = diagnosed(run)
    assert score(read_truth(challenge), told).right  # otherwise there is little that could differ
    assert diagnosed(bare) == told


def events(folder: Path) -> list[np.ndarray[Any, Any]]:
    return [np.concatenate(list(point.events())) for point in Run.open(folder).points()]


def same(one: Path, other: Path) -> bool:
    return all(np.array_equal(a, b) for a, b in zip(events(one), events(other), strict=True))


def test_the_same_seed_is_the_same_station_with_the_same_events(challenge: Path, run: Path, tmp_path: Path) -> None:
    again = make_challenge(SEED, "hard", EFFECTS, tmp_path / "again")
    other = make_challenge(OTHER_SEED, "hard", EFFECTS, tmp_path / "other")
    for name in ("station.yaml", "sealed.bin"):
        assert (again / name).read_bytes() == (challenge / name).read_bytes()
        assert (other / name).read_bytes() != (challenge / name).read_bytes()
    assert sum(map(len, events(run))) > 0
    assert same(run, take(load_station(again / "station.yaml"), tmp_path / "run"))
    assert not same(run, take(load_station(other / "station.yaml"), tmp_path / "other_run"))


def test_a_run_can_be_taken_again_and_resumed_where_its_station_is_named(
    challenge: Path, run: Path, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=r"only the name; name its file with --station"):
        rerun(run, tmp_path / "again")
    with pytest.raises(InputError, match=r"it was taken on station blind-.*, not on simulated"):
        rerun(run, tmp_path / "again", station=load_station("simulated"))
    station = load_station(challenge / "station.yaml")
    assert same(run, rerun(run, tmp_path / "again", station=station).folder)
    assert not (tmp_path / "again" / "sealed.bin").exists()
    assert resume(run, station=station).done == 3
    require_simulated(station)  # it may have several workers


def test_the_truth_is_told_at_the_biases_of_a_run(challenge: Path, tmp_path: Path) -> None:
    truth = read_truth(challenge)
    run = take(load_station(challenge / "station.yaml"), tmp_path / "run", "{thresholds: {on: 0.4, off: 0.25}}")
    settings = biases_of([Run.open(run)], truth.station)
    assert len(settings) == 2  # the square waves leave the biases as they are
    numbers = {n.key: n.value for n in truth.numbers(settings)}
    believed = {"on": (0.30, 0.40), "off": (0.25, 0.25)}
    for polarity, (factory, asked) in believed.items():
        at = [numbers[f"thresholds.{polarity}@{k}"] for k in (0, 1)]
        assert at[1] / at[0] == pytest.approx(asked / factory)  # the shape is that of the data sheet
    at_factory = {n.key: n.value for n in truth.numbers()}
    assert at_factory["thresholds.on"] == numbers["thresholds.on@0"]
    with pytest.raises(InputError, match=r"station blind-.*; expected a run that was taken on blind-other"):
        biases_of([Run.open(run)], "blind-other")


def test_a_diagnosis_is_held_against_the_truth_with_its_own_runs_only(
    challenge: Path, run: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    told = {"format": "evs-bench-diagnosis/1", "runs": [Run.open(run).header.id], "steps": [], "missing": []}
    (tmp_path / "own.json").write_text(json.dumps(told))
    (tmp_path / "other.json").write_text(json.dumps(told | {"runs": ["2026-11-20-other"]}))
    reveal = ["challenge", "reveal", str(challenge), "--diagnosis"]
    assert cli.run([*reveal, str(tmp_path / "own.json"), "--run", str(run)]) == 0
    assert "is not seen" not in capfd.readouterr().err
    assert cli.run([*reveal, str(tmp_path / "other.json")]) == 0
    assert "that the diagnosis is of this station is not seen from it" in capfd.readouterr().err
    assert cli.run([*reveal, str(tmp_path / "other.json"), "--run", str(run)]) == 1
    out, err = capfd.readouterr()
    assert not out
    assert re.search(rf"other.json: is a diagnosis of 2026-11-20-other; expected .* {told['runs'][0]}\n", err)


@pytest.mark.parametrize("name", ["challenge", "quick_look", "on_family", "off_family", "pulse_width"])
def test_shipped_protocols_can_be_taken(challenge: Path, name: str) -> None:
    from bench.run import check

    report = check(load_protocol(name).protocol, load_station(challenge / "station.yaml"))
    assert not report.refused
    assert report.station == read_truth(challenge).station


def test_what_is_no_challenge_is_said(challenge: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="exists already; choose another folder with --out"):
        make_challenge(SEED, out=challenge)
    with pytest.raises(InputError, match=r"station\.yaml: cannot be read"):
        read_truth(tmp_path)
    plan = load_station("simulated").resolved
    (tmp_path / "station.yaml").write_text(yaml.safe_dump(plan))
    with pytest.raises(InputError, match="is no blind station; make one with: evs-bench challenge new"):
        read_truth(tmp_path)
