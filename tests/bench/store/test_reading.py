"""The reader: the practice run, the rules of the journal, and files that are not what they should be."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import yaml

from bench.store import Run, RunError
from bench.store.event_reader import read_events
from bench.store.reader import read_point
from bench.store.run import sha256_of
from protocols.points import Roi

ROI = Roi(600, 300, 16, 16)


@pytest.fixture
def practice(data_folder: Path) -> Path:
    return data_folder / "practice" / "practice_3"


@pytest.fixture
def point_file(practice: Path, tmp_path: Path) -> Path:
    """Return a copy of one small point of the practice run, for spoiling."""
    return Path(shutil.copy(practice / "points" / "000003.h5", tmp_path / "000003.h5"))


@pytest.fixture
def small_run(practice: Path, tmp_path: Path) -> Path:
    """Return a run of three points without a journal."""
    folder = tmp_path / "run"
    (folder / "points").mkdir(parents=True)
    shutil.copy(practice / "run.yaml", folder)
    for number in range(3):
        shutil.copy(practice / "points" / f"00000{number}.h5", folder / "points")
    return folder


def test_the_practice_run_agrees_with_h5py(practice: Path) -> None:
    run = Run.open(practice)
    assert run.header.id == "practice_3"
    assert run.header.roi == ROI
    assert run.header.sensor.photons_per_lux == pytest.approx(1.12e16)
    assert len(run) == 65
    total = 0
    for point, path in zip(run.points(), sorted((practice / "points").glob("*.h5")), strict=True):
        with h5py.File(path) as file:
            assert point.index == int(file.attrs["index"])
            assert point.n_events == len(file["events/t"])
            np.testing.assert_array_equal(point.pulse_stop_s, file["pulses/stop"][()])
            assert point.baseline_lux == file.attrs["baseline_lux"]
            total += sum(int(chunk["t"].sum()) for chunk in point.events(chunk=20_000))
            total -= int(file["events/t"][()].sum())
        assert point.roi == ROI
        assert point.pulse_valid.all()
        assert point.bias == {}
    assert total == 0
    run.verify()


def test_events_come_in_chunks_of_the_size_asked_for(practice: Path) -> None:
    point = next(p for p in Run.open(practice).points() if p.n_events > 2000)
    chunks = list(point.events(chunk=700))
    assert [len(c) for c in chunks[:-1]] == [700] * (len(chunks) - 1)
    np.testing.assert_array_equal(np.concatenate(chunks), np.concatenate(list(point.events())))


@pytest.mark.parametrize("chunk", [7, 1000, 1_000_000])
def test_later_events_are_left_on_disk(practice: Path, chunk: int) -> None:
    point = next(p for p in Run.open(practice).points() if p.index == 3)
    every = np.concatenate(list(point.events()))
    until_s = float(every["t"][len(every) // 3]) * 1e-6  # an event at the very end counts
    cut = list(replace(point, until_s=until_s).events(chunk))
    np.testing.assert_array_equal(np.concatenate(cut), every[every["t"] <= round(until_s * 1e6)])
    assert all(len(part) for part in cut)
    assert list(replace(point, until_s=-1.0).events(chunk)) == []


def test_a_part_of_the_window_is_read(practice: Path) -> None:
    point = next(p for p in Run.open(practice).points() if p.index == 3)
    every = np.concatenate(list(point.events()))
    part = replace(point, roi=Roi(ROI.x + 3, ROI.y + 5, 4, 2), stored_roi=point.roi)
    x, y = every["x"].astype(int) - ROI.x, every["y"].astype(int) - ROI.y
    wanted = every[(x >= 3) & (x < 7) & (y >= 5) & (y < 7)]
    np.testing.assert_array_equal(np.concatenate(list(part.events(100))), wanted)


def test_types_of_other_tools_are_understood(point_file: Path) -> None:
    with h5py.File(point_file, "r+") as file:
        file.attrs["index"] = np.float64(3.0)
        file.attrs["waveform"] = np.bytes_(b"square")
        file.attrs["polarity"] = np.array(["on"], dtype=h5py.string_dtype())
        file.attrs["something_new"] = "kept"
        file.create_dataset("another/dataset", data=[1, 2, 3])
        times = file["triggers/t"][()].astype(">i4")
        del file["triggers/t"]
        file.create_dataset("triggers/t", data=times).attrs["units"] = b"us"
    point = read_point(point_file, ROI)
    assert (point.index, point.waveform, point.polarity) == (3, "square", "on")
    assert point.attributes["something_new"] == "kept"
    assert point.triggers_t_us.dtype == np.int64


def test_optional_parts_are_read(point_file: Path) -> None:
    with h5py.File(point_file, "r+") as file:
        k = len(file["pulses/start"])
        file.attrs.update({"roi_x": 600, "roi_y": 300, "roi_width": 16, "roi_height": 20})
        for name, data, units in (
            ("pulses/valid", np.arange(k, dtype=np.uint8) % 2, "1"),
            ("pulses/log_contrast", np.linspace(0.1, 0.2, k), "1"),
            ("quality/gaps", np.array([[0.5, 0.75]]), "s"),
            ("pixels/masked", np.array([[601, 302]], np.uint16), "pixel"),
        ):
            file.create_dataset(name, data=data).attrs["units"] = units
        file["quality"].attrs["decode_errors"] = 3
        file.create_group("bias").attrs["bias_refr"] = -20
    point = read_point(point_file, ROI)
    assert point.roi == Roi(600, 300, 16, 20)
    assert point.pulse_valid.sum() == k // 2
    assert point.pulse_log_contrast[-1] == pytest.approx(0.2)
    assert point.gaps_s.tolist() == [[0.5, 0.75]]
    assert point.masked.tolist() == [[601, 302]]
    assert point.quality["decode_errors"] == 3
    assert point.bias == {"bias_refr": -20.0}


def _retype(path: str, dtype: str) -> Any:
    def spoil(file: h5py.File) -> None:
        data, units = file[path][()].astype(dtype), file[path].attrs["units"]
        del file[path]
        file.create_dataset(path, data=data).attrs["units"] = units

    return spoil


def _units(path: str, units: str | None) -> Any:
    def spoil(file: h5py.File) -> None:
        if units is None:
            del file[path].attrs["units"]
        else:
            file[path].attrs["units"] = units

    return spoil


def _attribute(name: str, value: Any) -> Any:
    def spoil(file: h5py.File) -> None:
        if value is None:
            del file.attrs[name]
        else:
            file.attrs[name] = value

    return spoil


def _value(path: str, at: int, value: Any) -> Any:
    def spoil(file: h5py.File) -> None:
        file[path][at] = value

    return spoil


def _shorten(file: h5py.File) -> None:
    data = file["events/x"][:-1]
    del file["events/x"]
    file.create_dataset("events/x", data=data).attrs["units"] = "pixel"


def _remove(path: str) -> Any:
    def spoil(file: h5py.File) -> None:
        del file[path]

    return spoil


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (_attribute("format", "evs-bench-point/2"), "newer"),
        (_attribute("format", "something"), "expected 'evs-bench-point/1'"),
        (_attribute("waveform", "triangle"), "square, reset_test, constant"),
        (_attribute("polarity", None), "'polarity' is missing"),
        (_attribute("duration_s", "long"), "expected a number"),
        (_attribute("log_contrast", -0.1), "at least 0"),
        (_attribute("index", 1.5), "whole number"),
        (_retype("events/t", "float64"), "/events/t is of type float64, expected int64"),
        (_retype("events/x", "int32"), "/events/x is of type int32, expected uint16"),
        (_units("events/t", "s"), "/events/t has the units 's', expected 'us'"),
        (_units("events/t", "ms"), "/events/t has the units 'ms', expected 'us'"),
        (_value("events/t", 5, 10**15), "/events/t goes back in time (or before 0) at event 6"),
        (_value("events/p", 5, 2), "/events/p holds 2"),
        (_value("events/x", 5, 5), "event 5 at x = 5"),
        (_value("stimulus/t", 1, 1e6), "/stimulus/t goes back in time at entry 2"),
        (_value("stimulus/illuminance", 0, np.nan), "no illuminance"),
        (_value("pulses/stop", 0, -1.0), "ends before it begins"),
        (_value("pulses/kind", 0, 7), "/pulses/kind holds 7"),
        (_shorten, "/events/x has"),
        (_remove("triggers/p"), "/triggers/p is missing"),
        (_remove("events"), "/events/t is missing"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(point_file: Path, spoil: Any, says: str) -> None:
    with h5py.File(point_file, "r+") as file:
        spoil(file)
    with pytest.raises(RunError) as error:
        for _ in read_point(point_file, ROI).events():
            pass
    assert says in str(error.value)
    assert str(error.value).startswith(str(point_file))
    assert "\n" not in str(error.value)


def test_a_missing_run_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="no such run folder"):
        Run.open(tmp_path / "nowhere")
    with pytest.raises(RunError, match=r"this is no run, it has no run\.yaml"):
        Run.open(tmp_path)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"format": "evs-bench-run/2"}, "newer"),
        ({"format": None}, "expected 'evs-bench-run/1'"),
        ({"id": None}, "'id' is missing"),
        ({"sensor": "IMX636"}, "expected keys and values"),
        ({"roi": {"x": 0, "y": 0, "width": 0, "height": 4}}, "width is 0"),
        ({"roi": {"x": 0, "y": 0, "width": 4}}, "'height' is missing"),
    ],
)
def test_a_header_that_is_not_one(small_run: Path, change: dict[str, Any], says: str) -> None:
    content = yaml.safe_load((small_run / "run.yaml").read_text())
    (small_run / "run.yaml").write_text(yaml.safe_dump({**content, **change}))
    with pytest.raises(RunError, match=says) as error:
        Run.open(small_run)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("text", ["", "a: [1", "\x00", "- 1\n- 2\n", "[" * 2000, "a: !!python/object:os.system x"])
def test_a_header_that_is_not_even_yaml(small_run: Path, text: str) -> None:
    (small_run / "run.yaml").write_text(text)
    with pytest.raises(RunError) as error:
        Run.open(small_run)
    assert "\n" not in str(error.value)


def test_a_header_written_by_hand(small_run: Path) -> None:
    (small_run / "run.yaml").write_text(
        "format: evs-bench-run/1\nid: x\ncreated: 2026-11-20T21:03:11Z\nextra: kept\n"
        "sensor: {name: S, width: 640, height: 480, photons_per_lux: 1e16}\nroi: {x: 0, y: 0, width: 4, height: 3}\n"
    )
    header = Run.open(small_run).header
    assert header.created == "2026-11-20T21:03:11Z"
    assert header.sensor.photons_per_lux == 1e16
    assert np.isnan(header.sensor.quantum_efficiency)
    assert header.everything["extra"] == "kept"


def _journal(folder: Path, *lines: dict[str, Any], torn: str = "") -> None:
    (folder / "journal.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines) + torn)


def _done(point: int, file: str) -> dict[str, Any]:
    return {"point": point, "state": "done", "attempt": 1, "file": file, "sha256": None}


def test_the_last_done_line_of_each_point_counts(small_run: Path) -> None:
    shutil.copy(small_run / "points/000001.h5", small_run / "points/000001.r1.h5")
    _journal(
        small_run,
        {"state": "run_started"},
        _done(2, "points/000002.h5"),
        _done(1, "points/000001.h5"),
        {"point": 0, "state": "started"},
        _done(1, "points/000001.r1.h5"),
        {"state": "something_of_the_future", "point": 0},
        torn='{"point": 0, "state": "do',
    )
    run = Run.open(small_run)
    assert [f.path.name for f in run.files] == ["000001.r1.h5", "000002.h5"]
    assert len(run.journal) == 6


def test_without_a_journal_all_points_count(small_run: Path) -> None:
    (small_run / "points" / "000009.h5.part").write_bytes(b"half a file")
    assert [f.path.name for f in Run.open(small_run).files] == ["000000.h5", "000001.h5", "000002.h5"]


@pytest.mark.parametrize(
    ("lines", "says"),
    [
        ([_done(0, "points/000007.h5")], "is not there; bring it back"),
        ([_done(0, "../../etc/passwd")], "outside the run folder"),
        ([{"point": 0, "state": "done"}], "no file is named"),
    ],
)
def test_a_journal_that_does_not_fit(small_run: Path, lines: list[dict[str, Any]], says: str) -> None:
    _journal(small_run, *lines)
    with pytest.raises(RunError, match=says):
        Run.open(small_run)


def test_a_damaged_line_in_the_middle_is_named(small_run: Path) -> None:
    _journal(small_run, _done(0, "points/000000.h5"), torn='{"torn\n{"state": "run_finished"}\n')
    with pytest.raises(RunError, match=r"journal\.jsonl:2:1"):
        Run.open(small_run)


def test_verify_finds_a_file_that_was_changed(small_run: Path) -> None:
    _journal(small_run, {**_done(0, "points/000000.h5"), "sha256": "0" * 64})
    with pytest.raises(RunError, match="SHA-256 differs"):
        Run.open(small_run).verify()


def test_what_is_missing_or_changed_is_said(data_folder: Path, tmp_path: Path) -> None:
    source = data_folder / "practice" / "practice_3"
    points = tmp_path / "points"
    points.mkdir()
    shutil.copy(source / "run.yaml", tmp_path)
    lines = [{"state": "run_started"}, *({"state": "planned", "point": n} for n in range(3))]
    for n in range(2):
        shutil.copy(source / "points" / f"00000{n}.h5", points)
        digest = sha256_of(points / f"00000{n}.h5") if n else "0" * 64
        lines.append({"state": "done", "point": n, "file": f"points/00000{n}.h5", "sha256": digest})
    lines.append({"state": "run_aborted", "reason": "stopped by the operator"})
    (tmp_path / "journal.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    run = Run.open(tmp_path)
    assert len(list(run.points())) == 2
    assert run.remarks() == (
        "only 2 of 3 planned points were taken: run aborted (stopped by the operator)",
        "points were changed after they were written (SHA-256 differs): 000000.h5",
    )
    assert Run.open(source).remarks() == ()


@pytest.mark.parametrize(
    ("path", "units"),
    [
        ("stimulus/illuminance", "lx"), ("events/t", "\u00b5s"), ("events/t", "\u03bcs"), ("pulses/start", "seconds"),
        ("events/x", "px"), ("events/p", ""), ("events/p", "dimensionless"), ("pulses/start", None),
    ],
)  # fmt: skip
def test_other_spellings_of_the_units_are_read(point_file: Path, path: str, units: str | None) -> None:
    with h5py.File(point_file, "r+") as file:
        _units(path, units)(file)
    point = read_point(point_file, ROI)
    assert sum(len(events) for events in read_events(point_file)) == point.n_events
