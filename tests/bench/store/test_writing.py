"""The writer: what it writes is read back, nothing is overwritten, and nothing half-written has a final name."""

from __future__ import annotations

import hashlib
import json
import math
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from bench.store import Run, RunError, RunWriter
from bench.store.journal import skipped
from bench.store.point_writer import PointWriter
from bench.store.record import PointRecord, PulseRecord, StimulusRecord
from bench.store.signals import signals_later
from bench.store.sink import Sink
from bench.store.writer import is_being_written
from drivers.events.types import EVENT_DTYPE, TRIGGER_DTYPE, EventChunk, empty_triggers
from protocols.points import Roi

HEADER: dict[str, Any] = {
    "id": "2026-11-20T21-03-11Z-test",
    "created": "2026-11-20T21:03:11Z",
    "title": "a test: with a colon",
    "sensor": {"name": "S", "width": 64, "height": 48, "pixel_pitch_m": 4.86e-6, "quantum_efficiency": 0.6},
    "roi": {"x": 0, "y": 0, "width": 64, "height": 48},
    "protocol_text": "a: 1\nb:\n  - 'on'\n\n",
    "software": {"revision": "1e5", "versions": ["1.10", "12:30", "on"]},
}


def _events(n: int, seed: int = 1) -> np.ndarray[Any, Any]:
    rng = np.random.default_rng(seed)
    events = np.empty(n, EVENT_DTYPE)
    events["t"] = np.sort(rng.integers(0, 10**8, n))
    events["x"], events["y"] = rng.integers(0, 64, n), rng.integers(0, 48, n)
    events["p"] = rng.integers(0, 2, n)
    return events


def _record(index: int = 0, **changes: Any) -> PointRecord:
    stimulus = StimulusRecord(np.array([0.0, 1.0]), np.array([10.0, 20.0]), np.array([-1, 0]))
    pulses = PulseRecord(np.array([1.0]), np.array([1.5]), np.array([0], np.uint8), np.array([1], np.uint8))
    values = {"duration_s": 100.0, "nd_od": 0.0, "baseline_lux": 10.0, "log_contrast": math.log(2), **changes}
    return PointRecord(index, "square", "both", stimulus=stimulus, pulses=pulses, **values)


def test_what_was_written_is_read_back(tmp_path: Path) -> None:
    events = _events(700_000)
    triggers = np.array([(1_000_000, 1, 0)], TRIGGER_DTYPE)
    more: dict[str, Any] = {"attributes": {"ambient": "open", "left_out": None}, "bias": {"bias_refr": -20.0}}
    with RunWriter(tmp_path / "runs" / "a", HEADER) as writer:
        writer.note("run_started")
        with writer.point(0) as point:
            for part in np.array_split(events, 13):
                point.append(EventChunk(part, triggers if part is events else empty_triggers()))
            point.append(EventChunk(events[:0], triggers))
            record = _record(roi=Roi(0, 0, 64, 48), gaps_s=((1.0, 2.0),), quality={"decode_errors": 2}, **more)
            path = writer.finish(point, record)
        writer.note("run_finished")
    run = Run.open(tmp_path / "runs" / "a")
    run.verify()
    assert run.header.everything == {"format": "evs-bench-run/1", **HEADER}
    (read,) = run.points()
    np.testing.assert_array_equal(np.concatenate(list(read.events(50_000))), events)
    assert read.triggers_t_us.tolist() == [1_000_000]
    assert read.gaps_s.tolist() == [[1.0, 2.0]]
    assert read.quality == {"decode_errors": 2}
    assert read.bias == {"bias_refr": -20.0}
    assert read.attributes["ambient"] == "open"
    assert "left_out" not in read.attributes
    assert math.isnan(read.temperature_c)
    assert [e.state for e in run.journal] == ["run_started", "done", "run_finished"]
    assert run.journal[1].sha256 == hashlib.sha256(path.read_bytes()).hexdigest()


def test_the_file_is_as_the_format_says(tmp_path: Path) -> None:
    with RunWriter(tmp_path / "a", HEADER) as writer, writer.point(0) as point:
        point.append(EventChunk(_events(10), empty_triggers()))
        path = writer.finish(point, _record())
    assert path.name == "000000.h5"
    with h5py.File(path) as file:
        assert file.attrs["format"] == "evs-bench-point/1"
        expected = {
            "events/t": "int64", "events/x": "uint16", "events/y": "uint16", "events/p": "uint8",
            "stimulus/t": "float64", "stimulus/illuminance": "float64", "stimulus/trigger": "int64",
            "pulses/start": "float64", "pulses/stop": "float64", "pulses/kind": "uint8", "pulses/valid": "uint8",
            "triggers/t": "int64", "triggers/p": "uint8",
        }  # fmt: skip
        found: dict[str, str] = {}
        file.visititems(lambda name, item: found.update({name: str(item.dtype)} if hasattr(item, "dtype") else {}))
        assert found == expected
        assert all(file[name].attrs["units"] for name in expected)
        assert (file["events/t"].compression, file["events/t"].compression_opts) == ("gzip", 1)
        assert file["events/t"].shuffle


def test_nothing_is_overwritten(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    with pytest.raises(RunError, match="exists already"):
        RunWriter(tmp_path / "a", HEADER)
    assert list((tmp_path / "a").iterdir()) == []


def test_a_point_that_is_not_finished_leaves_nothing(tmp_path: Path) -> None:
    with RunWriter(tmp_path / "a", HEADER) as writer:
        with writer.point(0) as point:
            point.append(EventChunk(_events(10), empty_triggers()))
        assert list((tmp_path / "a" / "points").iterdir()) == []
    assert len(Run.open(tmp_path / "a")) == 0


def test_a_folder_that_cannot_be_made_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(RunError, match=r"could not be written: (Not a directory|File exists)") as error:
        RunWriter(tmp_path / "file" / "a", HEADER)
    assert "\n" not in str(error.value)


def test_states_that_the_format_does_not_know_are_refused(tmp_path: Path) -> None:
    with RunWriter(tmp_path / "a", HEADER) as writer, pytest.raises(ValueError, match="no such state of a run"):
        writer.note("done")


def test_the_journal_is_one_object_a_line(tmp_path: Path) -> None:
    with RunWriter(tmp_path / "a", HEADER) as writer:
        writer.note_plan(range(3))
        writer.note("failed", 1, reason="light source: \N{DEGREE SIGN}C\nline two")
    lines = [json.loads(line) for line in (tmp_path / "a/journal.jsonl").read_text().splitlines()]
    assert [line["state"] for line in lines] == ["planned"] * 3 + ["failed"]
    assert set(lines[3]) == {"t", "point", "state", "attempt", "file", "sha256", "reason"}


FULL_DISK = """
import resource, sys
from pathlib import Path
sys.path.insert(0, sys.argv[3])
from test_writing import HEADER, _events, _record
from bench.store import RunError, RunWriter
from drivers.events.types import EventChunk, empty_triggers
folder, limit = Path(sys.argv[1]), int(sys.argv[2])
resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
try:
    with RunWriter(folder, HEADER) as writer, writer.point(0) as point:
        for seed in range(3):
            point.append(EventChunk(_events(300_000, seed)[:0], empty_triggers()))
        events = _events(900_000)
        for start in range(0, 900_000, 300_000):
            point.append(EventChunk(events[start : start + 300_000], empty_triggers()))
        writer.finish(point, _record())
except RunError as error:
    sys.exit(str(error))
"""


@pytest.mark.parametrize("limit", [100, 5_000, 500_000, 2_000_000])
def test_a_full_disk_is_one_line_and_leaves_nothing_half_written(tmp_path: Path, limit: int) -> None:
    """A limit of the size of files stands for the disk: writing fails in the same calls, at another error number."""
    folder = tmp_path / "a"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p or "." for p in sys.path)}
    done = subprocess.run(
        [sys.executable, "-c", FULL_DISK, str(folder), str(limit), str(Path(__file__).parent)],
        capture_output=True, text=True, timeout=60, env=environment,
    )  # fmt: skip
    assert done.returncode == 1, done.stderr
    assert len(done.stderr.splitlines()) == 1, done.stderr
    assert "could not be written: File too large" in done.stderr
    if limit < 500:
        assert not folder.exists()
    else:
        assert list((folder / "points").iterdir()) == []
        assert len(Run.open(folder)) == 0


@pytest.mark.parametrize("call", ["write", "seek", "tell", "truncate", "readinto", "close"])
def test_nothing_that_is_raised_in_the_file_passes_through_hdf5(tmp_path: Path, call: str) -> None:
    class Broken:
        def __init__(self, file: Any) -> None:
            self.file = file

        def __getattr__(self, name: str) -> Any:
            if name == call:
                raise KeyboardInterrupt
            return getattr(self.file, name)

    sink = Sink(tmp_path / "x")
    sink.write(b"abc")
    file = sink._file
    sink._file = Broken(file)  # type: ignore[assignment]
    sink.seek(0)
    sink.tell()
    sink.write(b"abcd")
    sink.truncate(10)
    sink.readinto(bytearray(3))
    sink.close()
    file.close()
    with pytest.raises(KeyboardInterrupt):
        sink.check()


def test_an_interrupt_inside_hdf5_comes_after_the_call(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C as HDF5 writes: the call ends first, and the unfinished file is removed."""
    write = Sink.write
    calls: list[int] = []

    def interrupted(self: Sink, data: object) -> int:
        calls.append(len(calls))
        signal.raise_signal(signal.SIGINT)  # not held back, it would be raised here
        return write(self, data)

    folder = tmp_path / "a"
    with RunWriter(folder, HEADER) as writer:
        with pytest.raises(KeyboardInterrupt), writer.point(0) as point:  # noqa: PT012 - the patch is part of it
            monkeypatch.setattr(Sink, "write", interrupted)
            point.append(EventChunk(_events(700_000), empty_triggers()))
        assert calls
        assert list((folder / "points").iterdir()) == []
        monkeypatch.undo()
        monkeypatch.setattr(PointWriter, "_growing", lambda *_: signal.raise_signal(signal.SIGINT))
        with pytest.raises(KeyboardInterrupt):
            writer.point(1)  # made, and given up before anybody has it
        assert list((folder / "points").iterdir()) == []
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_an_interrupt_before_anybody_has_the_writer_of_a_point_leaves_nothing(tmp_path: Path) -> None:
    """Ctrl-C between the making of that writer and the `with` that would end it: the run clears up after it."""
    with pytest.raises(KeyboardInterrupt), RunWriter(tmp_path / "a", HEADER) as writer:  # noqa: PT012 - as in a run
        lost = writer.point(0)
        assert lost.part.exists()
        raise KeyboardInterrupt
    assert list((tmp_path / "a" / "points").iterdir()) == []
    lost.abandon()  # what is left of it can go at any time


def test_signals_are_held_back_and_handlers_put_back() -> None:
    before = signal.getsignal(signal.SIGTERM)
    got: list[int] = []
    signal.signal(signal.SIGTERM, lambda which, _frame: got.append(which))
    try:
        with signals_later(), signals_later():
            signal.raise_signal(signal.SIGTERM)
            assert got == []
        assert got == [signal.SIGTERM]
        signal.raise_signal(signal.SIGTERM)
        assert len(got) == 2
    finally:
        signal.signal(signal.SIGTERM, before)


def _take(writer: RunWriter, index: int, *, reject: bool = False) -> Path:
    writer.begin(index)
    with writer.point(index) as point:
        point.append(EventChunk(_events(10), empty_triggers()))
        return (writer.reject if reject else writer.finish)(point, _record(index))


def test_each_file_of_a_point_has_its_own_name_and_attempts_are_counted_over_all_sessions(tmp_path: Path) -> None:
    with RunWriter(tmp_path / "a", HEADER) as writer:
        names = [_take(writer, 0, reject=True).name, _take(writer, 0).name, _take(writer, 1).name]
        writer.begin(2)
        writer.note("failed", 2, reason="a reason")
        assert is_being_written(tmp_path / "a")
    assert names == ["000000.h5", "000000.r1.h5", "000001.h5"]
    assert not is_being_written(tmp_path / "a")
    (tmp_path / "a/points/000001.h5").unlink()
    with RunWriter(tmp_path / "a", None) as writer:
        writer.give_up(1, "it is not there")
        assert not writer.is_done(1)
        assert [_take(writer, index).name for index in (1, 2)] == ["000001.r1.h5", "000002.h5"]
        writer.skip(3, "a reason")
        assert writer.is_skipped(3)
    run = Run.open(tmp_path / "a")
    run.verify()
    assert [file.path.name for file in run.files] == ["000000.r1.h5", "000001.r1.h5", "000002.h5"]
    done = {entry.point: entry.attempt for entry in run.journal if entry.state == "done"}
    assert done == {0: 2, 1: 2, 2: 2}
    assert list(skipped(run.journal)) == [3]


def test_a_file_without_a_line_is_found_by_any_of_its_names(tmp_path: Path) -> None:
    with RunWriter(tmp_path / "a", HEADER) as writer:
        first = _take(writer, 0, reject=True)
    (tmp_path / "a/points/000000.r1.h5").write_bytes(first.read_bytes())
    with RunWriter(tmp_path / "a", None) as writer:
        ((index, file),) = writer.unadopted()
        assert (index, file.name) == (0, "000000.r1.h5")
        writer.adopt(index, file)
    assert [file.path.name for file in Run.open(tmp_path / "a").files] == ["000000.r1.h5"]
