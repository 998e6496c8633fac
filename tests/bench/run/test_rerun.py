"""A run that is taken again from what its folder says gives the same events."""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

import h5py
import numpy as np
import pytest
import yaml

from bench.run import rerun, run_protocol
from bench.station import load_station
from bench.store import Run, RunError
from protocols import LoadedProtocol, parse_protocol

if TYPE_CHECKING:
    from pathlib import Path

DATASETS = ("events/t", "events/x", "events/y", "events/p", "triggers/t", "stimulus/t", "pulses/start")


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a run of the shipped simulated station, with another seed than its protocol's."""
    text = """\
format: evs-bench-protocol/1
title: again
roi: {x: 10, y: 20, width: 4, height: 3}
expect: {dark_light_lux: 0.146}
settings: {thresholds: {on: 0.3, off: 0.25}, refractory_period_s: 0.01, bandwidth_hz: 200}
pulses: 3
order: shuffled
measurements:
  - name: "on"
    stimulus: {kind: reset_test, polarity: "on", reset_s: 0.04, test_s: 0.04,
               reset_contrast: {scale: threshold, value: 1.8}}
    sweep:
      illuminance_lux: [0.1, 100]
      nd_od: {od: 3.0, below_lux: 0.9}
      contrast: {scale: threshold, linspace: {start: 0.7, stop: 2, num: 3}}
"""
    folder = tmp_path_factory.mktemp("rerun") / "first"
    run_protocol(parse_protocol(text, "again.yaml"), load_station("simulated"), folder, seed=99)
    return folder


def test_the_same_events_again(run_folder: Path, tmp_path: Path) -> None:
    result = rerun(run_folder, tmp_path / "second")
    assert result.run_id.endswith("Z-again")
    first, second = Run.open(run_folder), Run.open(tmp_path / "second")
    assert len(first) == len(second) == 6
    events = 0
    for a, b in zip(first.points(), second.points(), strict=True):
        with h5py.File(a.path) as one, h5py.File(b.path) as other:
            for name in DATASETS:
                np.testing.assert_array_equal(one[name][()], other[name][()])
        assert {**a.attributes, "started": ""} == {**b.attributes, "started": ""}
        events += a.n_events
    assert events > 50
    same = ("sensor", "roi", "seed", "protocol", "protocol_text", "station")
    assert all(first.header.everything[key] == second.header.everything[key] for key in same)


def test_an_imported_run_cannot_be_taken_again(data_folder: Path, tmp_path: Path) -> None:
    with pytest.raises(RunError, match="no protocol is written in it"):
        rerun(data_folder / "practice/practice_3", tmp_path / "again")


def test_a_protocol_that_is_none_is_one_line(run_folder: Path, tmp_path: Path) -> None:
    shutil.copytree(run_folder, tmp_path / "run")
    content = yaml.safe_load((tmp_path / "run/run.yaml").read_text())
    content["protocol"]["measurements"][0]["pulses"] = -1
    (tmp_path / "run/run.yaml").write_text(yaml.safe_dump(content))
    with pytest.raises(RunError, match=r"run\.yaml: the protocol in it is none that this version reads") as error:
        rerun(tmp_path / "run", tmp_path / "again")
    assert "\n" not in str(error.value)
    assert not (tmp_path / "again").exists()


def test_a_run_without_its_folder(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="No such file"):
        rerun(tmp_path / "nowhere", tmp_path / "again")


def test_the_fixture_protocol_is_a_protocol(protocol: LoadedProtocol) -> None:
    assert len(protocol.protocol.expand()) == 4
