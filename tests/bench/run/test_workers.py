"""One sweep, however it is taken: by one process, two, or a cluster, with workers lost on the way, in two parts."""

from __future__ import annotations

import hashlib
import io
import json
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np
import pytest
import yaml

from bench.compute import WorkerLost, Workforce
from bench.run import resume, run_protocol
from bench.run.measuring import PointJob, measure
from bench.run.plan import plan_or_raise
from bench.run.progress import LineProgress, Status
from bench.station import Station, load_station
from bench.store import Run, RunError
from drivers.errors import DeviceError
from protocols import InputError, LoadedProtocol, parse_protocol

if TYPE_CHECKING:
    from collections.abc import Callable

SWEEP = """\
format: evs-bench-protocol/1
title: one sweep
seed: 11
roi: {x: 10, y: 20, width: 4, height: 3}
expect: {dark_light_lux: 0.146}
settings: {thresholds: {on: 0.3, off: 0.25}, refractory_period_s: 0.01, bandwidth_hz: 200}
pulses: 2
measurements:
  - name: "on"
    stimulus: {kind: reset_test, polarity: "on", reset_s: 0.03, test_s: 0.03, gap_s: 0.03,
               reset_contrast: {scale: log, value: 0.8}}
    sweep:
      illuminance_lux: [0.5, 100]
      nd_od: {od: 2.0, below_lux: 0.9}
      contrast: {scale: log, values: [0.3, 0.6]}
  - name: "dark"
    stimulus: {kind: constant, duration_s: 0.3}
    ambient: capped
    sweep: {illuminance_lux: [100]}
  - name: "square"
    stimulus: {kind: square, frequency_hz: 10}
    sweep: {illuminance_lux: [10], contrast: {scale: log, values: [0.5]}}
"""
POINTS = 6
#: Many points, each of which takes no time with the quick camera.
MANY = SWEEP.replace("values: [0.3, 0.6]", "linspace: {start: 0.3, stop: 0.6, num: 5}")


@pytest.fixture(scope="module")
def protocol() -> LoadedProtocol:
    """Return six points."""
    return parse_protocol(SWEEP, "sweep.yaml")


@pytest.fixture(scope="module")
def many() -> LoadedProtocol:
    """Return twelve points."""
    return parse_protocol(MANY, "many.yaml")


def station_with(folder: Path, camera: str, **arguments: str) -> Station:
    """Return the shipped simulated station with a camera of :mod:`worker_cameras`, written into `folder`."""
    content = yaml.safe_load((Path(__file__).parents[3] / "bench" / "stations" / "simulated.yaml").read_text())
    content["roles"]["camera"]["driver"] = f"worker_cameras:{camera}"
    content["roles"]["camera"]["args"] |= arguments
    (folder / "station.yaml").write_text(yaml.safe_dump(content))
    return load_station(folder / "station.yaml")


@pytest.fixture
def mortal(tmp_path: Path) -> Station:
    """Return a station whose camera kills its first reader of point 1."""
    return station_with(tmp_path, "DyingCamera", fatal="on 1", marker=str(tmp_path / "died"))


@pytest.fixture
def quick(tmp_path: Path) -> Station:
    """Return a station with the quick camera."""
    return station_with(tmp_path, "QuickCamera")


@pytest.fixture(scope="module")
def expected(protocol: LoadedProtocol, tmp_path_factory: pytest.TempPathFactory) -> dict[int, str]:
    """Return the hashes of what this process alone takes, point by point on one station."""
    folder = tmp_path_factory.mktemp("serial") / "run"
    run_protocol(protocol, load_station("simulated"), folder)
    assert sum(point.n_events for point in Run.open(folder).points()) > 300
    return hashes(folder)


@pytest.fixture(scope="module")
def whole_many(many: LoadedProtocol, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the run of many points that this process alone takes with the quick camera; not to be touched."""
    folder = tmp_path_factory.mktemp("serial")
    run_protocol(many, station_with(folder, "QuickCamera"), folder / "run")
    return folder / "run"


@pytest.fixture(scope="module")
def expected_many(whole_many: Path) -> dict[int, str]:
    """Return the hashes of its points."""
    return hashes(whole_many)


def hashes(folder: Path) -> dict[int, str]:
    """Return, for each point, a hash of all that its file holds but the time of day."""
    found = {}
    for point in Run.open(folder).points():
        digest = hashlib.sha256()

        def add(name: str, node: Any, digest: Any = digest) -> None:
            digest.update(name.encode())
            digest.update(repr(sorted((k, str(v)) for k, v in node.attrs.items() if k != "started")).encode())
            if isinstance(node, h5py.Dataset):
                digest.update(np.ascontiguousarray(node[()]).tobytes())

        with h5py.File(point.path) as file:
            add("", file)
            file.visititems(add)
        found[point.index] = digest.hexdigest()
    return found


def _states(folder: Path) -> list[tuple[str, int | None]]:
    lines = [json.loads(line) for line in (folder / "journal.jsonl").read_text().splitlines()]
    return [(line["state"], line.get("point")) for line in lines]


def _is_whole(folder: Path, expected: dict[int, str]) -> None:
    Run.open(folder).verify()
    assert hashes(folder) == expected
    assert sorted(file.name for file in (folder / "points").iterdir()) == [f"{n:06d}.h5" for n in expected]
    assert _states(folder)[-1] == ("run_finished", None)


class Telling(LineProgress):
    """Keeps what the operator is told, and may do something when so many points are done."""

    def __init__(self, at: int = -1, do: Callable[[], None] = lambda: None) -> None:
        super().__init__(io.StringIO(), 0.0)
        self._at, self._do = at, do

    def update(self, status: Status) -> None:
        super().update(status)
        if status.done == self._at:
            self._at = -1
            self._do()

    @property
    def text(self) -> str:
        return self._stream.getvalue()  # type: ignore[attr-defined,no-any-return]


def _press_ctrl_c(times: int = 1) -> None:
    for _ in range(times):
        os.kill(os.getpid(), signal.SIGINT)


@pytest.mark.slow
def test_two_processes_one_of_which_is_lost(
    protocol: LoadedProtocol, mortal: Station, expected: dict[int, str], tmp_path: Path
) -> None:
    told = Telling()
    result = run_protocol(protocol, mortal, tmp_path / "run", workforce=Workforce(2), progress=told)
    assert (result.done, result.total, result.stopped, result.resumable) == (POINTS, POINTS, False, True)
    _is_whole(tmp_path / "run", expected)
    assert (tmp_path / "died").exists()
    assert "a worker died over point 1 (on, 100 lux, log contrast 0.600) (killed by SIGKILL" in told.text
    states = _states(tmp_path / "run")
    assert states[: POINTS + 1] == [("run_started", None), *[("planned", n) for n in range(POINTS)]]
    for n in range(POINTS):
        assert states.index(("started", n)) < states.index(("done", n))
    assert "6 of 6 points done" in told.text


@pytest.mark.slow
def test_a_cluster_of_two_workers_one_of_which_is_lost(
    protocol: LoadedProtocol, mortal: Station, expected: dict[int, str], tmp_path: Path, cluster_address: str
) -> None:
    run_protocol(protocol, mortal, tmp_path / "run", workforce=Workforce(cluster=cluster_address))
    assert (tmp_path / "died").exists()
    _is_whole(tmp_path / "run", expected)


@pytest.mark.slow
def test_ctrl_c_and_then_the_rest_with_another_number_of_workers(
    many: LoadedProtocol, quick: Station, expected_many: dict[int, str], tmp_path: Path
) -> None:
    """The first Ctrl-C lets what is under way be finished."""
    folder, told = tmp_path / "run", Telling(1, _press_ctrl_c)
    result = run_protocol(many, quick, folder, workforce=Workforce(2), progress=told)
    assert result.stopped
    assert 2 <= result.done <= 4
    assert _states(folder)[-1] == ("run_aborted", None)
    assert {n for state, n in _states(folder) if state == "started"} == set(hashes(folder))
    resumed = resume(folder, progress=told)
    assert (resumed.done, resumed.total, resumed.run_id) == (len(expected_many), len(expected_many), result.run_id)
    _is_whole(folder, expected_many)
    assert ("resumed", None) in _states(folder)
    assert resume(folder, workforce=Workforce(3), progress=told).done == len(expected_many)
    assert "all 12 points of this run are done" in told.text


@pytest.mark.slow
def test_a_second_ctrl_c_stops_at_once_and_leaves_nothing_half_written(
    many: LoadedProtocol, quick: Station, expected_many: dict[int, str], tmp_path: Path
) -> None:
    folder, told = tmp_path / "run", Telling(2, lambda: _press_ctrl_c(2))
    before = set(multiprocessing.active_children())
    with pytest.raises(KeyboardInterrupt):
        run_protocol(many, quick, folder, workforce=Workforce(2), progress=told)
    states = _states(folder)
    assert states[-1] == ("run_aborted", None)
    begun, ended = ({n for state, n in states if state in names} for names in ({"started"}, {"done", "failed"}))
    assert begun == ended
    assert not list((folder / "points").glob("*.part*"))
    assert set(multiprocessing.active_children()) <= before
    resume(folder)
    _is_whole(folder, expected_many)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("camera", "error", "text"),
    [
        ("DeadlyCamera", WorkerLost, "point 1 (on, 100 lux, log contrast 0.375): its worker died 3 times"),
        ("FailingCamera", DeviceError, "camera: read the events: [Errno 5] Input/output error"),
    ],
)
def test_a_point_that_cannot_be_taken_ends_the_run_in_one_line(
    camera: str, error: type[Exception], text: str, many: LoadedProtocol, tmp_path: Path
) -> None:
    with pytest.raises(error) as caught:
        run_protocol(many, station_with(tmp_path, camera), tmp_path / "run", workforce=Workforce(2))
    assert str(caught.value).startswith(text)
    assert "\n" not in str(caught.value)
    states = _states(tmp_path / "run")
    assert ("failed", 1) in states
    assert states[-1] == ("run_aborted", None)
    assert not list((tmp_path / "run/points").glob("*.part*"))
    Run.open(tmp_path / "run").verify()


@pytest.mark.slow
def test_a_point_that_keeps_failing_is_tried_again_and_skipped_and_the_others_are_taken(tmp_path: Path) -> None:
    text = MANY.replace("measurements:", "policy: {on_failure: {retries: 1, then: skip}}\nmeasurements:", 1)
    night, told = parse_protocol(text, "night.yaml"), Telling()
    station, folder = station_with(tmp_path, "FailingCamera"), tmp_path / "run"
    result = run_protocol(night, station, folder, workforce=Workforce(2), progress=told)
    states = _states(folder)
    skipped = {point for state, point in states if state == "skipped"}
    assert (result.done, result.skipped, result.stopped) == (12 - len(skipped), len(skipped), False)
    assert 1 in skipped
    for point in skipped:
        assert [state for state, p in states if p == point] == ["planned", *["started", "failed"] * 2, "skipped"]
    assert states[-1] == ("run_finished", None)
    assert not list((folder / "points").glob("*.part*"))
    assert "point 1 is skipped: camera: read the events" in told.text


@pytest.mark.slow
def test_a_run_that_is_killed_is_resumed(quick: Station, expected_many: dict[int, str], tmp_path: Path) -> None:
    (tmp_path / "many.yaml").write_text(MANY)
    folder = tmp_path / "run"
    command = [sys.executable, "-m", "bench", "run", "many.yaml", "--station", "station.yaml", "--workers", "2"]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p or "." for p in sys.path)}
    with subprocess.Popen(
        [*command, "--out", "run"], cwd=tmp_path, env=environment, stderr=subprocess.DEVNULL
    ) as child:
        while not list(folder.glob("points/*.h5")):
            assert child.poll() is None, "the run was over before it was killed"
            time.sleep(0.001)
        child.kill()
    Run.open(folder).verify()
    # A kill may come between a file's name and its line, or in the middle of a line: both by hand, to be sure.
    torn = (folder / "journal.jsonl").read_text().rpartition('"state": "done"')[0]
    (folder / "journal.jsonl").write_text(torn + '"state"')
    (folder / "points/000011.h5.part").write_bytes(next(folder.glob("points/*.h5")).read_bytes()[:1000])
    left = len(expected_many) - len(list(folder.glob("points/*.h5")))
    result = resume(folder, workforce=Workforce(2))
    assert (result.done, result.stopped) == (len(expected_many), False)
    _is_whole(folder, expected_many)
    states = _states(folder)
    assert len([state for state, _ in states[states.index(("resumed", None)) :] if state == "started"]) == left


def test_a_run_that_is_being_written_is_not_resumed(many: LoadedProtocol, quick: Station, tmp_path: Path) -> None:
    def try_it() -> None:
        with pytest.raises(RunError, match="another process is writing this run"):
            resume(tmp_path / "run")

    run_protocol(many, quick, tmp_path / "run", progress=Telling(1, try_it))


def test_a_real_instrument_has_one_process(protocol: LoadedProtocol, quick: Station, tmp_path: Path) -> None:
    quick._plan["roles"]["wheel"]["args"].pop("world")
    line = r"station simulated: wheel \(sim_backend.devices.filter_wheel:SimulatedFilterWheel\) is no part of"
    for workforce in (Workforce(2), Workforce(cluster="tcp://127.0.0.1:1")):
        with pytest.raises(InputError, match=line):
            run_protocol(protocol, quick, tmp_path / "run", workforce=workforce)
    assert not (tmp_path / "run").exists()


def test_a_file_that_is_too_large_for_the_network_is_told(
    protocol: LoadedProtocol, quick: Station, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bench.run.measuring._MOST_BYTES", 1000)
    planned = plan_or_raise(protocol.protocol.expand(), quick)[4]
    job = PointJob(planned, quick.resolved, quick.name, planned.point.roi, None)
    with pytest.raises(RunError, match=r"point 4: its file has 0.00 GB, and a worker sends at most"):
        measure(job)


@pytest.mark.parametrize("other", [True, False])
def test_a_run_that_was_begun_with_other_software_is_told(whole_many: Path, tmp_path: Path, other: bool) -> None:
    folder, told = tmp_path / "run", Telling()
    shutil.copytree(whole_many, folder)
    journal = folder / "journal.jsonl"
    lines = [line for line in journal.read_text().splitlines() if '"point": 11' not in line]
    journal.write_text("\n".join(lines[:-1]) + "\n")
    (folder / "points" / "000011.h5").unlink()
    header = yaml.safe_load((folder / "run.yaml").read_text())
    if other:
        header["software"]["numba"] = "0.1.0"
    (folder / "run.yaml").write_text(yaml.safe_dump(header))
    assert resume(folder, progress=told).done == 12
    assert ("begun with other software: numba " in told.text) == other
    assert ("instead of 0.1.0; the points that are left" in told.text) == other
