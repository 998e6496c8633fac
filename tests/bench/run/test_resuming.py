"""Going on with a run after any end: what is sound stays, what is not is taken again, what differs is said."""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import yaml

sys.path.insert(0, str(Path(__file__).parent))

from night_devices import Telling, journal, states, with_policy  # type: ignore[import-not-found]

from bench.cli import run as command
from bench.run import resume, run_protocol
from bench.run.stop import StopFlag
from bench.station import load_station, station_from
from bench.store import Run, RunError
from drivers.errors import DataLost
from drivers.events.types import EVENT_DTYPE
from protocols import InputError, LoadedProtocol, parse_protocol

if TYPE_CHECKING:
    from collections.abc import Callable

    from bench.station import Station

TEXT = """\
format: evs-bench-protocol/1
title: to be gone on with
seed: 8
roi: {x: 10, y: 20, width: 3, height: 2}
expect: {dark_light_lux: 0.146}
settings: {thresholds: {on: 0.3, off: 0.25}, refractory_period_s: 0.01, bandwidth_hz: 200}
pulses: 2
measurements:
  - name: "square"
    stimulus: {kind: square, frequency_hz: 10}
    sweep: {illuminance_lux: [10], contrast: {scale: log, values: [0.5, 0.7, 0.9, 1.1]}}
"""


@pytest.fixture(scope="module")
def short() -> LoadedProtocol:
    """Return four points."""
    return parse_protocol(TEXT, "short.yaml")


@pytest.fixture(scope="module")
def whole(short: LoadedProtocol, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the undisturbed run."""
    folder = tmp_path_factory.mktemp("whole") / "run"
    run_protocol(short, load_station("simulated"), folder)
    return folder


@pytest.fixture
def folder(whole: Path, tmp_path: Path) -> Path:
    """Return a copy of the undisturbed run, to be damaged."""
    shutil.copytree(whole, tmp_path / "run")
    return tmp_path / "run"


def _events(folder: Path) -> list[Any]:
    return [np.concatenate([np.empty(0, EVENT_DTYPE), *point.events()]) for point in Run.open(folder).points()]


def _is_as(folder: Path, whole: Path) -> None:
    run = Run.open(folder)
    run.verify()
    assert len(run) == 4
    for one, other in zip(_events(folder), _events(whole), strict=True):
        np.testing.assert_array_equal(one, other)
    assert journal(folder)[-1]["state"] == "run_finished"


def _cut(folder: Path, after: Callable[[dict[str, Any]], bool]) -> None:
    """Leave the journal as it was right after the first line for which `after` holds."""
    lines = (folder / "journal.jsonl").read_text().splitlines()
    last = next(n for n, line in enumerate(lines) if after(json.loads(line)))
    (folder / "journal.jsonl").write_text("".join(line + "\n" for line in lines[: last + 1]))


def _change(folder: Path, change: Callable[[dict[str, Any]], None]) -> None:
    header = yaml.safe_load((folder / "run.yaml").read_text())
    change(header)
    (folder / "run.yaml").write_text(yaml.safe_dump(header, sort_keys=False))


def test_a_damaged_file_is_taken_again_as_a_new_one(folder: Path, whole: Path) -> None:
    file = folder / "points/000002.h5"
    damaged = bytearray(file.read_bytes())
    damaged[len(damaged) // 2] ^= 0xFF
    file.write_bytes(bytes(damaged))
    told = Telling()
    assert resume(folder, progress=told).done == 4
    assert "point 2 is taken again: points/000002.h5 is not as it was written (its SHA-256 differs)" in told.text
    assert file.read_bytes() == bytes(damaged)
    assert states(folder)[-4:] == [
        ("resumed", None, None), ("started", 2, 2), ("done", 2, 2), ("run_finished", None, None),
    ]  # fmt: skip
    assert next(line for line in journal(folder) if line["state"] == "rejected")["point"] == 2
    assert journal(folder)[-2]["file"] == "points/000002.r1.h5"
    _is_as(folder, whole)


def test_a_file_that_is_gone_is_taken_again(folder: Path, whole: Path) -> None:
    (folder / "points/000001.h5").unlink()
    with pytest.raises(RunError, match=r"000001\.h5 is not there; bring it back, or take the point again with"):
        Run.open(folder)
    told = Telling()
    resume(folder, progress=told)
    assert "point 1 is taken again: points/000001.h5 is not there" in told.text
    _is_as(folder, whole)


def test_a_crash_between_a_file_and_its_line_adopts_the_file(folder: Path, whole: Path) -> None:
    _cut(folder, lambda line: line["state"] == "started" and line["point"] == 3)
    resume(folder)
    assert sorted(path.name for path in (folder / "points").iterdir()) == [f"{n:06d}.h5" for n in range(4)]
    _is_as(folder, whole)


def test_a_half_of_a_point_is_taken_again(folder: Path, whole: Path) -> None:
    _cut(folder, lambda line: line["state"] == "started" and line["point"] == 2)
    (folder / "points/000003.h5").unlink()
    (folder / "points/000002.h5").rename(folder / "points/000002.h5.part")
    resume(folder)
    done = [(line["point"], line["attempt"], line["file"]) for line in journal(folder) if line["state"] == "done"]
    assert done[2:] == [(2, 2, "points/000002.h5"), (3, 1, "points/000003.h5")]
    _is_as(folder, whole)


def test_a_clock_that_was_set_back_changes_nothing(
    folder: Path, whole: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _cut(folder, lambda line: line["state"] == "done" and line["point"] == 1)
    for n in (2, 3):
        (folder / f"points/00000{n}.h5").unlink()
    monkeypatch.setattr("bench.store.writer.utc_now", lambda: "1999-01-01T00:00:00.000Z")
    assert resume(folder).done == 4
    _is_as(folder, whole)


def _left(folder: Path) -> None:
    _cut(folder, lambda line: line["state"] == "done" and line["point"] == 2)
    (folder / "points/000003.h5").unlink()


def test_a_station_that_is_another_is_refused_with_every_difference(folder: Path, whole: Path) -> None:
    _left(folder)
    station = _with_world(noise_rms=0.06)
    line = r"the run was begun on another station: world\.args\.pixel\.noise_rms was 0\.0.*, and is 0\.06 now"
    before = (folder / "journal.jsonl").read_bytes()
    with pytest.raises(InputError, match=line) as caught:
        resume(folder, station=station)
    assert len(caught.value.problems) == 2
    assert (folder / "journal.jsonl").read_bytes() == before
    assert resume(folder, station=_with_world(noise_rms=0.06), accept_differences=True).done == 4
    (resumed,) = [entry for entry in journal(folder) if entry["state"] == "resumed"]
    assert resumed["differences"][0].startswith("world.args.pixel.noise_rms was ")


def _with_world(**pixel: float) -> Station:
    plan: dict[str, Any] = load_station("simulated").resolved
    plan["world"]["args"]["pixel"] |= pixel
    return station_from(plan, "other.yaml")


def test_other_devices_are_refused(folder: Path) -> None:
    _left(folder)
    _change(folder, lambda header: header["station"]["identities"]["camera"].update(serial="00050123"))
    line = r"the run was begun with other devices: camera\.serial was '00050123', and is 'sensor seed .*' now"
    with pytest.raises(InputError, match=line):
        resume(folder)
    assert resume(folder, accept_differences=True).done == 4


def test_another_protocol_is_refused(folder: Path) -> None:
    _left(folder)

    def change(header: dict[str, Any]) -> None:
        header["protocol"]["measurements"][0]["seed"] = 99

    _change(folder, change)
    with pytest.raises(InputError, match=r"000000\.h5: it is not the point of the protocol in run.yaml: seed was"):
        resume(folder)


def test_the_same_shipped_station_is_the_same(folder: Path, whole: Path) -> None:
    _left(folder)
    assert command(["resume", str(folder), "--station", "simulated"]) == 0
    _is_as(folder, whole)


def test_a_station_that_is_not_simulated_is_gone_on_with_too(short: LoadedProtocol, tmp_path: Path) -> None:
    """Real drivers on emulated wires: the devices must be the same, and are set anew."""
    folder, stop = tmp_path / "run", StopFlag()
    first = run_protocol(short, load_station("wire"), folder, progress=Telling(1, stop.request), stop=stop)
    assert (first.stopped, first.resumable) == (True, True)
    assert first.done in (1, 2)
    told = Telling()
    assert resume(folder, station=load_station("wire"), progress=told).done == 4
    Run.open(folder).verify()
    assert len(Run.open(folder)) == 4


def test_skipped_points_are_tried_again_where_that_is_asked_for(short: LoadedProtocol, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    station = load_station("simulated")
    play, count = type(station.light)._play, [0]

    def failing(self: Any, waveform: Any) -> Any:
        count[0] += 1
        if count[0] == 2:
            raise DataLost("light source", "play", "the line went dead")
        return play(self, waveform)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(type(station.light), "_play", failing)
        skipping = with_policy(short, "policy: {on_failure: {then: skip, wait_s: 0}}")
        assert run_protocol(skipping, station, folder).skipped == 1
    told = Telling()
    result = resume(folder, progress=told)
    assert (result.done, result.skipped, result.stopped) == (3, 1, False)
    assert "all 3 points of this run are done; 1 were skipped, try them again with --retry-skipped" in told.text
    again = resume(folder, retry_skipped=True)
    assert (again.done, again.skipped) == (4, 0)
    assert Run.open(folder).remarks() == ()


def test_a_run_folder_that_is_removed_meanwhile_ends_the_run_in_one_line(
    short: LoadedProtocol, tmp_path: Path
) -> None:
    station = load_station("simulated")
    told = Telling(1, lambda: shutil.rmtree(tmp_path / "run"))
    with pytest.raises(RunError, match=r"00000[12]\.h5: could not be written: No such file or directory"):
        run_protocol(short, station, tmp_path / "run", progress=told)
    assert station.light._world.level == 0.0  # type: ignore[attr-defined]
    assert "resume" not in told.text
